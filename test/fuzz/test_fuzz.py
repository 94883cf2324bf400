# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each target for a few seconds; minutes of each: PYTHONPATH=.:test python -m fuzz all."""

import pytest

from fuzz.driver import fuzz, make_sample
from fuzz.targets import TARGETS

SECONDS = 20.0


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    return make_sample(tmp_path_factory.mktemp("fuzz"))


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
def test_whatever_others_wrote_is_read_or_refused_in_one_line(sample, name):
    came, findings = fuzz(name, sample, seconds=SECONDS)
    assert findings == []
    assert came.total() > 20
