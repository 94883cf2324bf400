# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CQ-learning (De Hauwere, Vrancx & Nowe, AAMAS 2010): ask where rewards are not a lone robot's.

A robot begins with Q*, learned alone (here: computed, `learn.lone`), which never changes. It
compares the rewards of each own cell and move with those that it would get alone, by Student's
t-test on windows of `WINDOW` samples. Where they differ the cell is marked. In marked cells it
looks at its peer, here by COORDINATE, and compares the rewards of each joint state in the same
way. A joint state where they differ has a row of its own in Q^C, the augmented table, which
begins at Q* and learns

    Q^C(x, z, a) = (1 - alpha) Q^C(x, z, a) + alpha (r + gamma max_b Q*(y, b)).

Other joint states keep Q*, by which it also acts after a failed percept. The price of asking is
in no reward that it learns from: the paper has none, and where the robot asks is not a matter of
values. In tables Q*(x, COORDINATE) says where: it is `MARK` above the best move in marked cells,
`MARK` below it in others.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sparse_coord_ros.compiling import inner
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game import streams
from sparse_coord_ros.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.world import Reward
from sparse_coord_ros.learn import loops
from sparse_coord_ros.learn.agent import (
    Agent,
    Choice,
    Memory,
    TableMinds,
    Tables,
    learn_entry,
    move_by_rows,
)
from sparse_coord_ros.learn.algorithm import Values, asks_surely, greatest, weighed
from sparse_coord_ros.learn.archive import check_finite, member
from sparse_coord_ros.learn.lone import lone_rows, lone_tables
from sparse_coord_ros.learn.rows import Rows

if TYPE_CHECKING:
    from sparse_coord_ros.learn.learners import Learner

MARK = 1.0
"""How far COORDINATE is above the best move in marked cells, and below it in others."""

WINDOW = 20
"""Samples of a test; the next test has new ones, so that a sample is judged once."""

T_CRITICAL = 2.093
"""Student's t of 19 degrees of freedom that chance exceeds once in twenty times."""

COUNT, SUM, SQUARES = range(3)
"""Last axis of samples: how many they are, and their sums."""

MARKED = -1.0
"""In place of a count of samples: the joint state is marked, and not tested any more."""


@inner
def differs(sample: np.ndarray, value: float) -> bool:
    """Add a sample; return whether the mean is not 0 by the test of this window, or one before.

    Args:
        sample: the window: [COUNT, SUM, SQUARES]; it begins anew when it is full.
        value: the reward less that of a lone robot with the same transition.
    """
    if sample[COUNT] < 0.0:
        return True
    sample[COUNT] += 1.0
    sample[SUM] += value
    sample[SQUARES] += value * value
    if sample[COUNT] < WINDOW:
        return False
    square = sample[SUM] * sample[SUM]
    spread = WINDOW * sample[SQUARES] - square
    found = bool(square * (WINDOW - 1) > T_CRITICAL * T_CRITICAL * spread)
    clear(sample, found)
    return found


@inner
def clear(sample: np.ndarray, found: bool) -> None:
    """Begin a window anew, or end the tests where the last one found a difference."""
    sample[COUNT] = MARKED if found else 0.0
    sample[SUM] = 0.0
    sample[SQUARES] = 0.0


@inner
def is_marked(values: Values) -> bool:
    """Whether a row of Q* says that its cell is marked: the robot asks there."""
    return bool(asks_surely(values))


@inner
def set_mark(values: np.ndarray, marked: bool) -> None:
    """Set COORDINATE in a row of Q*."""
    values[COORDINATE] = greatest(values, PRIMITIVES) + (MARK if marked else -MARK)


def check_pair(scenario: Scenario, learner: str) -> None:
    """Raise `SettingError` unless COORDINATE perceives one peer, and Q^C is dense."""
    if scenario.perceived > 2:
        what = f"setting peers: value is 'all', allowed with learner {learner}: one"
        raise SettingError(f"{what}; leave it out")
    if scenario.sparse:
        raise SettingError(
            f"learner {learner}: scenario {scenario.name} has {len(scenario.map.cells)} cells, "
            "allowed: 724; use a smaller map, or learner coop or factored"
        )


