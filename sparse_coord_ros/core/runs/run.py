# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One learning run, plain or compiled, that can stop between any two transitions and continue."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.draws import LEARNING, PEER, ROBOT, draw
from sparse_coord_ros.core.game.interactions import miscoordinate
from sparse_coord_ros.core.game.perception import asked_peers
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.world import (
    FIRST_STEP,
    Action,
    Position,
    before_episode,
)
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.mind import (
    Memory,
    has_room,
    memory_of,
    rows_in,
    with_room,
)
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs import loop
from sparse_coord_ros.core.runs.history import History, blank_history, concatenated
from sparse_coord_ros.core.runs.loop import DONE, EPISODE_START, PLACED, STEP
from sparse_coord_ros.core.runs.team import Team, block_of
from sparse_coord_ros.core.runs.trials import Trials


class LearningState(NamedTuple):
    """A learning run between two transitions: each form can continue from it, bit for bit.

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
        team: scenario, learner and form.
        seed: the run's seed.
        state: the state to continue from; None: the beginning.
        gathering: whether to gather the history.

    Attributes:
        scenario, learner, seed: of the run.
        done: transitions made, by each group of robots.
        minds: the minds of all robots.
    """

    def __init__(
        self,
        team: Team,
        seed: int,
        state: LearningState | None = None,
        *,
        gathering: bool = True,
    ) -> None:
        self.team = team
        self.scenario = team.scenario
        self.learner = team.learner
        self.seed = seed
        robots = len(team.scenario.robots)
        groups = len(team.rules)
        if state is None:
            first = before_episode(0, FIRST_STEP, robots)
            state = LearningState(
                (first,) * groups, (), (blank_history(0, robots),) * groups
            )
        self.minds = team.initial(state.memories)
        self.done = state.positions[0].transitions
        self._states = [
            team.state(rule, seed, LEARNING, position)
            for rule, position in zip(team.rules, state.positions, strict=True)
        ]
        self._records: list[loop.Record | None] = [None] * groups
        if gathering:
            self._records = [
                record_of(one, compiled=team.compiled) for one in state.histories
            ]

    def advance(self, until: int) -> None:
        """Let every group of robots learn until it has made so many transitions.

        Raises:
            Stopped: the run is not wanted any more.
        """
        for number, state in enumerate(self._states):
            clock = state.game.clock
            while clock[DONE] < until:
                self._make_room(number)
                with self.learner.blamed("learning"):
                    self.team.loops.learn(
                        state, self.minds, self._records[number], until
                    )
                self.team.check_wanted()
        self.done = max(self.done, until)

    def _make_room(self, number: int) -> None:
        """Give tables and the history room, and let the loop look up before it is used up."""
        if not self.team.compiled:
            return
        clock = self._states[number].game.clock
        block = block_of(len(self.scenario.robots))
        if not has_room(self.minds, block):
            self.minds = with_room(self.minds, block)
        record = self._records[number]
        if record is not None and record.used[0] + block > len(record.length):
            self._records[number] = record_of(self._history(number), compiled=True)
        clock[loop.END] = clock[STEP] + block

    def make_transition(self) -> TeamTransition:
        """Let every group of robots make one transition, and return it."""
        positions = [_position(state.game) for state in self._states]
        self.advance(self.done + 1)
        rows: list[tuple[int, Action | None, int]] = []  # in the order of the robots
        met = False
        for state, before in zip(self._states, positions, strict=True):
            members = state.rule.members
            for k in members:
                cell = before.cells[k]
                action = None
                if not (before.under_way and before.arrived[k]):
                    cell = int(state.choice.cells[k])
                    action = self._action(state, k, before.step)
                rows.append((cell, action, int(state.game.cells[k])))
            inter = state.rule.problem.interactions
            met |= bool(
                miscoordinate(inter, state.choice.cells, state.game.cells, members)
            )
        cells, actions, after = zip(*rows, strict=True)
        return TeamTransition(positions[0].step, cells, actions, after, met)

    def _action(self, state: loop.State, k: int, step: int) -> Action:
        """Return a robot's action at the last completed time step."""
        choice = state.choice
        asked = int(choice.actions[k]) == COORDINATE
        peer = -1
        if asked:
            which = draw(state.keys[ROBOT][k], step, PEER)
            robots = len(self.scenario.robots)
            peers = asked_peers(self.scenario.peers, k, robots, which)
            peer = peers[0] if len(peers) == 1 else -1
        return Action(int(choice.moves[k]), asked, peer, int(choice.seen[k]) != 0)

    def mind(self, k: int) -> Any:
        """Return what robot k (from 0) knows: it goes on learning in it."""
        return self.team.mind(self.minds, k)

    @property
    def tables(self) -> list[Tables]:
        """The tables that every robot has learned so far, a copy."""
        return self.team.tables(self.minds)

    @property
    def step(self) -> int:
        """The time step of the next transition (of robots that learn alone: of the first one)."""
        return int(self._states[0].game.clock[STEP])

    @property
    def asked(self) -> np.ndarray:
        """How often each robot has learned from COORDINATE in each cell, shape (robots, cells)."""
        robots = range(len(self.scenario.robots))
        return np.array([np.array(self.mind(k).updates)[:, COORDINATE] for k in robots])

    def rows_learned(self, tables: Sequence[Tables]) -> np.ndarray:
        """Return how many rows of Q^C (or rho) each robot has learned, shape (robots,), int64.

        Args:
            tables: as `tables` returns them.
        """
        found = [rows_in(self.mind(k), one.memory) for k, one in enumerate(tables)]
        return np.array(found)

    @property
    def memories(self) -> tuple[Memory, ...]:
        """Every robot's memory, a copy."""
        return tuple(memory_of(self.mind(k)) for k in range(len(self.scenario.robots)))

    def play(self, trials: int) -> Trials:
        """Play greedy trials with the tables learned so far."""
        return self.team.play(self.minds, self.seed, trials)

    @property
    def history(self) -> History:
        """The episodes so far."""
        return concatenated(
            [blank_history(0, len(self.scenario.robots)), *self._histories()]
        )

    def _histories(self) -> tuple[History, ...]:
        there = [number for number, one in enumerate(self._records) if one is not None]
        return tuple(map(self._history, there))

    def _history(self, number: int) -> History:
        record = self._records[number]
        state = self._states[number]
        assert record is not None
        return history_of(record, len(self.scenario.robots), state.rule.members)

    def state(self) -> LearningState:
        """Return the state of the run."""
        positions = tuple(_position(state.game) for state in self._states)
        return LearningState(positions, self.memories, self._histories())


