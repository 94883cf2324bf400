# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rates that are measured beside one another, and how they are shown."""

import statistics
from collections.abc import Callable, Mapping
from typing import TypeVar

Way = TypeVar("Way")


def in_turn(
    ways: Mapping[Way, Callable[[], float]], repeats: int
) -> dict[Way, list[float]]:
    """Return the rates of each way, all of them measured in turn, `repeats` times."""
    rounds = [[measure() for measure in ways.values()] for _ in range(repeats)]
    return dict(zip(ways, map(list, zip(*rounds, strict=True)), strict=True))


def spread(rates: list[float], digits: int = 0) -> tuple[str, str]:
    """Return the median of rates, and from where to where they go."""
    median, low, high = (
        f"{rate:.{digits}f}"
        for rate in (statistics.median(rates), min(rates), max(rates))
    )
    return median, f"{low} to {high}"
