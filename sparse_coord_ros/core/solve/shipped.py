# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reference values for a team's return: other known teams, and the joint optimum.

The joint optimum sees everything always and pays nothing for it; no team that has to ask reaches
it. A team of Algorithm 1's form has for each robot a map from its own cell to a move or to
COORDINATE, and under COORDINATE a map from its own and its peer's cell to a move (where the
percept fails, from its own cell alone); it pays for every ask. The best asking team found is the
best such team of two robots that a search found (`core.solve.asking_search`): a lower bound of
what such teams can reach. Larger teams are too large for the search: what is known of them is the
best of many learned teams, found again by `train` with the same learner, settings and seed. Both
are shipped for the paper's scenarios.

The unseen buildings (`core.game.unseen`) with a real conflict are shipped too: with two robots
their joint optimum and the best asking team found, with more an upper bound.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.share import shipped_json
from sparse_coord_ros.core.game.scenario import Scenario, loaded
from sparse_coord_ros.core.solve.optimum import Optimum, joint_optimum

UNSEEN = "unseen.json"

GAME_SETTINGS = (
    "goal_reward",
    "penalty",
    "common_reward",
    "ask_cost",
    "discount",
    "move_success",
    "interactions",
    "perception",
)
"""What a team's value depends on besides map and robots, without the learning protocol."""


@dataclass(frozen=True)
class RobotPolicy:
    """The policy of one robot.

    Attributes:
        moves: one letter a cell, n, s, e or w: the move without asking, or after a failed percept.
        asks: of each cell where it asks (as text, as JSON has it): one letter for each cell of
            the peer, the move after a percept.
    """

    moves: str
    asks: Mapping[str, str]


@dataclass(frozen=True)
class AskingTeam:
    """The best team of Algorithm 1's form that a search found.

    Attributes:
        value: total discounted reward from the scenario's starts, averaged over the robots and
            carried to infinity.
        robots: each robot's policy.
        gains: what each robot alone could gain for itself at least, the other staying as it is:
            the best that a search found. All 0: nothing was found, the team seems an equilibrium.
        restarts: number of climbs from random teams.
        agreed: number of climbs that ended at this value.
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


@dataclass(frozen=True)
class BestTeam:
    """The best of many learned teams.

    Attributes:
        value: its mean return, averaged over the robots.
        standard_error: of the trials.
        trials: trials behind it, other ones than those that it was chosen by.
        teams: number of teams from which it was chosen.
        learner: their learner.
        steps: their step budget.
        seed: its seed.
        game: digest of the game.
        version: of this software.
        date: when it was found.
    """

    value: float
    standard_error: float
    trials: int
    teams: int
    learner: str
    steps: int
    seed: int
    game: str
    version: str
    date: str

    def __str__(self) -> str:
        """Return a description in words."""
        return (
            f"{self.value:.2f} ({self.standard_error:.2f}), best of {self.teams} that learned: "
            f"{self.learner}, {self.steps} steps, seed {self.seed}"
        )


def game_digest(scenario: Scenario) -> str:
    """Return a digest of all that the value of a team depends on; the horizon is infinite."""
    content = scenario.computation()
    kept = {key: content[key] for key in ("map", "robots", *GAME_SETTINGS)}
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()[:16]


def shipped_asking_team(scenario: str | Path | Scenario) -> AskingTeam | None:
    """Return the best asking team that this package ships for the very same game, or None.

    Args:
        scenario: the problem; settings of learning do not matter.
    """
    data = _shipped("asking_teams.json", "teams").get(game_digest(loaded(scenario)))
    if data is None:
        return None
    robots = tuple(RobotPolicy(**robot) for robot in data["robots"])
    return AskingTeam(**{**data, "robots": robots, "gains": tuple(data["gains"])})


def shipped_best_team(scenario: Scenario) -> BestTeam | None:
    """Return the best team of more than two robots known for the very same game, or None."""
    data = _shipped("best_teams.json", "teams").get(game_digest(scenario))
    return None if data is None else BestTeam(**data)


def unseen_buildings() -> tuple[str, ...]:
    """Return the names of the unseen buildings that the benchmark has."""
    return tuple(shipped_json(UNSEEN)["buildings"])


def known_optimum(scenario: Scenario) -> Optimum:
    """Return the joint optimum, or its bound; shipped where it takes long to compute."""
    value = _shipped(UNSEEN, "buildings").get(game_digest(scenario), {}).get("optimum")
    if value is None:
        return joint_optimum(scenario)
    return Optimum(value, True, len(scenario.map.cells) ** len(scenario.robots))


def known_top(scenario: Scenario) -> float | None:
    """Return the value at the top of a benchmark's gap; None if unknown.

    Of two robots that is the best asking team found, of more an upper bound.
    """
    team = shipped_asking_team(scenario)
    if team is not None:
        return team.value
    bound = _shipped("bounds.json", "bounds").get(game_digest(scenario))
    return None if bound is None else float(bound["value"])


@cache
def _shipped(file: str, key: str) -> dict[str, dict[str, Any]]:
    """Return the entries of a shipped file, by the digest of the game."""
    return {data["game"]: data for data in shipped_json(file).get(key, {}).values()}


LEARNED_TEAM = "best learned team"
"""What a shipped `BestTeam` is; its value is one of trials."""

BOUND = "bound (robots alone)"
"""What the joint optimum is where it is not exact."""


def yardsticks(scenario: Scenario) -> list[tuple[str, float]]:
    """Return name and total discounted reward of each team or bound that is known, best last."""
    optimum = known_optimum(scenario)
    last = BOUND
    if optimum.exact:
        last = "exact joint optimum"
    known = {
        "best asking team found": shipped_asking_team(scenario),
        LEARNED_TEAM: shipped_best_team(scenario),
        last: optimum,
    }
    return [(name, team.value) for name, team in known.items() if team is not None]