def learn(
    scenario: Scenario, learner: str | Learner, seed: int, *, compiled: bool = False
) -> list[Tables]:
    """Return the tables learned in the scenario's budget, by default in plain Python."""
    run = LearningRun(Team(scenario, learner_of(learner), compiled=compiled), seed)
    run.advance(scenario.steps)
    return run.tables


def record_of(history: History, *, compiled: bool) -> loop.Record:
    """Return a record that continues a history; compiled it has room for two blocks."""
    used = [history.episodes, history.robots]
    rows = history
    if compiled:
        rows = concatenated(
            [history, blank_history(2 * block_of(history.robots), history.robots)]
        )
    fields = {name: getattr(rows, name) for name in loop.Record._fields[1:]}
    if compiled:
        return loop.Record(np.array(used), **fields)
    return loop.Record(used, **{name: table.tolist() for name, table in fields.items()})


def history_of(record: loop.Record, robots: int, members: Any) -> History:
    """Return the history of a record; a copy."""
    episodes = int(record.used[0])
    blank = blank_history(episodes, robots)
    fields = {}
    for name in loop.Record._fields[1:]:
        like = getattr(blank, name)
        found = np.array(getattr(record, name)[:episodes], dtype=like.dtype)
        fields[name] = found.reshape(like.shape)
    present = np.zeros((episodes, robots), dtype=np.bool_)
    present[:, list(members)] = True
    return History(**fields, present=present)


def _position(game: loop.GameState) -> Position:
    clock = game.clock
    team = len(game.cells)
    transitions = int(clock[DONE])
    step = int(clock[STEP])
    if not clock[PLACED]:
        return before_episode(transitions, step, team)
    cells = tuple(int(cell) for cell in game.cells)
    arrived = tuple(bool(home) for home in game.arrived)
    return Position(transitions, step, True, int(clock[EPISODE_START]), cells, arrived)
