# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The class bound: the best team of two robots that has Algorithm 1's form, as far as it is known.

The joint optimum sees everything always and pays nothing for it; no team that has to ask reaches
it. A team of Algorithm 1's form has for each robot a map from its own cell to a move or to
COORDINATE, and under COORDINATE a map from its own and its peer's cell to a move (where the
percept fails, from its own cell alone); it pays for every ask. The search is
`solve.class_search`; its results for the paper's scenarios are shipped.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.scenario import Scenario, loaded
from sparse_coord_ros.game.settings import Setting
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.share import shipped_json

WARNING = "a lower bound of what the best team of this form is worth: the search may miss it"

RESTARTS = Setting("restarts", int, 20, "restarts of the search", low=1, high=1_000_000)

LETTERS = "nsew"
"""The moves in a policy's texts: the first letters of the primitive actions, in their order."""

GAME_SETTINGS = (
    "goal_reward",
    "penalty",
    "common_reward",
    "ask_cost",
    "discount",
    "move_success",
    "conflict",
    "perception",
)
"""What a team's value depends on besides map and robots; not how anybody learns."""


@dataclass(frozen=True)
class RobotPolicy:
    """What one robot does.

    Attributes:
        moves: one letter of `LETTERS` a cell: the move without asking, or after a failed percept.
        asks: of each cell where it asks (as text, as JSON has it): one letter for each cell of
            the peer, the move after a percept.
    """

    moves: str
    asks: Mapping[str, str]


@dataclass(frozen=True)
class ClassBound:
    """The best team of Algorithm 1's form that a search found.

    Attributes:
        value: total discounted reward from the scenario's starts, averaged over the robots and
            carried to infinity.
        robots: what each robot does.
        gains: what each robot alone could gain for itself at least, the other staying as it is:
            the best that a search found. All 0: nothing was found, the team seems an equilibrium.
        restarts: how many climbs from random teams there were.
        agreed: how many of them ended at this value.
        seed: of the search.
        game: digest of the game.
        version: of this software.
        date: when the search ended.
    """

    value: float
    robots: tuple[RobotPolicy, ...]
    gains: tuple[float, ...]
    restarts: int
    agreed: int
    seed: int
    game: str
    version: str
    date: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain data; `class_bound_from_dict` reads it back."""
        return asdict(self)


def class_bound_from_dict(data: Mapping[str, Any]) -> ClassBound:
    """Return what `ClassBound.to_dict` wrote; KeyError or TypeError where it did not."""
    robots = tuple(RobotPolicy(r["moves"], dict(r["asks"])) for r in data["robots"])
    return ClassBound(**{**data, "robots": robots, "gains": tuple(data["gains"])})


def check_class(scenario: Scenario) -> None:
    """Raise `SettingError` unless the scenario has two robots."""
    team = len(scenario.robots)
    if team != 2:
        raise SettingError(
            f"class bound: scenario {scenario.name} has {team} robot{'s' * (team != 1)}, allowed: "
            "2; for others there are the bound of robots alone and the joint optimum, leave out "
            "--class"
        )


def game_digest(scenario: Scenario) -> str:
    """Return a digest of all that the value of a team depends on; the horizon is infinite."""
    said = scenario.computation()
    kept = {key: said[key] for key in ("map", "robots", *GAME_SETTINGS) if key in said}
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()[:16]


def shipped_class_bound(scenario: str | Path | Scenario) -> ClassBound | None:
    """Return the class bound that this package ships for the very same game, or None.

    Args:
        scenario: the problem; settings of learning do not matter.
    """
    return _shipped().get(game_digest(loaded(scenario)))


@cache
def _shipped() -> dict[str, ClassBound]:
    bounds = shipped_json("class_bounds.json").get("bounds", {})
    return {data["game"]: class_bound_from_dict(data) for data in bounds.values()}


def class_tables(scenario: Scenario, robots: Sequence[RobotPolicy]) -> list[Tables]:
    """Return tables on which Algorithm 1 acts greedily as these policies say.

    Args:
        scenario: the problem.
        robots: the policy of each robot.
    """
    cells = len(scenario.map.cells)
    tables = []
    for robot in robots:
        q_star = np.zeros((cells, len(ACTIONS)))
        q_coord = np.zeros((cells, cells, PRIMITIVES))
        for x, letter in enumerate(robot.moves):
            q_star[x, LETTERS.index(letter)] = 1.0
        for cell, letters in robot.asks.items():
            q_star[int(cell), COORDINATE] = 2.0
            for z, letter in enumerate(letters):
                q_coord[int(cell), z, LETTERS.index(letter)] = 1.0
        tables.append(Tables(q_star, q_coord))
    return tables
