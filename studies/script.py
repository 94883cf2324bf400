# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the scripts of this folder end."""

import sys
from collections.abc import Callable

from sparse_coord_ros.base.errors import SparseCoordError


def run_script(main: Callable[[], None]) -> None:
    """Run a script; bad input is one line on stderr, and exit code 2."""
    try:
        main()
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
