# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a learner is: a class with static methods that read and write one robot's mind.

The methods run on lists in a robot node and in plain Python, and on arrays in the compiled loops:
they may index (`mind.q_star[cell][b]`), compute and call functions marked by `compiling.inner`,
and make nothing. A learner of one's own overrides one of them or more; a memory of its own is an
entry of `memory`. See examples/own_learner.py and docs/tutorials/own_learner.md.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.world import RewardWeights
from sparse_coord_ros.learners.mind import mind_class
from sparse_coord_ros.learners.rules import Task, Transition

Made = Callable[[Scenario, int], np.ndarray]
"""Makes an array of a mind before learning, of a scenario and a robot (from 0)."""


class Learner:
    """One learner: its names, what it needs, and how its robots choose and learn.

    Attributes:
        name: what it is called where learners are named, once it is registered.
        title: what it is called in print; empty: its label.
        summary: one line: what it is.
        asks: whether COORDINATE is among its actions; if not, the fifth column of Q* is NaN.
        alone: whether each robot learns with no other robot in the world (Indiv. of Section 4).
            Such a learner cannot run live.
        sees_all: whether its robots see all others in every step, asked or not. Such a learner
            cannot run live either.
        draws: whether it wants a random number in each step (`Transition.draw`).
        defaults: values of scenario settings where neither the scenario nor the user chose one;
            `run.yaml` says each value that held.
        Mind: the named tuple of what a robot remembers; `initial` fills it.
        memory: further fields of it, each with what makes its array before learning.
        given: fields that `initial` computes again: they are no part of files and logs.
        scratch: fields that mean nothing between two calls; likewise.
    """

    name: str | None = None
    title: str = ""
    summary: str = ""
    asks: bool = True
    alone: bool = False
    sees_all: bool = False
    draws: bool = False
    defaults: Mapping[str, object] = MappingProxyType({})
    Mind: type[Any]
    memory: Mapping[str, Made] = MappingProxyType({})
    given: tuple[str, ...] = ()
    scratch: tuple[str, ...] = ()

    def __init_subclass__(cls, **more: object) -> None:
        """Give the class its own names, and the class of its minds."""
        super().__init_subclass__(**more)
        for attribute in ("name", "title", "summary"):
            if attribute not in vars(cls):
                setattr(cls, attribute, getattr(Learner, attribute))
        own = vars(cls).get("memory", {})
        cls.Mind = mind_class(cls, (*cls.Mind._fields, *own))

    # One robot.

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Any:
        """Return a robot's mind (from 0) before learning, as arrays (Algorithm 1, line 1)."""
        raise NotImplementedError

    @staticmethod
    def begin_episode(mind: Any, task: Task) -> None:
        """Begin an episode."""

    @staticmethod
    def asking_values(
        mind: Any, task: Task, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values by which COORDINATE chooses a move (Algorithm 1, lines 6 to 10).

        Args:
            mind: what the robot remembers.
            task: what it knows of its task.
            cell: X_k(t).
            seen: the peers that are perceived, the sum of 2^j; 0: the percept failed.
            cells: the cells of all robots; those of peers that are not seen mean nothing.
            values: set [move].
        """
        raise NotImplementedError

    @staticmethod
    def explores(mind: Any, task: Task, seen: int) -> bool:
        """Return whether the move after COORDINATE is explored as any other: in the paper never."""
        return False

    @staticmethod
    def bootstrap(mind: Any, task: Task, cell: int, now: Transition) -> float:
        """Return what is expected from a cell on that is not the goal."""
        raise NotImplementedError

    @staticmethod
    def learn(mind: Any, task: Task, now: Transition) -> None:
        """Learn from a transition (Algorithm 1, lines 12 to 14 and 18)."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        return self.name or type(self).__qualname__

    # A team.

    def with_defaults(self, scenario: Scenario) -> Scenario:
        """Return the scenario with this learner's defaults for settings that nobody chose.

        Raises:
            SettingError: a default is no setting, or has a bad value.
        """
        values = {k: v for k, v in self.defaults.items() if k not in scenario.given}
        if not values:
            return scenario
        return replace(scenario.with_settings(values), given=scenario.given)

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` where it cannot learn a scenario; called before a run begins."""

    def weights(self, scenario: Scenario) -> RewardWeights:
        """Return how much each part of R_k(t) counts while it learns.

        Unless changed it is their sum, with r^C as often as the setting `credit` says.
        """
        return RewardWeights(1.0, scenario.common_weight, 1.0)

    def minds(self, scenario: Scenario) -> list[Any]:
        """Return the minds of all robots before learning, as arrays, with their own memory."""
        return [self.mind(scenario, k) for k in range(len(scenario.robots))]

    def mind(self, scenario: Scenario, robot: int) -> Any:
        """Return a robot's mind (from 0) before learning, as arrays, with its own memory."""
        base = type(self).initial(scenario, robot)
        more = {}
        for one in reversed(type(self).__mro__):
            for name, make in vars(one).get("memory", {}).items():
                more[name] = np.asarray(make(scenario, robot))
        return self.Mind(**base._asdict(), **more)