class CQAgent(Agent):
    """Agent k; arguments as of `Agent`."""

    def __init__(
        self,
        scenario: Scenario,
        number: int,
        seed: int,
        *,
        phase: int = streams.LEARNING,
        **others: Any,
    ) -> None:
        super().__init__(scenario, number, seed, phase=phase, **others)
        cells = len(scenario.map.cells)
        self._blind = streams.Stream(seed, number, streams.BLIND, phase)
        self._ask_cost = scenario.ask_cost
        begun = lone_tables(scenario, number, above=-MARK)
        self._lone = begun.q_star
        self._samples = np.zeros((cells, PRIMITIVES + cells, 3))
        known = (np.asarray(self._tables.q_coord) != begun.q_coord).any(axis=2)
        self._samples[:, PRIMITIVES:, COUNT][known] = MARKED

    def coordinate(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> int:
        """Return the move that COORDINATE becomes, explored as any other."""
        draws = self._blind.at(step)
        if draws[streams.BLIND_EXPLORE] < self.epsilon(step):
            return int(draws[streams.BLIND_ACTION] * PRIMITIVES)
        return super().coordinate(step, cell, perceived)

    def learn(self, step: int, choice: Choice, reward: Reward, next_cell: int) -> None:
        """Sample the reward; learn Q^C in joint states that are marked. As of `Agent.learn`."""
        if not self.learning:
            return
        cell, decision, action, perceived = choice
        self.star_updates[cell, decision.action] += 1
        values, samples = self._tables.q_star[cell], self._samples[cell]
        other = self.weights.common * reward.common
        if decision.action != COORDINATE:
            if not is_marked(values) and differs(samples[action.move], other):
                set_mark(values, True)
        elif perceived is not None and differs(samples[PRIMITIVES + perceived[0]], other):
            home = next_cell == self.goal
            after = self._goal_value if home else self.bootstrap(next_cell, step)
            entry, total = (cell, *perceived, action.move), weighed(reward, self.weights)
            self.update(self._coord, self.coord_updates, entry, step, total, after)

    def bootstrap(self, cell: int, step: int) -> float:
        """Return the maximum of Q*(cell, .) over the moves."""
        return greatest(self._tables.q_star[cell].tolist(), PRIMITIVES)

    def memory(self) -> Memory:
        """Return what the agent has learned, and its samples; a copy."""
        return super().memory()._replace(more={"samples": self._samples.copy()})

    def check(self, memory: Memory) -> None:
        """Raise `ValueError` unless an agent of this run can have learned that."""
        super().check(memory)
        samples = member(memory.more, "samples", np.float64, *self._samples.shape)
        check_finite(samples, "samples")
        if not np.isin(samples[..., COUNT], [MARKED, *range(WINDOW)]).all():
            allowed = f"{MARKED:g}, 0 to {WINDOW - 1}"
            raise ValueError(f"samples has counts out of range, allowed: {allowed}")
        if (samples[..., SQUARES] < 0.0).any():
            raise ValueError("samples has sums of squares below 0")

    def go_on_from(self, memory: Memory) -> None:
        """Go on with what another agent of the same run has learned.

        Raises:
            ValueError: as of `check`.
        """
        super().go_on_from(memory)
        self._samples[:] = memory.more["samples"]


class CQMinds(NamedTuple):
    """The compiled form of `CQAgent`; attributes as of `loops.Minds`, and two more.

    Attributes:
        lone: the lone robot's Q* [k, x, action].
        samples: windows of the moves and of the joint states [k, x, move or 4 + z, `COUNT`...].
    """

    q_star: np.ndarray
    star_updates: np.ndarray
    rows: Rows
    lone: np.ndarray
    samples: np.ndarray

    @staticmethod
    def roles() -> tuple[int, ...]:
        """Streams that it draws from while it learns."""
        return (streams.BLIND,)

    @classmethod
    def initial(cls, scenario: Scenario, learner: "Learner", block: int) -> "CQMinds":
        """Return what robots know before learning; as of `loops.Minds`."""
        team, cells = len(scenario.robots), len(scenario.map.cells)
        q_star = np.stack([learner.tables(scenario, k).q_star for k in range(team)])
        updates, samples = np.zeros(q_star.shape, np.int32), (team, cells, PRIMITIVES + cells, 3)
        return cls(q_star, updates, lone_rows(q_star), q_star.copy(), np.zeros(samples))

    def tables(self, scenario: Scenario, learner: "Learner") -> list[Tables]:
        """Return what each robot has learned."""
        return TableMinds(*self[:3]).tables(scenario, learner)

    def memory(self, k: int, scenario: Scenario) -> Memory:
        """Return what robot k has learned, as its agent remembers it; a copy."""
        memory = TableMinds(*self[:3]).memory(k, scenario)
        return memory._replace(more={"samples": self.samples[k].copy()})

    def remember(self, memories: Sequence[Memory], scenario: Scenario) -> "CQMinds":
        """Return what robots know that remember all this."""
        for k, memory in enumerate(memories):
            self.samples[k] = memory.more["samples"]
        TableMinds(*self[:3]).remember(memories, scenario)
        return self

    @staticmethod
    def coordinate(state: loops.State, minds: "CQMinds", step: int, k: int, epsilon: float) -> int:
        """Turn COORDINATE into a move by the row that is perceived, or by Q*; or explore."""
        move = move_by_rows(state, minds, step, k)
        draws = state.draws
        if epsilon > 0.0:
            if loops.drawn(draws, streams.BLIND, k, step, streams.BLIND_EXPLORE) < epsilon:
                return int(
                    loops.drawn(draws, streams.BLIND, k, step, streams.BLIND_ACTION) * PRIMITIVES
                )
        return move

    @staticmethod
    def bootstrap(state: loops.State, minds: "CQMinds", step: int, k: int, y: int) -> float:
        """Return the maximum of Q*(y, .) over the moves."""
        return greatest(minds.q_star[k, y], PRIMITIVES)

    @staticmethod
    def learn(state: loops.State, minds: "CQMinds", now: loops.Transition) -> None:
        """Sample the reward; learn Q^C in joint states that are marked, as `CQAgent.learn`."""
        step, k, y, reward, floor = now
        problem, choice = state.problem, state.choice
        x, action, row = choice.cells[k], choice.actions[k], choice.rows[k]
        minds.star_updates[k, x, action] += 1
        values, samples = minds.q_star[k, x], minds.samples[k, x]
        z = row % minds.q_star.shape[1]
        other = problem.weights[1] * reward[1]
        if action != COORDINATE:
            if not is_marked(values) and differs(samples[action], other):
                set_mark(values, True)
        elif row != loops.NO_ROW and differs(samples[PRIMITIVES + z], other):
            total = weighed(reward, problem.weights)
            after = loops.worth_of(state, minds, step, k, y)
            values, updates = minds.rows.values[k, row], minds.rows.updates[k, row]
            learn_entry(problem, values, updates, choice.moves[k], total, after, floor)
