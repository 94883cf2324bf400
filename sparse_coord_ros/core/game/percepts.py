# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Success of percepts in a run, by the perception model."""

from sparse_coord_ros.core.game.draws import (
    ENVIRONMENT,
    LEARNING,
    PERCEPT,
    draw,
    keys_of,
)
from sparse_coord_ros.core.game.perception import sight_of
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.sight import probability
from sparse_coord_ros.core.game.specs import Spec

NEVER_PERCEIVING = (Spec("never"), Spec("probability", (0.0,)))
"""Perception models by which no percept ever succeeds."""


def percepts_can_succeed(scenario: Scenario) -> bool:
    """Return whether a percept can succeed at all, as far as the settings alone tell."""
    return scenario.perception not in NEVER_PERCEIVING


def chance_of_answer(scenario: Scenario) -> float:
    """Return the probability that a question is answered, as far as the settings alone tell.

    It is 1 if that depends on places: robots then ask where they are near each other.
    """
    if not percepts_can_succeed(scenario):
        return 0.0
    if scenario.perception.kind == "probability":
        return float(scenario.perception.numbers[0])
    return 1.0


class Percepts:
    """Active perception in a run: decides which percepts succeed.

    Args:
        scenario: the problem.
        seed: the run's seed.
        phase: LEARNING or EVALUATION.
    """

    def __init__(self, scenario: Scenario, seed: int, phase: int = LEARNING) -> None:
        keys = keys_of(seed, phase, len(scenario.robots))
        self._keys = keys[ENVIRONMENT].tolist()
        self._sight = sight_of(scenario.perception, scenario.map)

    def sees(self, step: int, asker: int, here: int, there: int) -> bool:
        """Return whether a robot in cell `here` perceives one in cell `there` at a time step."""
        chance = draw(self._keys[asker], step, PERCEPT)
        return bool(chance < probability(self._sight, here, there))
