# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last word on a learned team: what it earns, what it loses, and whether it coordinates."""

from typing import NamedTuple

from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.evaluation import Evaluation
from sparse_coord_ros.learners.factored import Factored
from sparse_coord_ros.learners.learner import Learner
from sparse_coord_ros.solve.exact import ExactEvaluation
from sparse_coord_ros.solve.optimum import independent_bound
from sparse_coord_ros.solve.reference import shortest_path_reference
from sparse_coord_ros.solve.shipped import yardsticks

HARDLY_EVER = 1e-3
"""Share of the trials in which some robot may fail to arrive."""

SLIGHT = 0.005
"""A loss is slight up to this share of what a robot alone in the world earns."""

ENOUGH = 0.5
"""Coordination counts as learned from this share of the gap on."""

SURE = 3.0
"""Standard errors by which a team must be worse to be called worse."""

LOST, WORSE, NEEDLESS, LEARNED, FAILING = "lost", "worse", "needless", "learned", "failing"


def needless(scenario: Scenario) -> bool:
    """Return whether robots that ignore each other lose only slightly.

    They take fixed shortest paths. The loss is that against robots alone in the world.
    """
    alone = independent_bound(scenario)
    return alone - shortest_path_reference(scenario).reward <= SLIGHT * alone


class LastWord(NamedTuple):
    """What became of a team: one of the words above, and sentences for people."""

    kind: str
    text: str


def last_word(
    scenario: Scenario, learner: Learner, found: Evaluation | ExactEvaluation
) -> LastWord:
    """Return what a team earns, beside robots that ignore each other and the best team known.

    Robots that ignore each other take fixed shortest paths and never ask. The gap is what the
    best team known earns more than they. A team has learned to coordinate if it loses slightly
    against the best team known, or closes at least half of the gap.

    Args:
        scenario: the problem.
        learner: who learned.
        found: the value of its team.
    """
    remedy = "more steps"
    if learner.asks and not isinstance(learner, Factored):
        remedy = "--learner factored or more steps"
    missed = 1.0 - found.all_arrived
    if missed > HARDLY_EVER:
        return LastWord(
            LOST, f"In {missed:.1%} of the trials some robot did not arrive. Try {remedy}."
        )
    alone = independent_bound(scenario)
    ignoring = shortest_path_reference(scenario)
    earned = found.reward.mean
    slight = SLIGHT * alone
    if ignoring.reward - earned > slight + SURE * found.reward.standard_error:
        return LastWord(
            WORSE,
            f"This team is worse than robots that ignore each other: a robot earns {earned:.2f}, "
            f"on shortest paths without asking {ignoring.reward:.2f}. Try {remedy}.",
        )
    [(name, best), *_] = yardsticks(scenario)
    gap = best - ignoring.reward
    if gap <= slight:
        return LastWord(
            NEEDLESS,
            f"Coordination is not needed here: robots that ignore each other earn "
            f"{ignoring.reward:.2f} each, the {name} {best:.2f}. A robot of this team earns "
            f"{earned:.2f}.",
        )
    gain = earned - ignoring.reward
    loss = best - earned
    said = (
        f"a robot earns {earned:.2f}, robots that ignore each other {ignoring.reward:.2f}. This "
        f"closes {gain / gap:.0%} of the gap to the {name} ({best:.2f}; loss {loss:.2f}). "
        f"Miscoordinations per episode: {found.miscoordinations.mean:.2g} instead of "
        f"{ignoring.miscoordinations:.2g}."
    )
    if loss <= slight or gain >= ENOUGH * gap:
        return LastWord(LEARNED, f"The team learned to coordinate: {said}")
    return LastWord(FAILING, f"The team hardly coordinates: {said} Try {remedy}.")
