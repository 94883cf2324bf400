# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command; see `driver`."""

import sys

from fuzz.driver import main

sys.exit(main())
