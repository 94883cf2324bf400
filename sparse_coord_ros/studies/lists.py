# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The fixed lists of scenarios that `benchmark` judges learners on. A new list is one entry here.

Rules and numbers are chosen on the lists for tuning. Those for validation show whether these hold
elsewhere. Those of `unseen2`, and of other kinds of interaction, are for closing figures alone.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.unseen import (
    SPLITS,
    TEAMS,
    VERSIONS,
    split_of,
    team_of,
)
from sparse_coord_ros.core.solve.shipped import unseen_buildings

FILES = (".yaml", ".yml")
"""The ends of the names of scenario files."""

PENALTY = -100
"""r^C in every list."""


class Item(NamedTuple):
    """One scenario of a list.

    Attributes:
        scenario: its name.
        settings: those that the list changes.
    """

    scenario: str
    settings: Mapping[str, object] = MappingProxyType({})


PAPER = ("env1", "env2-2r", "cit", "cmu", "isr", "mit", "pentagon", "suny")
CROWDS = ("env2-4r", "crowd-4r", "crowd-6r", "crowd-8r")
PERCEPTS = ("probability:0.5", "line_of_sight", "range:2")
SIZES: Mapping[int, str] = {2: "pairs", 4: "four", 8: "eight"}

SWAP_SEEDS: Mapping[str, Sequence[int]] = {
    "door": (1000, 1001, 1002, 1003),
    "doors": (1000, 1002, 1003, 1004),
    "corridor": (1000, 1001, 1002, 1003),
    "rooms": (1000, 1001, 1002, 1003),
    "loop": (1000, 1001, 1002, 1003),
    "crossing": (1000, 1001, 1003, 1004),
}
"""Seeds of the buildings where pairs exchange cells, by kind: the first four from 1,000 on whose
joint optimum exceeds shortest paths by more than 3."""

BLOCK_SEEDS: Mapping[str, Sequence[int]] = {
    **SWAP_SEEDS,
    "crossing": (1000, 1001, 1003, 1005),
}
"""The same where each cell holds one robot."""

OFFICES = tuple(f"building-3x2x4-16r-{seed}" for seed in range(1000, 1004))
"""Buildings of the largest teams: six rooms on a corridor."""


def _buildings(split: str, robots: int) -> tuple[Item, ...]:
    names = unseen_buildings()
    return tuple(
        Item(name)
        for name in names
        if split_of(name) == split and team_of(name) == robots
    )


def _pairs(interactions: str, seeds: Mapping[str, Sequence[int]]) -> tuple[Item, ...]:
    """Return buildings of two robots that no list has with the kind `together`."""
    return tuple(
        Item(f"{VERSIONS[1]}-{kind}-2r-{seed}", {"interactions": interactions})
        for kind, kind_seeds in seeds.items()
        for seed in kind_seeds
    )


def _unseen() -> dict[str, tuple[Item, ...]]:
    lists = {}
    for split, robots in product(SPLITS, TEAMS):
        first = "unseen2" if split == "test" else split
        lists[f"{first}-{SIZES[robots]}"] = _buildings(split, robots)
    return lists


LISTS: Mapping[str, tuple[Item, ...]] = {
    "paper": tuple(Item(name) for name in PAPER),
    "crowds": tuple(Item(name) for name in CROWDS),
    **_unseen(),
    "swap-pairs": _pairs("swap", SWAP_SEEDS),
    "block-pairs": _pairs("block:anywhere", BLOCK_SEEDS),
    "offices-16": tuple(Item(name) for name in OFFICES),
    "percepts": tuple(
        Item(name, {"perception": percept})
        for name in ("env1", "env2-2r", "pentagon")
        for percept in PERCEPTS
    ),
}
"""Every list, by its name."""

SAMPLED = tuple(name for name in LISTS if "-" in name)
"""Lists of buildings that stand for others of their kinds. Those of the other lists stand for
themselves."""

TUNING = tuple(name for name in LISTS if name.startswith("tuning"))


def items_of(names: Sequence[str]) -> dict[str, tuple[Item, ...]]:
    """Return lists by their names; a scenario file is a list of its one scenario.

    Raises:
        SettingError: unknown list.
    """
    unknown = [name for name in names if name not in LISTS and not name.endswith(FILES)]
    if unknown or not names:
        values = ", ".join(unknown) or "none"
        allowed = f"{', '.join(LISTS)}, or a scenario file"
        raise SettingError(f"lists: value is {values}, allowed: {allowed}")
    return {name: LISTS.get(name, (Item(name),)) for name in names}
