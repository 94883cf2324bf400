# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best team of more than two robots that is known: one that was learned, and its seed.

Teams of more than two robots are too large for the search of the class bound. What is shipped for
them is no bound of anything: it is what the best of many learned teams is worth, found again by
`train` with the same learner, settings and seed.
"""

from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.share import shipped_json
from sparse_coord_ros.solve.class_bound import game_digest


@dataclass(frozen=True)
class BestTeam:
    """The best of many learned teams.

    Attributes:
        value: its mean reward, averaged over the robots.
        standard_error: of the trials.
        trials: trials behind it, other ones than those that it was chosen by.
        teams: how many teams it was chosen from.
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
        """Return what it is, in words."""
        return (
            f"{self.value:.2f} ({self.standard_error:.2f}), best of {self.teams} that learned: "
            f"{self.learner}, {self.steps} steps, seed {self.seed}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def shipped_best_team(scenario: Scenario) -> BestTeam | None:
    """Return the best team that is known for the very same game, or None."""
    return _shipped().get(game_digest(scenario))


@cache
def _shipped() -> dict[str, BestTeam]:
    teams = shipped_json("best_teams.json").get("teams", {})
    return {data["game"]: BestTeam(**data) for data in teams.values()}
