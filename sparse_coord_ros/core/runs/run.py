# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One learning run, plain or compiled, that can stop between any two transitions and continue."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.draws import LEARNING, PEER, ROBOT, draw, keys_of
from sparse_coord_ros.core.game.interactions import miscoordinates
from sparse_coord_ros.core.game.perception import asked_peers
from sparse_coord_ros.core.game.world import (
    FIRST_STEP,
    Action,
    Position,
    before_episode,
)
from sparse_coord_ros.core.learners.agent import Decision, action_of
from sparse_coord_ros.core.learners.mind import Memory, team_mind, with_room
from sparse_coord_ros.core.learners.rules import of_run
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs import loop
from sparse_coord_ros.core.runs.history import (
    FIRST_EPISODES,
    History,
    blank_history,
    concatenated,
)
from sparse_coord_ros.core.runs.loop import DONE, EPISODES, STEP, UNDER_WAY
from sparse_coord_ros.core.runs.measures import Measures
from sparse_coord_ros.core.runs.team import Team, blank_record, run_at


class LearningState(NamedTuple):
    """A learning run between two transitions: plain or compiled, a run goes on from it.

    Attributes:
        positions: the game of each group of robots that learn together.
        memories: each robot's memory.
        histories: the episodes of each group.
    """

    positions: tuple[Position, ...]
    memories: tuple[Memory, ...]
    histories: tuple[History, ...]


class TeamTransition(NamedTuple):
    """One transition of K robots, for watchers.

    Attributes:
        step: the time step t (of robots that learn alone: of the first one).
        cells: X_k(t); None where it is not known.
        actions: each robot's action; None if it did not act.
        after: X_k(t+1), likewise; None if all are unknown.
        miscoordination: whether the step is a miscoordination.
        rewards: R_k(t); empty: not known.
        ends: how percepts ended, numbers of `wire.PerceptEnd`; empty: not known.
    """

    step: int
    cells: tuple[int | None, ...]
    actions: tuple[Action | None, ...]
    after: tuple[int | None, ...] | None
    miscoordination: bool
    rewards: Sequence[Any] = ()
    ends: Sequence[int | None] = ()


class LearningRun:
    """A learning run in progress.

    Args:
        team: scenario, learner and loop.
        seed: the run's seed.
        state: the state to continue from; None: the beginning.

    Attributes:
        scenario, learner, seed: of the run.
        done: transitions made, by each group of robots.
        minds: the mind of each group of robots.
    """

    def __init__(
        self, team: Team, seed: int, state: LearningState | None = None
    ) -> None:
        self.team = team
        self.scenario = team.scenario
        self.learner = team.learner
        self.seed = seed
        if state is None:
            state = _beginning(team)
        self.done = state.positions[0].transitions
        self.minds = [team.mind(group, state.memories) for group in team.groups]
        self._tasks = []
        self._runs = []
        self._records = []
        every_key = keys_of(seed, LEARNING, len(self.scenario.robots))
        max_steps = self.scenario.max_steps
        for group, position, history in zip(
            team.groups, state.positions, state.histories, strict=True
        ):
            keys = np.ascontiguousarray(every_key[:, group.robots])
            here = position._replace(
                cells=tuple(position.cells[k] for k in group.robots),
                arrived=tuple(position.arrived[k] for k in group.robots),
            )
            self._tasks.append(of_run(group.task, keys[ROBOT]))
            episodes = history.episodes
            self._runs.append(run_at(here, episodes, keys, team.exploring, max_steps))
            cells = len(self.scenario.map.cells)
            self._records.append(record_of(history, group.robots, cells))

    def advance(self, until: int) -> None:
        """Let every group of robots learn until it has made so many transitions.

        Raises:
            Stopped: the run is not wanted any more.
        """
        for number, run in enumerate(self._runs):
            while run.clock[DONE] < until:
                self._make_room(number)
                with self.learner.blamed("learning"):
                    self.team.loop(
                        self.team.groups[number].problem,
                        self._tasks[number],
                        run,
                        self.minds[number],
                        self._records[number],
                        until,
                        self.team.stop,
                    )
                self.team.check_wanted()
        self.done = max(self.done, until)

    def _make_room(self, number: int) -> None:
        """Give tables and the record of a group room, where it is used up."""
        full = self._tasks[number].full
        if full[0]:
            self.minds[number] = with_room(self.minds[number])
            full[0] = False
        record = self._records[number]
        if self._runs[number].clock[EPISODES] == len(record.length):
            self._records[number] = longer(record, 4 * len(record.length))

    def make_transition(self) -> TeamTransition:
        """Let every group of robots make one transition, and return it."""
        step = self.step
        acting = [
            [True] * len(run.cells) if not run.clock[UNDER_WAY] else ~run.arrived
            for run in self._runs
        ]
        self.advance(self.done + 1)
        cells: list[int] = []
        actions: list[Action | None] = []
        after: list[int] = []
        met = False
        for group, run, acts in zip(self.team.groups, self._runs, acting, strict=True):
            cells += run.before.tolist()
            after += run.cells.tolist()
            for index, k in enumerate(group.robots):
                acted = bool(acts[index])
                actions.append(self._action(run, index, k, step) if acted else None)
            inter = group.problem.interactions
            met = met or bool(miscoordinates(inter, run.before, run.cells))
        return TeamTransition(step, tuple(cells), tuple(actions), tuple(after), met)

    def _action(self, run: loop.Run, index: int, k: int, step: int) -> Action:
        """Return the action of robot k at the last completed time step."""
        decision = Decision(int(run.actions[index]))
        if decision.action == COORDINATE:
            chance = draw(int(run.keys[ROBOT, index]), step, PEER)
            peers = asked_peers(
                self.scenario.peers, k, len(self.scenario.robots), chance
            )
            decision = Decision(COORDINATE, peers)
        move = int(run.moves[index])
        return action_of(decision, move, perceived=bool(run.seen[index] != 0))

    @property
    def tables(self) -> list[Tables]:
        """The tables that every robot has learned so far, a copy."""
        return self.team.tables(self.memories)

    @property
    def step(self) -> int:
        """The time step of the next transition (of robots that learn alone: of the first one)."""
        return int(self._runs[0].clock[STEP])

    @property
    def asked(self) -> np.ndarray:
        """How often each robot has asked in each cell, shape (robots, cells)."""
        return np.concatenate([mind.updates[..., COORDINATE] for mind in self.minds])

    @property
    def memories(self) -> list[Memory]:
        """Every robot's memory, a copy."""
        return self.team.memories(self.minds)

    def play(self, trials: int) -> Measures:
        """Play greedy trials with the tables learned so far."""
        [mind, *others] = self.minds
        if others:
            robots = range(len(self.scenario.robots))
            mind = team_mind(self.learner, self.scenario, robots, self.memories)
        return self.team.play(mind, self.seed, trials)

    @property
    def history(self) -> History:
        """The episodes so far."""
        return concatenated(self._histories())

    def _histories(self) -> list[History]:
        robots = len(self.scenario.robots)
        return [
            history_of(record, int(run.clock[EPISODES]), robots, group.robots)
            for group, run, record in zip(
                self.team.groups, self._runs, self._records, strict=True
            )
        ]

    def state(self) -> LearningState:
        """Return the state of the run."""
        robots = len(self.scenario.robots)
        positions = tuple(
            _position(run, robots, group.robots)
            for group, run in zip(self.team.groups, self._runs, strict=True)
        )
        return LearningState(positions, tuple(self.memories), tuple(self._histories()))


