# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Some cases of each target; minutes of each: PYTHONPATH=.:test python -m fuzz all."""

import pytest

from fuzz.driver import fuzz, make_sample
from fuzz.targets import TARGETS

CASES = {
    "scenario": 2000,
    "map": 3000,
    "run": 2000,
    "image": 1200,
    "tables": 800,
    "history": 700,
    "checkpoint": 200,
    "bag": 150,
    "results": 2000,
}
"""Of each target: about ten seconds of a processor's time."""


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    return make_sample(tmp_path_factory.mktemp("fuzz"))


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
def test_whatever_others_wrote_is_read_or_refused_in_one_line(sample, name):
    came, findings = fuzz(name, sample, last=CASES[name] - 1)
    assert findings == []
    assert came.total() == CASES[name]
