# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The base class of learners: its static methods read and write one robot's mind.

The methods run on lists in a robot node and in plain Python, and on arrays in the compiled loops:
they may index (`mind.q_star[cell][b]`), compute and call functions marked by `compiling.inner`,
and create no objects. A user's own learner overrides one or more of them; further memory is
declared in `memory`. See examples/own_learner.py and docs/tutorials/own_learner.md.
"""

import functools
import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from sparse_coord_ros.base.compiling import inner
from sparse_coord_ros.base.errors import SettingError, in_short
from sparse_coord_ros.core.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.core.game.interactions import interactions_of
from sparse_coord_ros.core.game.perception import sight_of
from sparse_coord_ros.core.game.plugins import failing_as, is_shipped, path_of
from sparse_coord_ros.core.game.scenario import INITIAL_VALUES, SETTINGS, Scenario
from sparse_coord_ros.core.game.sight import BLIND
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.lone import known_q_star
from sparse_coord_ros.core.learners.mind import Memory, mind_class
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    map_samples,
    replays_of,
)

MemoryMaker = Callable[[Scenario, int], np.ndarray]
"""Makes an array of a mind before learning, of a scenario and a robot (from 0)."""


def _guarded(
    method: Callable[..., Any], name: str, check: Callable[[str, Any], Any]
) -> Callable[..., Any]:
    """Return a method of a user's own learner that reports its failures in one line.

    Args:
        method: the method.
        name: its name.
        check: returns what the method returned, or raises `SettingError`.
    """

    @functools.wraps(method)
    def guarded(self: "Learner", *args: Any, **more: Any) -> Any:
        with self.blamed(f"making its {name}"):
            return check(f"learner {self.label!r}", method(self, *args, **more))

    return guarded


def _checked_scenario(said: str, made: Any) -> Any:
    if not isinstance(made, Scenario):
        raise SettingError(
            f"{said}: its with_defaults returned {in_short(made)}, allowed: a Scenario"
        )
    return made


def _checked_weights(said: str, made: Any) -> Any:
    with suppress(TypeError, ValueError):
        weights = RewardWeights(*map(float, made))
        if all(map(math.isfinite, weights)):
            return weights
    allowed = "three numbers, for the individual reward, the common reward and the cost of asking"
    raise SettingError(f"{said}: its weights are {made!r}, allowed: {allowed}")


def _anything(said: str, made: Any) -> Any:
    return made


CHECKS: Mapping[str, Callable[[str, Any], Any]] = {
    "with_defaults": _checked_scenario,
    "check": _anything,
    "weights": _checked_weights,
}
"""The methods of a learner of one's own that are checked."""


