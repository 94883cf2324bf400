# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Advice, before learning, on whether coordination will pay.

Robots that ignore each other lose something, a team that sees everything wins a part of it back,
and a question costs something. How many questions the gain pays for says how much robots will ask,
and what they will gain by asking (docs/when.md has the measurements behind the thresholds).
"""

import math
from typing import NamedTuple

from sparse_coord_ros.core.game.percepts import chance_of_answer
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths

WILL_PAY = "will pay"
MAY_PAY = "may pay"
WILL_NOT_PAY = "will not pay"
AVOIDABLE = "avoidable"
"""Asking will not pay, as robots can keep out of each other's way for nothing."""

SENTENCES = {
    WILL_PAY: "Coordination will pay",
    MAY_PAY: "Coordination may pay",
    WILL_NOT_PAY: "Asking will not pay",
    AVOIDABLE: "Asking will not pay, because robots can choose paths that do not meet",
}

LEAST_RELATIVE_GAIN = 1.0
"""Below this relative gain a question costs more than the whole gain, and robots hardly ask. They
may still win a part of the gain by their choice of ways."""

SURE_RELATIVE_GAIN = 3.0
"""From this relative gain on, nearly every pair closes at least half of the gap to the joint
optimum."""

SURE_RELATIVE_GAIN_BY_BOUND = 30.0
"""The same if only a bound of the joint optimum is known, as for larger teams."""

FREE = 0.001
"""Robots can avoid each other for nothing if that costs at most this share of the loss."""

NOTHING = 1e-9
"""A loss up to this share of the value of a robot alone is rounding."""


class Advice(NamedTuple):
    """Facts about coordination in a scenario, known without learning.

    Attributes:
        kind: one of the words above.
        loss: loss of a robot if the robots ignore each other: see `loss_of_ignoring`.
        ratio: the loss in questions: so many cost as much. Infinite where questions are free.
        gain: at most so much of the loss a team can win back: up to the joint optimum, or to
            robots alone in the world where the optimum is not known.
        text: a sentence for people.
    """

    kind: str
    loss: float
    ratio: float
    gain: float
    text: str


def advice(scenario: Scenario) -> Advice:
    """Return whether coordination will pay."""
    loss = loss_of_ignoring(scenario)
    ratio = in_questions(loss, scenario)
    optimum = known_optimum(scenario)
    gain = _positive(loss - independent_bound(scenario) + optimum.value, scenario)
    sure = SURE_RELATIVE_GAIN if optimum.exact else SURE_RELATIVE_GAIN_BY_BOUND
    kind = _kind_of(relative_gain(gain, scenario), sure)
    if kind != WILL_NOT_PAY and optimum.exact and is_avoidable(loss, gain):
        kind = AVOIDABLE
    if len(scenario.robots) == 1:
        return Advice(kind, loss, ratio, gain, "With one robot there is nobody to ask.")
    facts = f"a robot alone in the world earns {independent_bound(scenario):.2f}"
    if loss == 0.0:
        facts += "; robots that ignore each other earn as much"
    else:
        facts += f"; robots that ignore each other lose {loss:.2f} of it each"
        if optimum.exact:
            facts += f"; a team can win back {gain:.2f} of that"
        facts += f", {_cost_in_words(in_questions(gain, scenario))}"
    return Advice(kind, loss, ratio, gain, f"{SENTENCES[kind]}: {facts}.")


def _kind_of(gain_in_costs: float, sure: float) -> str:
    """Return whether coordination will pay.

    Args:
        gain_in_costs: the gain, as of `relative_gain`.
        sure: from which on it will pay.
    """
    if gain_in_costs < LEAST_RELATIVE_GAIN:
        return WILL_NOT_PAY
    if gain_in_costs < sure:
        return MAY_PAY
    return WILL_PAY


def loss_of_ignoring(scenario: Scenario) -> float:
    """Return the loss of a robot if all take shortest paths and ignore each other.

    It is the value of a robot alone in the world less that of a robot of such a team: total
    discounted reward from the starts, averaged over the robots.
    """
    alone = independent_bound(scenario)
    return _positive(alone - shortest_paths(scenario).mean("returns"), scenario)


def _positive(value: float, scenario: Scenario) -> float:
    """Return a difference of two values, 0 where it is rounding."""
    return value if value > NOTHING * independent_bound(scenario) else 0.0


def in_questions(value: float, scenario: Scenario) -> float:
    """Return how many questions cost as much; infinite where questions are free."""
    if value == 0.0 or scenario.ask_cost > 0.0:
        return value / (scenario.ask_cost or 1.0)
    return math.inf


def relative_gain(gain: float, scenario: Scenario) -> float:
    """Return a gain in units of a question's cost, corrected for failed questions.

    Two robots see each other if both are answered: the chance of an answer counts twice.
    """
    chance = chance_of_answer(scenario)
    if chance == 0.0:
        return 0.0
    return in_questions(gain, scenario) * chance**2


def is_avoidable(loss: float, gain: float) -> bool:
    """Return whether robots can avoid each other at no cost.

    Args:
        loss: loss of a robot if the robots ignore each other.
        gain: the part of the loss that the joint optimum regains.
    """
    return loss - gain <= FREE * loss


def _cost_in_words(questions: float) -> str:
    if math.isinf(questions):
        return "and questions are free"
    return f"as much as {questions:,.1f} questions cost"
