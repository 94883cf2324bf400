# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rules of a scenario in words: what costs how much, and when a question is answered."""

from sparse_coord_ros.core.game.interactions import (
    NOWHERE,
    can_miscoordinate,
    interactions_of,
)
from sparse_coord_ros.core.game.scenario import Scenario

TOGETHER = {
    "": "are in one doorway",
    "anywhere": "are in one cell that is no goal",
    "any_doorway": "are in doorways",
}
"""What robots do that pay r^C together, by the variant of `together`."""

NARROW = {"": "A doorway", "anywhere": "A cell that is no goal"}
"""What holds one robot, by the variant of `block`."""


def rules_in_words(scenario: Scenario) -> str:
    """Return the rules in a few sentences; an answer to every question goes without saying."""
    inter = interactions_of(scenario)
    told = []
    if can_miscoordinate(inter):
        told.append(
            f"If two robots {_miscoordination(scenario)}, {_payment(scenario)}."
        )
    if inter.blocks:
        told.append(f"{NARROW[scenario.kinds['block']]} holds one robot.")
    cost = f"costs {scenario.ask_cost:,g}" if scenario.ask_cost else "is free"
    told.append(f"A question {cost}.")
    told.append(_answers(scenario))
    return " ".join(sentence for sentence in told if sentence)


def _miscoordination(scenario: Scenario) -> str:
    """Return what two robots do that miscoordinate."""
    inter = interactions_of(scenario)
    found = []
    if (inter.places != NOWHERE).any():
        found.append(TOGETHER[scenario.kinds["together"]])
    if inter.swaps:
        found.append("exchange cells")
    return " or ".join(found)


def _payment(scenario: Scenario) -> str:
    """Return what a miscoordination costs whom."""
    price = f"{-scenario.penalty:,g}"
    if scenario.common_reward.kind == "same":
        return f"every robot pays {price}"
    return f"every robot pays its own factor times {price}"


def _answers(scenario: Scenario) -> str:
    """Return when a question is answered; an empty text where that is always."""
    model = scenario.perception
    match model.kind:
        case "always":
            return ""
        case "never":
            return "No question is answered."
        case "probability":
            return f"A question is answered with probability {model.numbers[0]:g}."
        case "range":
            return f"A question is answered within {model.numbers[0]:g} cells."
        case "line_of_sight":
            return "A question is answered where no wall is between the robots."
    return f"A question is answered as {model} says."
