# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a share is written for people."""

import math


def percent(share: float, *, whole: bool = False) -> str:
    """Return a share in percent, such as `93.2 %`; a dash for NaN.

    One digit stands after the point. A share that this rounds to 0 % or 100 % has more digits, up
    to two (`99.97 %`), so `0 %` and `100 %` stand for no or all cases, to within 0.005 %.

    Args:
        share: 1 is 100 %.
        whole: without a digit after the point, where it is neither 0 nor 100: for progress, and
            for shares that are known roughly.
    """
    if math.isnan(share):
        return "-"
    value = 100.0 * share
    nearest = f"{round(value)} %"
    if whole and round(value) not in (0, 100):
        return nearest
    for digits in (1, 2):
        shown = f"{value:.{digits}f}"
        if float(shown) not in (0.0, 100.0):
            return f"{shown} %"
    return nearest
