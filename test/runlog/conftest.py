# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shared fixtures of the tests of logs: a good log that is changed and verified."""

import pytest

from sparse_coord_ros.log.runlog import verify


@pytest.fixture
def alter(good, rewritten, tmp_path):
    """Return a function that changes messages, and verifies."""

    def altered(change):
        return verify(rewritten(good.bag, tmp_path / "bag", change))

    return altered
