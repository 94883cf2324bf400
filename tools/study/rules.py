# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners with one part of their rule turned off, or with another number in it."""

from typing import Any

from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.factored import Factored
from sparse_coord_ros.core.learners.hysteretic import Hysteretic
from sparse_coord_ros.core.learners.rules import Task, Transition, greatest


class NoPerceptUpdate(Factored):
    """Learns r_bar from its own moves alone."""

    @staticmethod
    def update_by_percept(mind, task, cell, floor):
        """Correct nothing."""


class NoReplay(Factored):
    """Does not learn from its own model."""

    @staticmethod
    def replay(mind, task, now):
        """Replay nothing."""


class NoLookingBack(Factored):
    """Does not learn the results of moves that it did not make."""

    @staticmethod
    def look_back(mind, task, now):
        """Learn nothing."""


class NoExchanges(Factored):
    """Takes all r^C for that of a cell, none for that of an exchange."""

    @staticmethod
    def came_from(mind: Any, task: Task, now: Transition, y: int) -> bool:
        """Return whether the robot exchanged cells: never."""
        return False


class NoStops(Factored):
    """Takes stops for slips."""

    @staticmethod
    def was_stopped(mind: Any, task: Task, now: Transition) -> bool:
        """Return whether a peer stopped the robot: never."""
        return False


class OneStep(Factored):
    """Counts a stop as the step that it costs near the goal."""

    @staticmethod
    def loss_of_stop(mind: Any, task: Task) -> float:
        """Return what arrival loses in a step."""
        arrival: float = task.goal_reward + task.discount * task.goal_value
        return (1.0 - task.discount) * arrival


class NoWayOut(Factored):
    """Leaves no stand-off."""

    def leaves_stand_offs(self, scenario: Scenario) -> bool:
        """Return whether its robots leave stand-offs: never."""
        return False


class WholeSurplus(Factored):
    """Each peer in the way is credited with all that waiting brings."""

    @staticmethod
    def share_of_surplus(mind: Any, task: Task, first: int, here: float) -> float:
        """Return the gain of waiting at the first question."""
        return here


class NoLeastWorth(Factored):
    """The values of a cell may fall to 0 in larger teams, too."""

    @staticmethod
    def cell_value(mind: Any, task: Task, cell: int) -> float:
        """Return max_b Q*(cell, b)."""
        return greatest(mind.q_star[cell], len(ACTIONS))


class NoCures(NoLeastWorth):
    """Without all three rules, as larger teams once learned."""

    leaves_stand_offs = NoWayOut.leaves_stand_offs

    share_of_surplus = staticmethod(WholeSurplus.share_of_surplus)


class Tenth(Hysteretic):
    """Learns bad news by a tenth of the step size."""

    @staticmethod
    def share_of_alpha(mind: Any, task: Task) -> float:
        """Return beta / alpha."""
        return 0.1


class Third(Hysteretic):
    """Learns bad news by three tenths of the step size."""

    @staticmethod
    def share_of_alpha(mind: Any, task: Task) -> float:
        """Return beta / alpha."""
        return 0.3


class Half(Hysteretic):
    """Learns bad news by half of the step size."""

    @staticmethod
    def share_of_alpha(mind: Any, task: Task) -> float:
        """Return beta / alpha."""
        return 0.5
