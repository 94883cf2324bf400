# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team: one scenario and learner, plain or compiled, for many runs and for greedy trials."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import EVALUATION, ROBOT, keys_of
from sparse_coord_ros.core.game.rules import EPISODE_GAP, Problem, problem_of
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.schedules import probabilities
from sparse_coord_ros.core.game.specs import Spec
from sparse_coord_ros.core.game.world import FIRST_STEP, Position, before_episode
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.mind import (
    Memory,
    copied,
    memory_of,
    team_mind,
)
from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED, Task, of_run
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs import loop
from sparse_coord_ros.core.runs.measures import TRIAL, TRIALS, Measures

FOREVER = 1 << 62
"""A budget that no run uses up."""


class Stopped(Exception):  # noqa: N818 - no error: the run is not wanted any more
    """A run was given up between two transitions."""


class Group(NamedTuple):
    """Robots that learn together in a world of their own.

    Attributes:
        robots: their numbers, from 0.
        scenario: the problem, with these robots only.
        problem: it as arrays.
        task: what they know of it; the keys of its draws are those of no run.
    """

    robots: Sequence[int]
    scenario: Scenario
    problem: Problem
    task: Task


def groups_of(scenario: Scenario, learner: Learner) -> list[tuple[list[int], Scenario]]:
    """Return the robots (from 0) that learn together, and the scenario of each group.

    They are all, or for a learner that learns `alone` each robot by itself: one robot at a time
    in the world, each for the whole budget, so that robots never meet (paper, Section 4).
    """
    everyone = list(range(len(scenario.robots)))
    if not learner.alone:
        return [(everyone, scenario)]
    return [
        (
            [k],
            replace(scenario, robots=(scenario.robots[k],), common_reward=Spec("same")),
        )
        for k in everyone
    ]


class Team:
    """One scenario and learner, plain or compiled, for many runs.

    Args:
        scenario: the problem and its protocol.
        learner: the learner.
        compiled: whether numba computes it.
        stop: where its one entry is set, runs raise `Stopped` at the next transition.

    Raises:
        SettingError: the learner cannot learn the scenario.
    """

    def __init__(
        self,
        scenario: Scenario,
        learner: Learner,
        *,
        compiled: bool,
        stop: np.ndarray | None = None,
    ) -> None:
        learner.check(scenario)
        self.scenario = scenario
        self.learner = learner
        self.compiled = compiled
        self.loop = (
            loop.compiled(learner.rule) if compiled else loop.plain(learner.rule)
        )
        self.stop = np.zeros(1, dtype=np.bool_) if stop is None else stop
        self.exploring = probabilities(scenario.starts, scenario.steps)
        self._problem = problem_of(scenario)
        self._task = learner.task(scenario)
        self.groups = [
            self._group(robots, problem)
            for robots, problem in groups_of(scenario, learner)
        ]

    def _group(self, robots: Sequence[int], group_scenario: Scenario) -> Group:
        """Return a group of robots; `group_scenario`: the team's, or theirs alone."""
        problem = self._problem
        task = self._task
        if group_scenario is not self.scenario:
            problem = problem_of(group_scenario)
            task = self.learner.task(group_scenario)
        return Group(robots, group_scenario, problem, task._replace(learning=True))

    def mind(self, group: Group, memories: Sequence[Memory] = ()) -> Any:
        """Return the mind of a group whose robots remember this; empty: before learning."""
        known = [memories[k] for k in group.robots] if memories else ()
        return team_mind(self.learner, group.scenario, range(len(group.robots)), known)

    def play(
        self,
        mind: Any,
        seed: int,
        trials: int,
        *,
        progress: Callable[[int, int], None] | None = None,
    ) -> Measures:
        """Play greedy trials.

        Args:
            mind: the mind of the whole team; it is not changed.
            seed: seed of the trials.
            trials: number of trials.
            progress: called with the trials played and all of them, before each one.

        Raises:
            Stopped: the run is not wanted any more.
        """
        scenario = self.scenario
        robots = range(len(scenario.robots))
        keys = keys_of(seed, EVALUATION, len(robots))
        task = of_run(self._task, keys[ROBOT])
        position = before_episode(0, FIRST_STEP + EPISODE_GAP, len(robots))
        run = run_at(position, 0, keys, np.zeros(1), scenario.horizon)
        record = blank_record(trials, len(robots), len(scenario.map.cells))
        mind = copied(mind)
        parts = [trials]
        if progress is not None:
            parts = list(range(1, trials + 1))
        with self.learner.blamed("acting"):
            for part in parts:
                if progress is not None:
                    progress(part - 1, trials)
                room = record._replace(length=record.length[:part])
                self.loop(
                    self._problem,
                    task,
                    run,
                    mind,
                    room,
                    FOREVER,
                    self.stop,
                )
        self.check_wanted()
        times = np.where(record.arrived, record.steps, scenario.horizon)
        return Measures(
            source=TRIALS,
            unit=TRIAL,
            trials=trials,
            returns=record.returns,
            time_to_goal=times.astype(np.float64),
            miscoordinations=record.miscoordinations.astype(np.float64),
            asks=record.asks.astype(np.float64),
            arrived=record.arrived.all(axis=1),
            asked=record.chosen[..., COORDINATE] / trials,
            stays=record.chosen.sum(axis=-1) / trials,
        )

    def tables(self, memories: Sequence[Memory]) -> list[Tables]:
        """Return each robot's tables."""
        return [
            Tables(self.scenario, self.learner, k, memory)
            for k, memory in enumerate(memories)
        ]

    def memories(self, minds: Sequence[Any]) -> list[Memory]:
        """Return what each robot remembers, a copy; `minds`: those of the groups."""
        return [
            memory_of(self.learner, mind, index)
            for group, mind in zip(self.groups, minds, strict=True)
            for index in range(len(group.robots))
        ]

    def check_wanted(self) -> None:
        """Raise `Stopped` where the run is not wanted any more."""
        if self.stop[0]:
            raise Stopped


def run_at(
    position: Position,
    episodes: int,
    keys: np.ndarray,
    exploring: np.ndarray,
    max_steps: int,
) -> loop.Run:
    """Return a run at a position, after some episodes; other arguments as in `loop.Run`."""
    team = len(position.cells)
    clock = [
        position.step,
        position.episode_start,
        position.transitions,
        int(position.under_way),
        episodes,
    ]
    return loop.Run(
        clock=np.array(clock),
        keys=keys,
        exploring=exploring,
        max_steps=max_steps,
        before=np.zeros(team, dtype=np.int64),
        wanted=np.zeros(team, dtype=np.int64),
        cells=np.array(position.cells),
        arrived=np.array(position.arrived),
        actions=np.zeros(team, dtype=np.int64),
        moves=np.zeros(team, dtype=np.int64),
        seen=np.zeros(team, dtype=np.int64),
        known=np.full(team, NOT_PERCEIVED),
        known_next=np.full(team, NOT_PERCEIVED),
        values=np.zeros(PRIMITIVES),
    )


def blank_record(rows: int, robots: int, cells: int) -> loop.Record:
    """Return a record with room for some episodes."""

    def counts(*shape: int) -> np.ndarray:
        return np.zeros(shape, dtype=np.int64)

    return loop.Record(
        first_step=counts(rows),
        length=counts(rows),
        steps=counts(rows, robots),
        returns=np.zeros((rows, robots)),
        asks=counts(rows, robots),
        arrived=np.zeros((rows, robots), dtype=np.bool_),
        miscoordinations=counts(rows),
        chosen=counts(robots, cells, len(ACTIONS)),
    )
