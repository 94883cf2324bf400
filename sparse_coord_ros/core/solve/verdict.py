# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The verdict on a learned team: its gains, its losses, and whether it coordinates."""

import math
from typing import NamedTuple

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.percepts import percepts_can_succeed
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.voi import Voi
from sparse_coord_ros.core.runs.measures import Measures
from sparse_coord_ros.core.solve.advice import (
    AVOIDABLE,
    WILL_NOT_PAY,
    WILL_PAY,
    Advice,
    advice,
)
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.core.solve.shipped import yardsticks
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths

SLIGHT = 0.005
"""A loss is slight up to this share of what a robot alone in the world earns."""

ENOUGH = 0.5
"""Coordination counts as learned from this share of the gap on."""

RARE = 0.05
"""COORDINATE per robot and episode below which a team is said not to ask.

Once in twenty episodes changes nothing that a robot does: such asks are leftovers of exploration.
"""

LOSS_ERRORS = 3.0
"""Standard errors by which a team must be worse to be called worse."""

LOST = "lost"
WORSE = "worse"
NEEDLESS = "needless"
IN_VAIN = "in vain"
SILENT = "silent"
LEARNED = "learned"
FAILING = "failing"


class Verdict(NamedTuple):
    """The verdict on a team: one of the words above, and sentences for people."""

    kind: str
    text: str

    @property
    def headline(self) -> str:
        """The first sentence."""
        return self.text.split(". ")[0].rstrip(".") + "."


def verdict_on(scenario: Scenario, learner: Learner, measures: Measures) -> Verdict:
    """Return the verdict: a team beside robots that ignore each other and the best team known.

    Robots that ignore each other take fixed shortest paths and never ask. The gap is what the
    best team known earns beyond that. A team has learned to coordinate if its robots ask and
    it closes at least half of the gap. A team whose robots do not ask may earn more than robots
    that ignore each other, too: by its choice among equally short paths, or by a detour. The text
    says what to try if something is left to win, and what would make asking pay where it is not
    worth its price.

    Args:
        scenario: the problem.
        learner: the learner.
        measures: the value of its team.
    """
    expected = advice(scenario)
    remedy = _remedy(scenario, learner, expected)
    if measures.failed:
        missed = percent(1.0 - measures.mean("arrived"))
        text = f"In {missed} of the episodes some robot did not arrive."
        steps = "Try more steps"
        if not isinstance(learner, Voi) and expected.kind == WILL_PAY:
            steps += ", or --learner voi"
        return Verdict(LOST, f"{text} {steps}.")
    ignoring = shortest_paths(scenario)
    earned = measures.mean("returns")
    without = ignoring.mean("returns")
    slight = SLIGHT * independent_bound(scenario)
    error = math.hypot(measures.error("returns"), ignoring.error("returns"))
    if without - earned > slight + LOSS_ERRORS * error:
        text = (
            f"This team is worse than robots that ignore each other: a robot earns {earned:.2f}, "
            f"on shortest paths without asking {without:.2f}."
        )
        cure = remedy or "Try more steps, or --learner noncoop, which cannot ask."
        return Verdict(WORSE, f"{text} {cure}")
    [(name, best), *_] = yardsticks(scenario)
    gap = best - without
    if gap <= slight:
        text = (
            f"Coordination is not needed here: robots that ignore each other earn "
            f"{without:.2f} each, the {name} {best:.2f}. A robot of this team earns "
            f"{earned:.2f}. {expected.remedy}"
        )
        return Verdict(NEEDLESS, text.rstrip())
    earnings = (
        f"a robot earns {earned:.2f}, robots that ignore each other {without:.2f}"
    )
    if not percepts_can_succeed(scenario):
        return Verdict(IN_VAIN, f"{remedy} In this team {earnings}.")
    if best - earned <= slight:
        remedy = ""
    asks = measures.mean("asks")
    if not learner.asks or asks < RARE:
        why = f"a robot asks {asks:.2g} times an episode"
        if not learner.asks:
            why = f"the learner {learner.label} cannot ask"
        text = (
            f"The team does not coordinate by asking: {why}. In this team {earnings}, "
            f"the {name} {best:.2f}. {expected.text} {remedy}"
        )
        return Verdict(SILENT, text.rstrip())
    gain = earned - without
    closed = percent(gain / gap, whole=True)
    loss = round(best - earned, 2) + 0.0  # which makes -0 a 0
    text = (
        f"{earnings}. This closes {closed} of the gap to the {name} ({best:.2f}; loss "
        f"{loss:.2f}). {_compared(scenario, measures, ignoring)}"
    )
    if gain >= ENOUGH * gap:
        return Verdict(LEARNED, f"The team learned to coordinate: {text}")
    text = f"The team hardly coordinates: {text} {expected.text} {remedy}"
    return Verdict(FAILING, text.rstrip())


def _compared(scenario: Scenario, measures: Measures, ignoring: Measures) -> str:
    """Return miscoordinations beside those of robots that ignore each other.

    With block alone there are no miscoordinations; robots in each other's way lose time.
    """
    taken = measures.mean("time_to_goal")
    steps = f"{taken:.3g} instead of {ignoring.mean('time_to_goal'):.3g}"
    if scenario.interactions.startswith("block"):
        arrive = ""
        if ignoring.failed:
            share = percent(ignoring.mean("arrived"))
            arrive = (
                f" Robots that ignore each other all arrive in {share} of the trials."
            )
        return f"Steps to the goal: {steps}.{arrive}"
    counted = measures.mean("miscoordinations")
    return (
        f"Miscoordinations per episode: {counted:.2g} instead of "
        f"{ignoring.mean('miscoordinations'):.2g}."
    )


def _remedy(scenario: Scenario, learner: Learner, expected: Advice) -> str:
    """Return what to try for a team that earns too little; empty: nothing.

    More steps help Voi only: others settle on not asking (docs/design.md).
    """
    if not percepts_can_succeed(scenario):
        return (
            "Asking cannot help here: no question can be answered (perception "
            f"{scenario.perception})."
        )
    if expected.kind in (WILL_NOT_PAY, AVOIDABLE):
        return ""
    if isinstance(learner, Voi):
        return "Try more steps."
    return "Try --learner voi."
