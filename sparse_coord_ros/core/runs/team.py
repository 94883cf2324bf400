# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team: one scenario and learner in one form, for many runs and for greedy trials.

Both forms run the loops of `core.runs.loop`: in plain Python on lists, compiled on arrays.
"""

from array import array
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sparse_coord_ros.core.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.core.game.draws import EVALUATION, keys_of
from sparse_coord_ros.core.game.rules import EPISODE_GAP, INDEX, problem_of
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.schedules import probabilities, step_sizes
from sparse_coord_ros.core.game.world import FIRST_STEP, Position, before_episode
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.mind import (
    Memory,
    as_lists,
    memory_of,
    part,
    stacked,
)
from sparse_coord_ros.core.learners.rules import map_samples, replays_of
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs import loop
from sparse_coord_ros.core.runs.trials import Trials

BLOCK_STEPS = 32_768
"""Steps of robots for which tables and the history get room at once."""

NEVER = 1 << 62
"""A time step that no run reaches."""


def block_of(robots: int) -> int:
    """Return the time steps for which a team gets room at once: a larger one needs more a step."""
    return max(1, BLOCK_STEPS // robots)


class Stopped(Exception):  # noqa: N818 - no error: the run is not wanted any more
    """A run was given up between two transitions."""


def groups_of(scenario: Scenario, learner: Learner) -> list[list[int]]:
    """Return the robots (from 0) that learn together.

    They are all, or for a learner that learns `alone` each robot by itself: one robot at a time
    in the world, each for the whole budget, so that robots never meet (paper, Section 4).
    """
    everyone = list(range(len(scenario.robots)))
    return [[k] for k in everyone] if learner.alone else [everyone]


class Team:
    """One scenario and learner in one form, for many runs.

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
        self.loops = loop.compiled(learner.Mind.learner) if compiled else loop.PLAIN
        self._stop = np.zeros(1, dtype=np.bool_) if stop is None else stop
        self._minds = learner.minds(scenario)
        sizes = step_sizes(scenario.step_size, scenario.steps)
        everyone = np.arange(len(scenario.robots), dtype=INDEX)
        rule = loop.Rule(
            problem=problem_of(scenario, plain=not compiled),
            members=everyone,
            actions=len(ACTIONS) if learner.asks else PRIMITIVES,
            max_steps=scenario.max_steps,
            exploring=probabilities(scenario.starts, scenario.steps),
            epsilon=probabilities(scenario.epsilon, scenario.steps),
            floors=sizes.by_step,
            weights=np.array(learner.weights(scenario)),
            goal_value=scenario.goal_value,
            step_sizes=sizes.by_count,
            map_samples=map_samples(scenario),
            replays=replays_of(scenario),
            leaves=learner.leaves_stand_offs(scenario),
            tasks=None,
        )
        groups = groups_of(scenario, learner)
        self.rules = [
            self._formed(rule._replace(members=np.array(own, dtype=INDEX)))
            for own in groups
        ]
        greedy: dict[str, Any] = {
            "max_steps": scenario.horizon,
            "exploring": np.zeros(1),
            "epsilon": np.zeros(1),
        }
        self._trying = self._formed(rule._replace(**greedy))
        self._readers = [
            learner.task(scenario, k, np.zeros(1)) for k in range(len(scenario.robots))
        ]

    def _formed(self, rule: loop.Rule) -> loop.Rule:
        """Return a rule for the loops: as it is, or for plain Python with lists."""
        if self.compiled:
            return rule
        names = ("exploring", "epsilon", "floors", "step_sizes")
        tables: dict[str, Any] = {
            name: array("d", getattr(rule, name).tobytes()) for name in names
        }
        members = rule.members.tolist()
        weights = rule.weights.tolist()
        listed = rule._replace(members=members, weights=weights, **tables)
        tasks = [
            self.learner.task(self.scenario, k, listed.step_sizes)
            for k in range(len(self.scenario.robots))
        ]
        return listed._replace(tasks=tasks)

    def initial(self, memories: Sequence[Memory] = ()) -> Any:
        """Return the minds of robots with these memories; without memories, before learning."""
        if self.compiled:
            return stacked(self._minds, block_of(len(self._minds)), memories)
        known = memories or (None,) * len(self._minds)
        return [
            as_lists(mind, memory)
            for mind, memory in zip(self._minds, known, strict=True)
        ]

    def state(
        self, rule: loop.Rule, seed: int, phase: int, position: Position
    ) -> loop.State:
        """Return a game in progress, at a position."""
        keys: Any = keys_of(seed, phase, len(self.scenario.robots))
        if self.compiled:
            game, choice = _game_in_arrays(position)
        else:
            keys = keys.tolist()
            game, choice = _game_in_lists(position)
        return loop.State(rule, game, choice, keys, self._stop)

    def play(
        self,
        minds: Any,
        seed: int,
        trials: int,
        *,
        progress: Callable[[int, int], None] | None = None,
    ) -> Trials:
        """Play greedy trials.

        Args:
            minds: the robots' minds.
            seed: seed of the trials.
            trials: number of trials.
            progress: called with the trials played and all of them, before each one.

        Raises:
            Stopped: the run is not wanted any more.
        """
        scenario = self.scenario
        team = len(scenario.robots)
        cells = len(scenario.map.cells)
        position = before_episode(0, FIRST_STEP + EPISODE_GAP, team)
        state = self.state(self._trying, seed, EVALUATION, position)
        results = np.zeros((trials, team, 4))
        asked, stays = np.zeros((2, team, cells), dtype=np.int64)
        filled: Any = (results, asked, stays)
        if not self.compiled:
            filled = [table.tolist() for table in filled]
        with self.learner.blamed("acting"):
            if progress is not None:
                for played in range(trials):
                    progress(played, trials)
                    self.loops.play(state, minds, *filled, played + 1)
            self.loops.play(state, minds, *filled, trials)
        results, asked, stays = map(np.asarray, filled)
        self.check_wanted()
        times = results[:, :, loop.TIME]
        return Trials(
            returns=results[:, :, loop.RETURN],
            time_to_goal=np.minimum(times, float(scenario.horizon)),
            asks=results[:, :, loop.ASKS],
            arrived=times <= scenario.horizon,
            miscoordinations=results[:, 0, loop.CONFLICTS],
            asked=asked,
            stays=stays,
        )

    def tables(self, minds: Any) -> list[Tables]:
        """Return each robot's tables, a copy."""
        found = []
        for k in range(len(self.scenario.robots)):
            mind = self.mind(minds, k)
            memory = memory_of(mind)
            found.append(
                Tables(self.scenario, self.learner, k, memory, self._q_coord(mind, k))
            )
        return found

    def _q_coord(self, mind: Any, k: int) -> np.ndarray | None:
        """Return Q^C of a pair by the compiled loop; None if the team is not compiled."""
        team = len(self.scenario.robots)
        cells = len(self.scenario.map.cells)
        if not self.compiled or self.scenario.sparse or team == 1:
            return None
        peer = 1 if k == 0 else 0
        table = np.zeros((cells, cells, PRIMITIVES))
        task = self._readers[k]
        self.loops.tabulate(mind, task, peer, np.zeros(team, dtype=np.int64), table)
        return table

    def mind(self, minds: Any, k: int) -> Any:
        """Return what robot k (from 0) knows: it goes on learning in it."""
        return part(minds, k) if self.compiled else minds[k]

    def check_wanted(self) -> None:
        """Raise `Stopped` where the run is not wanted any more."""
        if self._stop[0]:
            raise Stopped


