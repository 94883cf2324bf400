# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Success of percepts in a run, by the perception model and the links of the robots."""

import functools

from sparse_coord_ros.core.game.links import DOWN_DRAW, UP, link_of
from sparse_coord_ros.core.game.perception import sight_of, succeeds
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.sight import Sight, probability
from sparse_coord_ros.core.game.specs import Spec
from sparse_coord_ros.core.game.streams import LEARNING, PERCEPT, Stream


def sight_in(scenario: Scenario) -> Sight:
    """Return the probabilities that percepts of a scenario succeed."""
    sight = sight_of(scenario.perception, scenario.map)
    return sight._replace(tells=scenario.link == UP)


NEVER_PERCEIVING = (Spec("never"), Spec("probability", (0.0,)))
"""Perception models by which no percept ever succeeds."""


NEVER_UP = (Spec("dead", (0.0,)), Spec("lost", (1.0,)))
"""Links that never bring an answer."""


def percepts_can_succeed(scenario: Scenario) -> bool:
    """Return whether a percept can succeed at all, as far as the settings alone tell."""
    return scenario.perception not in NEVER_PERCEIVING and scenario.link not in NEVER_UP


def percepts_can_fail(scenario: Scenario) -> bool:
    """Return whether a percept can fail, as far as the settings alone tell."""
    alone = len(scenario.robots) == 1
    return alone or scenario.perception.kind != "always" or scenario.link != UP


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
        seed, phase: as of `Stream`.
    """

    def __init__(self, scenario: Scenario, seed: int, phase: int = LEARNING) -> None:
        self._of = functools.cache(
            lambda k: (
                Stream(seed, k, PERCEPT, phase),
                link_of(scenario.link, seed, k, phase),
            )
        )
        self._sight = sight_of(scenario.perception, scenario.map)

    def draw(self, step: int, asker: int) -> float:
        """Return the draw of a robot's percept: `DOWN_DRAW` while its link is down."""
        stream, link = self._of(asker)
        return DOWN_DRAW if link.down(step) else stream.at(step)[0]

    def sees(self, step: int, asker: int, here: int, there: int) -> bool:
        """Return whether a robot in cell `here` perceives one in cell `there` at a time step."""
        chance = probability(self._sight, here, there)
        return bool(succeeds(self.draw(step, asker), chance))
