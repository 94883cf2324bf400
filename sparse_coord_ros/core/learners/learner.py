# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The base class of learners: hooks, which are plain functions over the arrays of a mind.

A robot node, the log and plain Python call the hooks; `core.runs.loop` makes a loop of them, which
numba compiles. So they may index (`mind.q_star[k, cell, b]`), compute, and call functions that are
marked by `compiling.jitable`; they make no objects. A user's own learner overrides one or more of
them. See examples/own_learner.py and docs/learners.md.
"""

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.base.errors import SettingError, did_you_mean, in_short
from sparse_coord_ros.core.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.core.game.draws import LEARNING, MOVE_TIE, ROBOT, keys_of
from sparse_coord_ros.core.game.plugins import failing_as, is_shipped, path_of
from sparse_coord_ros.core.game.scenario import (
    INITIAL_VALUES,
    SETTINGS,
    WHILE_LEARNING,
    Scenario,
)
from sparse_coord_ros.core.game.schedules import probabilities, step_sizes
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.lone import known_q_star
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    Values,
    epsilon_greedy,
    greedy,
)


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


def _checked_scenario(who: str, made: Any) -> Any:
    if not isinstance(made, Scenario):
        raise SettingError(
            f"{who}: its with_defaults returned {in_short(made)}, allowed: a Scenario"
        )
    return made


def _checked_weights(who: str, made: Any) -> Any:
    with suppress(TypeError, ValueError):
        weights = RewardWeights(*map(float, made))
        if all(map(math.isfinite, weights)):
            return weights
    allowed = "three numbers, for the individual reward, the common reward and the cost of asking"
    raise SettingError(f"{who}: its weights are {made!r}, allowed: {allowed}")


def _anything(who: str, made: Any) -> Any:
    return made


CHECKS: Mapping[str, Callable[[str, Any], Any]] = {
    "with_defaults": _checked_scenario,
    "check": _anything,
    "weights": _checked_weights,
}
"""The methods of a learner of one's own that are checked."""


def check_attributes(learner: "Learner") -> None:
    """Raise `TypeError` if an instance has attributes that only its class can have, or none."""
    for name in vars(learner):
        _check_name(type(learner), name)
        if name in OF_THE_LOOP:
            raise TypeError(
                f"class {type(learner).__name__}: {name} was set in an instance; set it in the "
                "class"
            )


def _check_name(learner: type, name: str) -> None:
    """Raise `TypeError` if a public name is none of a learner's: nothing would ever use it."""
    if not (name.startswith("_") or name == "Mind" or hasattr(Learner, name)):
        raise TypeError(
            f"class {learner.__name__}: {name!r} is nothing that a learner has"
            f"{did_you_mean(name, HOOKS)}; its functions are {', '.join(HOOKS)}; put one of "
            "your own outside the class, marked by @sc.rules.jitable"
        )


def _check_hook(learner: type, name: str, hook: Any) -> None:
    """Raise `TypeError` unless a hook is a function with the parameters of its contract."""
    wanted = list(inspect.signature(getattr(Learner, name)).parameters)
    allowed = f"allowed: ({', '.join(wanted)})"
    if not inspect.isfunction(hook):
        raise TypeError(
            f"class {learner.__name__}: {name} is {in_short(hook)}, no plain function; {allowed}"
        )
    parameters = list(inspect.signature(hook).parameters)
    if parameters != wanted:
        raise TypeError(
            f"class {learner.__name__}: {name} takes ({', '.join(parameters)}), {allowed}"
        )
    if "random" in hook.__code__.co_names:
        raise TypeError(
            f"class {learner.__name__}: {name} uses random, allowed: sc.rules.draw, whose draws "
            "are the same in each way of running"
        )


def _naming_itself(
    hook: Callable[..., Any], allowed: str, fits: Callable[[Any], bool]
) -> Any:
    """Return a hook that raises `TypeError` with its name where its result is not allowed."""

    @functools.wraps(hook)
    def naming(*arguments: Any) -> Any:
        value = hook(*arguments)
        if not fits(value):
            raise TypeError(
                f"{hook.__name__} returned {in_short(value)}, allowed: {allowed}"
            )
        return value

    return naming


def _is_whole(value: Any) -> bool:
    return isinstance(value, int | np.integer)


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int | np.floating | np.integer)


@functools.cache
def with_named_results(rule: type) -> Any:
    """Return the hooks of a class; a user's own ones name themselves where a result is wrong.

    Plain Python calls these. Compiled code has its types.
    """
    if is_shipped(rule):
        return rule
    results = {
        "decide": (f"an action, 0 to {len(ACTIONS) - 1}", _is_whole),
        "move_after_asking": (f"a move, 0 to {PRIMITIVES - 1}", _is_whole),
        "bootstrap": ("a number", _is_number),
    }
    hooks = {name: getattr(rule, name) for name in OF_THE_LOOP}
    for name, (allowed, fits) in results.items():
        hooks[name] = _naming_itself(hooks[name], allowed, fits)
    return type(rule.__name__, (), hooks)


