# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shares are written in one form for people."""

import math

import pytest

from sparse_coord_ros.base.percents import percent


@pytest.mark.parametrize(
    ("share", "shown"),
    [
        (0.0, "0 %"),
        (1.0, "100 %"),
        (0.932, "93.2 %"),
        (0.5, "50.0 %"),
        (0.9994, "99.9 %"),
        (0.9997, "99.97 %"),
        (0.99996, "100 %"),
        (0.0004, "0.04 %"),
        (0.00004, "0 %"),
        (-0.00004, "0 %"),
        (-0.116, "-11.6 %"),
        (1.009, "100.9 %"),
        (math.nan, "-"),
    ],
)
def test_a_share_has_one_digit(share, shown):
    assert percent(share) == shown


@pytest.mark.parametrize(
    ("share", "shown"),
    [
        (0.0, "0 %"),
        (0.004, "0.4 %"),
        (0.937, "94 %"),
        (0.998, "99.8 %"),
        (1.0, "100 %"),
        (1.002, "100.2 %"),
    ],
)
def test_a_share_without_digits_is_not_all_and_not_nothing(share, shown):
    assert percent(share, whole=True) == shown