def _beginning(team: Team) -> LearningState:
    """Return the state before the first transition."""
    robots = len(team.scenario.robots)
    groups = len(team.groups)
    first = before_episode(0, FIRST_STEP, robots)
    return LearningState((first,) * groups, (), (blank_history(0, robots),) * groups)


OF_ROBOTS = ("returns", "asks", "arrived")
OF_EPISODES = ("first_step", "length", "miscoordinations")
"""Fields of a record that stand in a history."""


def record_of(history: History, robots: Sequence[int], cells: int) -> loop.Record:
    """Return a record that continues the history of some robots."""
    episodes = history.episodes
    record = blank_record(max(FIRST_EPISODES, 2 * episodes), len(robots), cells)
    for name in OF_EPISODES:
        getattr(record, name)[:episodes] = getattr(history, name)
    for name in OF_ROBOTS:
        getattr(record, name)[:episodes] = getattr(history, name)[:, robots]
    return record


def longer(record: loop.Record, rows: int) -> loop.Record:
    """Return a record with room for so many episodes; a copy."""
    robots, cells, _ = record.chosen.shape
    larger = blank_record(rows, robots, cells)
    used = len(record.length)
    for name in (*OF_EPISODES, *OF_ROBOTS, "steps"):
        getattr(larger, name)[:used] = getattr(record, name)
    return larger._replace(chosen=record.chosen)


def history_of(
    record: loop.Record, episodes: int, robots: int, members: Sequence[int]
) -> History:
    """Return the history of so many episodes in a record of some of the robots; a copy."""
    history = blank_history(episodes, robots)
    for name in OF_EPISODES:
        getattr(history, name)[:] = getattr(record, name)[:episodes]
    for name in OF_ROBOTS:
        getattr(history, name)[:, members] = getattr(record, name)[:episodes]
    history.present[:, members] = True
    return history


def _position(run: loop.Run, team: int, robots: Sequence[int]) -> Position:
    step, episode_start, transitions, under_way, _ = run.clock.tolist()
    if not under_way:
        return before_episode(transitions, step, team)
    cells = np.zeros(team, dtype=np.int64)
    cells[robots] = run.cells
    arrived = np.ones(team, dtype=np.bool_)
    arrived[robots] = run.arrived
    return Position(
        transitions,
        step,
        True,
        episode_start,
        tuple(cells.tolist()),
        tuple(arrived.tolist()),
    )