def _game_in_arrays(position: Position) -> tuple[loop.GameState, loop.Choices]:
    """Return a game at a position, and room for the robots' choices, for compiled loops."""
    cells = np.array(position.cells, dtype=INDEX)
    team = len(cells)
    arrived = np.array([int(home) for home in position.arrived])
    chosen = np.zeros((4, team), dtype=INDEX)
    chosen[0] = cells
    choice = loop.Choices(
        cells=chosen[0],
        actions=chosen[1],
        moves=chosen[2],
        wanted=chosen[3],
        seen=np.zeros(team, dtype=np.int64),
        values=np.zeros(PRIMITIVES),
    )
    return loop.GameState(np.array(_clock_at(position)), cells, arrived), choice


def _game_in_lists(position: Position) -> tuple[loop.GameState, loop.Choices]:
    """As `_game_in_arrays`, for plain Python."""
    cells = list(position.cells)
    team = len(cells)
    arrived = [int(home) for home in position.arrived]
    choice = loop.Choices(
        cells=list(cells),
        actions=[0] * team,
        moves=[0] * team,
        wanted=[0] * team,
        seen=[0] * team,
        values=[0.0] * PRIMITIVES,
    )
    return loop.GameState(_clock_at(position), cells, arrived), choice


def _clock_at(position: Position) -> list[int]:
    """Return the clock of `GameState` at a position, for a loop that never looks up."""
    return [
        position.step,
        position.episode_start,
        position.transitions,
        int(position.under_way),
        NEVER,
    ]
