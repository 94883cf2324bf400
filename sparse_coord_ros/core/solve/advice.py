# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Advice, before learning, on whether coordination will pay.

Robots that ignore each other lose something, a team that sees everything wins a part of it back,
and a question costs something. How many questions the gain pays for says how much robots will ask,
and what they will gain by asking (docs/when.md has the measurements behind the thresholds).
"""

import math
from typing import NamedTuple

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.interactions import (
    can_miscoordinate,
    interactions_of,
)
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

LARGER_PENALTIES = (-50.0, -100.0, -200.0, -500.0, -1000.0)
"""Those that are tried where asking is not worth its price."""

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
        text: sentences for people, with the remedy.
        remedy: a sentence on what would make asking pay; empty: it pays, or nothing would.
    """

    kind: str
    loss: float
    ratio: float
    gain: float
    text: str
    remedy: str


def advice(scenario: Scenario) -> Advice:
    """Return whether coordination will pay."""
    loss = loss_of_ignoring(scenario)
    ratio = in_questions(loss, scenario)
    optimum = known_optimum(scenario)
    gain = _gain(scenario, loss)
    kind = _kind(scenario, loss, gain)
    if len(scenario.robots) == 1:
        alone = "With one robot there is nobody to ask."
        return Advice(kind, loss, ratio, gain, alone, "")
    facts = f"a robot alone in the world earns {independent_bound(scenario):.2f}"
    if loss == 0.0:
        facts += "; robots that ignore each other earn as much"
    else:
        facts += f"; robots that ignore each other lose {loss:.2f} of it each"
        if optimum.exact:
            facts += f"; a team can win back {gain:.2f} of that"
        facts += f", {_cost_in_words(in_questions(gain, scenario))}"
        facts += _answers_in_words(scenario)
    remedy = _remedy(scenario, kind, loss, gain)
    text = f"{SENTENCES[kind]}: {facts}. {remedy}".rstrip()
    return Advice(kind, loss, ratio, gain, text, remedy)


def _gain(scenario: Scenario, loss: float) -> float:
    """Return how much of the loss the joint optimum, or its bound, wins back."""
    best = known_optimum(scenario).value
    return _positive(loss - independent_bound(scenario) + best, scenario)


def _kind(scenario: Scenario, loss: float, gain: float) -> str:
    """Return one of the words above."""
    gain_in_costs = relative_gain(gain, scenario)
    if gain_in_costs < LEAST_RELATIVE_GAIN:
        return WILL_NOT_PAY
    if known_optimum(scenario).exact and is_avoidable(loss, gain):
        return AVOIDABLE
    if gain_in_costs < _sure(scenario):
        return MAY_PAY
    return WILL_PAY


def _sure(scenario: Scenario) -> float:
    """Return the relative gain from which on asking will pay."""
    if known_optimum(scenario).exact:
        return SURE_RELATIVE_GAIN
    return SURE_RELATIVE_GAIN_BY_BOUND


def _remedy(scenario: Scenario, kind: str, loss: float, gain: float) -> str:
    """Return a sentence on what would make asking pay; empty: it pays, or nothing would."""
    if kind not in (WILL_NOT_PAY, MAY_PAY) or loss == 0.0:
        return ""
    chance = chance_of_answer(scenario)
    if chance == 0.0:
        return (
            "Asking needs a perception model that answers, such as perception=always."
        )
    cost = math.floor(100 * gain * chance**2 / _sure(scenario)) / 100
    ways = []
    penalty = _sufficient_penalty(scenario)
    if penalty is not None:
        ways.append(f"at a penalty of {penalty:g}")
    if cost > 0.0:
        ways.append(f"if a question costs at most {cost:g}")
    if chance < 1.0 and in_questions(gain, scenario) >= _sure(scenario):
        ways.append("if more questions are answered")
    if not ways:
        return ""
    return f"It will pay {', or '.join(ways)}."


def _sufficient_penalty(scenario: Scenario) -> float | None:
    """Return the smallest of some larger penalties at which asking will pay; None: unknown."""
    costs = can_miscoordinate(interactions_of(scenario))
    if not costs or not known_optimum(scenario).exact:
        return None
    for penalty in LARGER_PENALTIES:
        if penalty < scenario.penalty:
            dearer = scenario.changed({"penalty": penalty})
            loss = loss_of_ignoring(dearer)
            if _kind(dearer, loss, _gain(dearer, loss)) == WILL_PAY:
                return penalty
    return None


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


def _answers_in_words(scenario: Scenario) -> str:
    """Return how many questions are answered, where not all of them are."""
    chance = chance_of_answer(scenario)
    if chance == 0.0:
        return f"; but no question is answered (perception {scenario.perception})"
    if chance == 1.0:
        return ""
    return f"; but only {percent(chance, whole=True)} of the questions are answered"


def _cost_in_words(questions: float) -> str:
    if math.isinf(questions):
        return "and questions are free"
    return f"as much as {questions:,.1f} questions cost"
