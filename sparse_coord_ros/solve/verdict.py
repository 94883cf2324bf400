# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last word on a learned team: whether it has learned to coordinate, and whether it had to."""

from typing import NamedTuple

from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.evaluation import Evaluation
from sparse_coord_ros.learn.learners import Learner
from sparse_coord_ros.solve.exact import ExactEvaluation
from sparse_coord_ros.solve.optimum import independent_bound
from sparse_coord_ros.solve.reference import shortest_path_reference
from sparse_coord_ros.solve.shipped import known_best, known_optimum

HARDLY_EVER = 1e-3
"""Share of the trials in which some robot may fail to arrive."""

NO_MATTER = 0.005
"""Share of its worth alone that a robot may lose without anything to coordinate."""

ENOUGH = 0.5
"""Share of what coordination can gain from which on it counts as learned."""

LOST, NEEDLESS, LEARNED, FAILING = "lost", "needless", "learned", "failing"


def needless(scenario: Scenario) -> bool:
    """Return whether robots on shortest paths that mind nobody do as well as each one alone."""
    return _hardly_less(shortest_path_reference(scenario).reward, independent_bound(scenario))


def _hardly_less(blind: float, alone: float) -> bool:
    return alone - blind <= NO_MATTER * alone


class LastWord(NamedTuple):
    """What became of a team: one of the words above, and sentences for people."""

    kind: str
    text: str


def last_word(
    scenario: Scenario, learner: Learner, found: Evaluation | ExactEvaluation
) -> LastWord:
    """Return whether a team has learned to coordinate, and what that is worth.

    The yardstick is a team on fixed shortest paths that minds nobody and never asks.

    Args:
        scenario: the problem.
        learner: who learned.
        found: the value of its team.
    """
    alone, blind = independent_bound(scenario), shortest_path_reference(scenario)
    worth, missed = found.reward.mean, 1.0 - found.all_arrived
    better = learner.asks and not learner.factors
    remedy = "--learner factored or more steps" if better else "more steps"
    if missed > HARDLY_EVER:
        return LastWord(
            LOST, f"In {missed:.1%} of the trials some robot did not arrive. Try {remedy}."
        )
    if _hardly_less(blind.reward, alone):
        return LastWord(
            NEEDLESS,
            "Coordination is not needed here: robots that take shortest paths and never ask are "
            f"worth {blind.reward:.2f} each, robots alone in the world {alone:.2f}.",
        )
    left = f"{found.miscoordinations.mean:.2g} miscoordinations an episode"
    best = known_best(scenario) or known_optimum(scenario).value
    if worth - blind.reward >= ENOUGH * (best - blind.reward):
        return LastWord(
            LEARNED,
            f"Coordination was learned: it is worth {worth - blind.reward:.2f} a robot against "
            f"shortest paths without asking, with {left} instead of "
            f"{blind.miscoordinations:.2g}.",
        )
    return LastWord(
        FAILING,
        f"Coordination is failing: {left} are left ({blind.miscoordinations:.2g} on shortest "
        f"paths without asking), and a robot is worth {worth:.2f} of up to {best:.2f}. Try "
        f"{remedy}.",
    )