class Learner:
    """One learner: its names, what it needs, and how its robots choose and learn.

    Attributes:
        name: its name for users, once it is registered.
        title: its name in print; empty: its label.
        summary: its description, one line.
        asks: whether COORDINATE is among its actions; if not, the fifth column of Q* is NaN.
        alone: whether each robot learns with no other robot in the world (Indiv. of Section 4).
            Such a learner cannot run live.
        sees_all: whether its robots see all others in every step, asked or not. Such a learner
            cannot run live either.
        draws: whether it needs a random number in each step (`Transition.draw`).
        partners: whether it uses the peers with which a robot interacted
            (`Transition.partners`).
        rules_out: whether it uses `Task.sight` to rule out cells of a peer after a failed percept.
        needs_map: whether it always begins with the values of robots alone: `prior` is `map`.
        defaults: values of scenario settings that neither the scenario nor the user chose;
            `run.yaml` records each value used.
        Mind: the named tuple of a robot's memory; `initial` fills it.
        memory: further fields of it, each with a function that makes its array before learning.
        values: fields with learned values, without counts; another run can begin with them.
        given: fields that `initial` computes again; files and logs leave them out.
        scratch: fields without meaning between two calls; likewise left out.
        entry_point: its name as an entry point of an installed package, or None. The registry
        sets it.
    """

    name: str | None = None
    title: str = ""
    summary: str = ""
    asks: bool = True
    alone: bool = False
    sees_all: bool = False
    draws: bool = False
    partners: bool = False
    rules_out: bool = False
    needs_map: bool = False
    defaults: Mapping[str, object] = MappingProxyType({})
    Mind: type[Any]
    memory: Mapping[str, MemoryMaker] = MappingProxyType({})
    values: tuple[str, ...] = ("q_star", "q_coord")
    given: tuple[str, ...] = ()
    scratch: tuple[str, ...] = ()
    entry_point: str | None = None

    def __init_subclass__(cls, **more: object) -> None:
        """Give the class its names and its class of minds."""
        super().__init_subclass__(**more)
        for attribute in ("name", "title", "summary"):
            if attribute not in vars(cls):
                setattr(cls, attribute, getattr(Learner, attribute))
        own = [name for name in vars(cls).get("memory", {}) if cls._is_new(name)]
        functions = [one for one in vars(cls).values() if isinstance(one, staticmethod)]
        for function in functions:  # so that those of a subclass can call it
            inner(function.__func__)
        if own or functions:  # else compiled loops of its base class are its own, too
            cls.Mind = mind_class(cls, (*cls.Mind._fields, *own))
        if not is_shipped(cls):
            for name, check in CHECKS.items():
                if name in vars(cls):
                    setattr(cls, name, _guarded(vars(cls)[name], name, check))

    @classmethod
    def _is_new(cls, name: str) -> bool:
        """Return whether a name of `memory` is a new field; a base class may have named it, too.

        Raises:
            TypeError: it is the name of a field of another kind.
        """
        if name not in cls.Mind._fields:
            return True
        if any(name in vars(one).get("memory", {}) for one in cls.__mro__[1:]):
            return False
        raise TypeError(
            f"class {cls.__name__}: memory {name!r} is the name of another table of its base "
            "class; choose another name"
        )

    @property
    def own_memory(self) -> Mapping[str, MemoryMaker]:
        """The fields that the class and its base classes add to the mind by `memory`."""
        found: dict[str, MemoryMaker] = {}
        for one in reversed(type(self).__mro__):
            found |= vars(one).get("memory", {})
        return found

    # One robot.

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Any:
        """Return a robot's mind (from 0) before learning, as arrays (Algorithm 1, line 1)."""
        raise NotImplementedError

    @staticmethod
    def informed(
        mind: Any, scenario: Scenario, robot: int, weights: RewardWeights
    ) -> Any:
        """Return the mind, before learning, of a robot that knows its map (`prior: map`).

        Unless changed Q* begins at the values of a robot alone.

        Args:
            mind: what `initial` returned.
            scenario: the problem.
            robot: the robot, from 0.
            weights: how much each part of a reward counts.
        """
        return mind._replace(q_star=known_q_star(scenario, robot, weights, mind.q_star))

    @staticmethod
    def begin_episode(mind: Any, task: Task) -> None:
        """Begin an episode."""

    @staticmethod
    def asking_values(
        mind: Any, task: Task, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values by which COORDINATE chooses a move (Algorithm 1, lines 6 to 10).

        Args:
            mind: the robot's mind.
            task: its task.
            cell: X_k(t).
            seen: the peers that are perceived, the sum of 2^j; 0: the percept failed.
            cells: the cells of all robots; those of peers that are not seen mean nothing.
            values: set [move].
        """
        raise NotImplementedError

    @staticmethod
    def explores(mind: Any, task: Task, seen: int) -> bool:
        """Return whether the move after COORDINATE is explored, too: in the paper never."""
        return False

    @staticmethod
    def way_out(
        mind: Any,
        task: Task,
        step: int,
        cell: int,
        seen: int,
        cells: Any,
        values: Any,
        move: int,
    ) -> int:
        """Return the move by which the robot may leave a stand-off; `move`: it is in none.

        It is called where `leaves_stand_offs`, in the paper never.

        Args:
            mind: the robot's mind.
            task: its task.
            step: the time step t, in which it asks.
            cell: X_k(t).
            seen: the peers that are perceived, the sum of 2^j; 0: the percept failed.
            cells: the cells of all robots; those of peers that are not seen mean nothing.
            values: of the moves, as of `asking_values`.
            move: the best move.
        """
        return move

    @staticmethod
    def bootstrap(mind: Any, task: Task, cell: int, now: Transition) -> float:
        """Return the expected return from a cell that is not the goal."""
        raise NotImplementedError

    @staticmethod
    def learn(mind: Any, task: Task, now: Transition) -> None:
        """Learn from a transition (Algorithm 1, lines 12 to 14 and 18)."""
        raise NotImplementedError

    # Its name.

    @property
    def label(self) -> str:
        """Its name in files, by which other processes find it.

        The name of a learner of this package, or of one that an installed package registers as an
        entry point; else `module:Class`; else its name, under which each process must register it.

        Raises:
            SettingError: it has no such name.
        """
        if is_shipped(self):
            label = self.name
        elif self.entry_point is not None:
            label = self.entry_point
        # others could make one of its class, and not with these attributes
        elif vars(self):
            label = self.name
        else:
            label = path_of(type(self)) or self.name
        if label is None:
            raise SettingError(
                f"learner {type(self).__qualname__}: other processes cannot find it; define its "
                "class in a module (a file), or give it an attribute 'name' and register it"
            )
        return label

    @property
    def runs_live(self) -> bool:
        """True if its robots learn together and each for itself, as nodes do."""
        return not (self.alone or self.sees_all)

    def __repr__(self) -> str:
        """Return the learner's name in files."""
        return f"<learner {self.label}>"

    # A team.

    def with_defaults(self, scenario: Scenario) -> Scenario:
        """Return the scenario with this learner's defaults for settings that were not chosen.

        Initial values are the defaults where it needs the map: they have no meaning there.

        Raises:
            SettingError: a default is no setting, or has a bad value.
        """
        values = {k: v for k, v in self.defaults.items() if k not in scenario.given}
        if self.needs_map and "prior" not in scenario.given:
            values["prior"] = "map"
        if self.needs_map:
            values |= {name: SETTINGS[name].default for name in INITIAL_VALUES}
        if not values:
            return scenario
        return replace(scenario.with_settings(values), given=scenario.given)

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` if it cannot learn a scenario; called before a run begins."""
        if self.needs_map and scenario.prior != "map":
            raise SettingError(
                f"setting prior: value is {scenario.prior!r}, allowed with learner {self.label}: "
                "map, as it begins with the values of robots alone; leave prior out"
            )
        success = scenario.prior_success
        if scenario.prior == "none" and success != SETTINGS["prior_success"].default:
            raise SettingError(
                f"setting prior_success: value is {success:g}, allowed with prior=none: 0, "
                "as robots know nothing of their map then; set prior=map, or leave "
                "prior_success out"
            )

    def leaves_stand_offs(self, scenario: Scenario) -> bool:
        """Return whether its robots leave stand-offs, by `way_out`."""
        return False

    def check_memory(self, scenario: Scenario, robot: int, memory: Memory) -> None:
        """Raise `ValueError` where a robot (from 0) of another scenario learned this memory.

        Types and shapes are right already.
        """

    def rows_of_a_cell(self, scenario: Scenario) -> int:
        """Return the largest number of rows that depend on peers, for each own cell."""
        return int(len(scenario.map.cells) ** (scenario.perceived - 1))

    def weights(self, scenario: Scenario) -> RewardWeights:
        """Return how much each part of R_k(t) counts while it learns.

        Unless changed it is their sum, with r^C as often as the setting `credit` says.
        """
        return RewardWeights(1.0, scenario.common_weight, 1.0)

    def task(self, scenario: Scenario, robot: int, step_sizes: Any = ()) -> Task:
        """Return the task of a robot (from 0).

        Args:
            scenario: the problem.
            robot: the robot.
            step_sizes: as of `Task`; empty for a robot that does not learn.
        """
        weights = self.weights(scenario)
        inter = interactions_of(scenario)
        sight = BLIND
        if self.rules_out:
            sight = sight_of(scenario.perception, scenario.map)
        return Task(
            number=robot,
            robots=len(scenario.robots),
            cells=len(scenario.map.cells),
            goal=scenario.robots[robot].goal,
            actions=len(ACTIONS) if self.asks else PRIMITIVES,
            discount=scenario.discount,
            goal_value=scenario.goal_value,
            goal_reward=weights.individual * scenario.goal_reward,
            ask_cost=weights.ask_cost * scenario.ask_cost,
            credit=weights.common,
            step_sizes=step_sizes,
            sight=sight,
            swaps=inter.swaps,
            blocks=inter.blocks,
            map_samples=map_samples(scenario),
            replays=replays_of(scenario),
            leaves=self.leaves_stand_offs(scenario),
        )

    def minds(self, scenario: Scenario) -> list[Any]:
        """Return the minds of all robots before learning, as arrays, with their own memory."""
        return [self.mind(scenario, k) for k in range(len(scenario.robots))]

    def mind(self, scenario: Scenario, robot: int) -> Any:
        """Return a robot's mind (from 0) before learning, as arrays, with its own memory."""
        with self.blamed("making what a robot remembers"):
            base = type(self).initial(scenario, robot)
            if scenario.prior == "map":
                base = type(self).informed(
                    base, scenario, robot, self.weights(scenario)
                )
            more = {
                name: np.asarray(make(scenario, robot))
                for name, make in self.own_memory.items()
            }
            return self.Mind(**base._asdict(), **more)

    def blamed(self, doing: str) -> AbstractContextManager[None]:
        """Return a context that reports a failure of a user's own learner in one line.

        Args:
            doing: the purpose of the call, for the error text.
        """
        if is_shipped(self):
            return nullcontext()
        return failing_as(f"learner {self.label!r}", doing)
