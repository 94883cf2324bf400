# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loops that numba compiles once for all processes of a test run."""

import os

import pytest

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.core.engine.batch import prepare

LOOPS = ["coop", "voi"]
"""Learners whose loops several tests use: numba takes seconds for each."""


@pytest.fixture(scope="session")
def compiled_loops():
    """Compile all loops; each worker of pytest-xdist begins with others, and takes the rest."""
    if has_numba():
        worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
        for place in range(len(LOOPS)):
            prepare(LOOPS[(place + worker) % len(LOOPS)])