def _new_names(learner: type) -> list[str]:
    """Return the names in the body of a class, and in its base classes that are no learners."""
    names = list(vars(learner))
    for base in learner.__bases__:
        if not issubclass(base, Learner):
            names += [name for name in dir(base) if not hasattr(object, name)]
    return names


HOOKS = (
    "initial",
    "informed",
    "begin_episode",
    "decide",
    "asking_values",
    "move_after_asking",
    "bootstrap",
    "learn",
)
"""The functions of a learner that its loop, its robots and its files call."""

OF_THE_LOOP = (*HOOKS, "partners")
"""What a loop has of a learner's class."""


class Learner:
    """One learner: its names, what it needs, and how its robots choose and learn.

    Attributes:
        name: its name for users, once it is registered.
        summary: its description, one line.
        asks: whether COORDINATE is among its actions; if not, the fifth column of Q* is NaN.
        alone: whether each robot learns with no other robot in the world (Indiv. of Section 4).
            Such a learner cannot run live.
        partners: whether it uses the peers with which a robot interacted
            (`Transition.partners`).
        needs_map: whether it always begins with the values of robots alone: `prior` is `map`.
        slow: how many times longer than one of coop its step takes in plain Python, roughly.
        defaults: values of scenario settings that neither the scenario nor the user chose;
            `run.yaml` records each value used.
        Mind: the named tuple of what its robots remember: `q_star`, `updates` and what else it
            needs. `initial` returns that of one robot; the arrays of a team have the robot as
            their first axis.
        values: fields with learned values, without counts; another run can begin with them.
        scratch: fields without meaning between two calls; files and logs leave them out.
        entry_point: its name as an entry point of an installed package, or None. The registry
        sets it.
    """

    name: str | None = None
    summary: str = ""
    asks: bool = True
    alone: bool = False
    partners: bool = False
    needs_map: bool = False
    slow: int = 1
    defaults: Mapping[str, object] = MappingProxyType({})
    Mind: type[Any]
    values: tuple[str, ...] = ("q_star", "q_coord")
    scratch: tuple[str, ...] = ()
    entry_point: str | None = None

    def __init_subclass__(cls, **more: object) -> None:
        """Check the names of a new class, and let compiled loops call its hooks.

        Raises:
            TypeError: the class has a public name that is none of a learner's, or a hook with
                other parameters.
        """
        super().__init_subclass__(**more)
        for attribute in ("name", "summary"):
            if attribute not in vars(cls):
                setattr(cls, attribute, getattr(Learner, attribute))
        for name in _new_names(cls):
            _check_name(cls, name)
            if name in HOOKS:
                hook = getattr(cls, name)
                _check_hook(cls, name, hook)
                setattr(cls, name, staticmethod(jitable(hook)))
        if not is_shipped(cls):
            for name, check in CHECKS.items():
                if name in vars(cls):
                    setattr(cls, name, _guarded(vars(cls)[name], name, check))

    # Its hooks: k is a robot (from 0), and the arrays of a mind have the robot as first axis.

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Any:
        """Return what a robot remembers before learning, a `Mind` (Algorithm 1, line 1).

        Its arrays are those of one robot, without the axis of the robots.
        """
        raise NotImplementedError

    @staticmethod
    def informed(
        mind: Any, scenario: Scenario, robot: int, weights: RewardWeights
    ) -> Any:
        """Return what a robot that knows its map remembers before learning (`prior: map`).

        Unless changed Q* begins at the values of a robot alone.

        Args:
            mind: what `initial` returned.
            scenario: the problem.
            robot: the robot, from 0.
            weights: how much each part of a reward counts.
        """
        return mind._replace(q_star=known_q_star(scenario, robot, weights, mind.q_star))

    @staticmethod
    def begin_episode(mind: Any, task: Task, k: int) -> None:
        """Begin an episode."""

    @staticmethod
    def decide(mind: Any, task: Task, k: int, step: int, cell: int) -> int:
        """Return A_k(t) of a robot that learns (Algorithm 1, line 4): it explores by epsilon.

        A robot that does not learn takes the greedy action, whatever the learner is.

        Args:
            mind: the team's mind.
            task: its task; `draw(task.keys[k], step, column)` is a random number.
            k: the robot.
            step: the time step t.
            cell: X_k(t).
        """
        return epsilon_greedy(mind.q_star[k, cell], task, k, step)

    @staticmethod
    def asking_values(
        mind: Any, task: Task, k: int, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values by which COORDINATE chooses a move (Algorithm 1, lines 6 to 10).

        Args:
            mind: the team's mind.
            task: its task.
            k: the robot.
            cell: X_k(t).
            seen: the peers that are perceived, the sum of 2^j; 0: the percept failed.
            cells: the cells of all robots; `NOT_PERCEIVED` in place of those that are not seen.
            values: set [move].
        """
        raise NotImplementedError

    @staticmethod
    def move_after_asking(
        mind: Any,
        task: Task,
        k: int,
        step: int,
        cell: int,
        seen: int,
        cells: Any,
        values: Values,
    ) -> int:
        """Return the move that COORDINATE becomes: in the paper the greedy one (lines 7 and 9).

        Args:
            mind: the team's mind.
            task: its task; `task.learning` says whether the robot learns.
            k: the robot.
            step: the time step t.
            cell: X_k(t).
            seen: as of `asking_values`.
            cells: likewise.
            values: what `asking_values` set.
        """
        return greedy(values, PRIMITIVES, task.keys[k], step, MOVE_TIE)

    @staticmethod
    def bootstrap(mind: Any, task: Task, k: int, cell: int, now: Transition) -> float:
        """Return the expected return from X_k(t+1), which is not the goal."""
        raise NotImplementedError

    @staticmethod
    def learn(mind: Any, task: Task, k: int, now: Transition, after: float) -> None:
        """Learn from a transition (Algorithm 1, lines 12 to 14 and 18).

        Args:
            mind: the team's mind, changed.
            task: its task.
            k: the robot.
            now: the transition.
            after: what `bootstrap` returned; at the goal its value.
        """
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
    def rule(self) -> Any:
        """The class with its hooks, of which a loop is made: itself, or a base class."""
        for base in type(self).__mro__:
            if any(name in vars(base) for name in OF_THE_LOOP):
                return base
        return Learner

    @property
    def runs_live(self) -> bool:
        """True if its robots learn together, as nodes do."""
        return not self.alone

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

    def rows_of_a_cell(self, scenario: Scenario) -> int:
        """Return the largest number of rows that depend on peers, for each own cell."""
        return int(len(scenario.map.cells) ** (scenario.perceived - 1))

    def weights(self, scenario: Scenario) -> RewardWeights:
        """Return how much each part of R_k(t) counts while it learns.

        Unless changed it is their sum, with r^C as often as the setting `credit` says.
        """
        return RewardWeights(1.0, scenario.common_weight, 1.0)

    def task(
        self,
        scenario: Scenario,
        seed: int = 0,
        phase: int = LEARNING,
        *,
        learning: bool = False,
    ) -> Task:
        """Return the task of a team.

        Args:
            scenario: the problem.
            seed: the run's seed.
            phase: LEARNING or EVALUATION: which random draws the robots use.
            learning: whether the robots learn.
        """
        sizes = step_sizes(scenario.step_size, scenario.steps)
        return Task(
            robots=len(scenario.robots),
            cells=len(scenario.map.cells),
            goals=np.array([robot.goal for robot in scenario.robots]),
            actions=len(ACTIONS) if self.asks else PRIMITIVES,
            discount=scenario.discount,
            goal_value=scenario.goal_value,
            goal_reward=scenario.goal_reward,
            ask_cost=scenario.ask_cost,
            weights=RewardWeights(*map(float, self.weights(scenario))),
            epsilon=probabilities(scenario.epsilon, scenario.steps),
            step_sizes=sizes.by_count,
            floors=sizes.by_step,
            learning=learning,
            sees_all=scenario.peers_seen == WHILE_LEARNING,
            keys=keys_of(seed, phase, len(scenario.robots))[ROBOT],
            full=np.zeros(1, dtype=np.bool_),
        )

    def begun(self, scenario: Scenario, robot: int) -> Any:
        """Return what a robot (from 0) remembers before learning; its arrays are its own."""
        with self.blamed("making what a robot remembers"):
            mind: Any = self.initial(scenario, robot)
            self._check_mind(mind, scenario, "initial")
            if scenario.prior == "map":
                mind = self.informed(mind, scenario, robot, self.weights(scenario))
                self._check_mind(mind, scenario, "informed")
            return mind

    def _check_mind(self, mind: Any, scenario: Scenario, hook: str) -> None:
        """Raise `TypeError` or `ValueError` unless a hook returned what a robot remembers."""
        kind: Any = getattr(self, "Mind", ())
        if not isinstance(mind, kind):
            raise TypeError(
                f"{hook} returned {in_short(mind)}, allowed: the learner's Mind, with all "
                "its fields; write an initial for a Mind of your own"
            )
        if not {"q_star", "updates"} <= set(mind._fields):
            raise TypeError(
                f"its Mind has the fields {', '.join(mind._fields)}; it needs q_star and "
                "updates, too"
            )
        wanted = (len(scenario.map.cells), len(ACTIONS))
        for name in ("q_star", "updates"):
            shape = np.shape(getattr(mind, name))
            if shape != wanted:
                raise ValueError(
                    f"{hook} returned {name} of shape {shape}, allowed: (cells, actions), "
                    f"here {wanted}"
                )

    def blamed(self, doing: str) -> AbstractContextManager[None]:
        """Return a context that reports a failure of a user's own learner in one line.

        Args:
            doing: the purpose of the call, for the error text.
        """
        if is_shipped(self):
            return nullcontext()
        return failing_as(f"learner {self.label!r}", doing)


for _name in HOOKS:
    jitable(getattr(Learner, _name))
