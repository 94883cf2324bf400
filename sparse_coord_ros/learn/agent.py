# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One agent of Algorithm 1: its two tables and what it does with them.

The robot node and the simulation without ROS drive this same object; the numbers come from the
functions of `algorithm`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sparse_coord_ros.compiling import inlined
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game import streams
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.perception import asked_peers, drawn_peer, succeeds
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.schedules import probabilities, step_sizes
from sparse_coord_ros.game.world import SUM_OF_PARTS, Action, Reward, RewardWeights
from sparse_coord_ros.learn import loops
from sparse_coord_ros.learn.algorithm import (
    Values,
    greatest,
    greedy,
    step_size,
    updated,
    weighed,
)
from sparse_coord_ros.learn.archive import MOST_UPDATES, check_finite, check_range, member
from sparse_coord_ros.learn.factors import AdditiveTable, Factors
from sparse_coord_ros.learn.rows import MOST_ROWS, Rows, make_rows, row_to_learn
from sparse_coord_ros.learn.sparse import SparseTable

if TYPE_CHECKING:
    from sparse_coord_ros.learn.learners import Learner

NOBODY = -1

PEER_FROM_1 = np.array([0, 1, 0], dtype=np.int32)
"""What the states of `Factors` have in files on top: peers are numbered from 1 there."""


class Tables(NamedTuple):
    """What one agent has learned.

    Attributes:
        q_star: Q*_k, shape (cells, 5), float64; column 4 (COORDINATE) is NaN for a baseline.
        q_coord: Q^C_k, shape (cells, cells, 4), float64; first index the own cell, second the
            perceived peer's. Where COORDINATE perceives several peers, a sparse table over the
            joint state: the own cell, then the peers' in ascending order of robots.
        factors: what a learner that learns in factors has them from; None for the others.
    """

    q_star: np.ndarray
    q_coord: np.ndarray | SparseTable | AdditiveTable
    factors: Factors | None = None

    def __repr__(self) -> str:
        """Return what they are, on one line."""
        table, cells = self.q_coord, len(self.q_star)
        kind = "an array" if isinstance(table, np.ndarray) else type(table).__name__
        return f"<Tables of {cells} cells, Q^C {kind} of shape {table.shape}>"

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all that they are made of by its name in files: `learn.tables` has the shapes."""
        found = {"q_star": self.q_star}
        if self.factors is not None:
            u, r_bar, w, states, rho = self.factors
            states = states + PEER_FROM_1
            found |= {"u": u, "r_bar": r_bar, "w": w, "rho_states": states, "rho": rho}
        table = self.q_coord
        if isinstance(table, AdditiveTable):
            found["robots"] = np.array(len(table.shape) - 1)
        elif isinstance(table, SparseTable):
            found |= {"q_coord_keys": table.keys, "q_coord_rows": table.rows}
            found["q_coord_unseen"] = np.array(table.unseen)
        else:
            found["q_coord"] = table
        return found


class Memory(NamedTuple):
    """All that one agent has learned, so that another one can go on from there.

    Attributes:
        q_star: Q*_k, shape (cells, 5), float64.
        star_updates: updates of each of its entries, same shape, int64.
        states: joint states with an updated entry in Q^C_k, in ascending order, shape (rows, n),
            int32: the own cell, then the perceived peers'.
        values: their entries, shape (rows, 4), float64.
        updates: updates of each of them, same shape, int64.
        more: what else an agent of another kind remembers, as named arrays.
    """

    q_star: np.ndarray
    star_updates: np.ndarray
    states: np.ndarray
    values: np.ndarray
    updates: np.ndarray
    more: Mapping[str, np.ndarray] = MappingProxyType({})


def check_learned(memory: Memory, cells: int, actions: int, columns: int) -> None:
    """Raise `ValueError` unless arrays of a memory have the types, shapes and ranges of every run.

    Args:
        memory: what an agent is said to remember.
        cells: of the map.
        actions: how many the agent chooses between; Q* of the others is NaN.
        columns: how many numbers make a state of `memory.states`.
    """
    arrays = memory._asdict()
    q_star = member(arrays, "q_star", np.float64, cells, len(ACTIONS))
    check_finite(q_star[:, :actions], "q_star")
    if not np.isnan(q_star[:, actions:]).all():
        raise ValueError("q_star has values of COORDINATE, which this learner never chooses")
    updates = member(arrays, "star_updates", np.int64, *q_star.shape, below=MOST_UPDATES)
    check_range(updates[:, actions:], 0, 1, "star_updates")
    states = member(arrays, "states", np.int32, None, columns)
    if len(np.unique(states, axis=0)) < len(states):
        raise ValueError("states has a state twice")
    rows = len(states), PRIMITIVES
    check_finite(member(arrays, "values", np.float64, *rows), "values")
    member(arrays, "updates", np.int64, *rows, below=MOST_UPDATES)


MOST_JOINT_STATES = 2**63
"""A joint state is numbered by a 64-bit integer where Q^C is sparse."""


def check_joint_states(scenario: Scenario) -> None:
    """Raise `SettingError` where Q^C is over more joint states than can be numbered."""
    cells = len(scenario.map.cells)
    if scenario.sparse and cells**scenario.perceived >= MOST_JOINT_STATES:
        raise SettingError(
            "setting peers: value is 'all', allowed with this learner below 2^63 joint states; "
            f"scenario {scenario.name} has {cells}^{scenario.perceived}; use 'one', fewer robots, "
            "or learner factored"
        )


def initial_tables(scenario: Scenario, *, asks: bool = True) -> Tables:
    """Return the tables before learning (Algorithm 1, line 1).

    Args:
        scenario: the problem and its protocol.
        asks: whether COORDINATE is among the actions; if not, its column of Q* is NaN.
    """
    cells = len(scenario.map.cells)
    q_star = np.full((cells, len(ACTIONS)), scenario.q_star_init)
    if not asks:
        q_star[:, COORDINATE] = np.nan
    if scenario.sparse:
        return Tables(q_star, SparseTable(cells, scenario.perceived, scenario.q_coord_init))
    return Tables(q_star, np.full((cells, cells, PRIMITIVES), scenario.q_coord_init))


class Decision(NamedTuple):
    """An agent's choice at a time step, before active perception.

    Attributes:
        action: A_k(t), as of `game.actions`.
        peers: the agents to ask where the action is COORDINATE, in ascending order; else none.
    """

    action: int
    peers: tuple[int, ...] = ()


def action_of(decision: Decision, move: int, *, perceived: bool) -> Action:
    """Return what an agent does, its decision having become a move."""
    asks, peers = decision.action == COORDINATE, decision.peers
    peer = peers[0] if asks and len(peers) == 1 else NOBODY
    return Action(move, asks, peer, asks and perceived)


class Choice(NamedTuple):
    """What an agent did at a time step.

    Attributes:
        cell: X_k(t).
        decision: A_k(t).
        action: the primitive action that it became.
        perceived: the perceived local states of the asked peers; None where nobody was asked, or
            ActivePercept is FALSE.
    """

    cell: int
    decision: Decision
    action: Action
    perceived: tuple[int, ...] | None


class Agent:
    """Agent k: chooses by pi_epsilon and pi_g, learns by QLUpdate.

    Args:
        scenario: the problem; of it the agent uses the sizes, the learning protocol and which
            cell ends its episodes.
        number: k, from 0.
        seed: the run's seed.
        asks: whether COORDINATE is among its actions (Algorithm 1), or only the four moves.
        weights: how much each part of a reward counts while it learns.
        tables: tables to go on from; initial ones where None.
        learning: False: act greedily and never update.
        phase: LEARNING or EVALUATION: which random draws the agent uses.

    Attributes:
        actions: how many actions it chooses between.
        peers: the numbers of the other robots.
        discount: gamma.
        weights: as of the argument.
        star_updates: updates of each entry of Q*, shape (cells, actions), int64.
        coord_updates: updates of the entries of Q^C: own cell, peers' cells, move.
    """

    def __init__(
        self,
        scenario: Scenario,
        number: int,
        seed: int,
        *,
        asks: bool = True,
        weights: RewardWeights = SUM_OF_PARTS,
        tables: Tables | None = None,
        learning: bool = True,
        phase: int = streams.LEARNING,
    ) -> None:
        self.number = number
        self.learning = learning
        self.goal = scenario.robots[number].goal
        self.actions = len(ACTIONS) if asks else PRIMITIVES
        self._tables = initial_tables(scenario, asks=asks) if tables is None else tables
        self._coord: Any = self._tables.q_coord  # written to like an array, whatever it is
        self.weights = weights
        self.peers = tuple(k for k in range(len(scenario.robots)) if k != number)
        self._asks_whom = scenario.peers
        self._draws = streams.Stream(seed, number, streams.POLICY, phase)
        budget = scenario.steps if learning else 0
        self._epsilon = probabilities(scenario.epsilon, budget)
        self._step_sizes = step_sizes(scenario.step_size, budget)
        self.discount = scenario.discount
        self._goal_value = scenario.goal_value
        self.star_updates = np.zeros(self._tables.q_star.shape, dtype=np.int64)
        self.coord_updates: Counter[tuple[int, ...]] = Counter()

    @property
    def tables(self) -> Tables:
        """What it has learned so far; it goes on learning in them."""
        return self._tables

    @property
    def coord_visited(self) -> int:
        """Number of joint states whose entries in Q^C were updated."""
        return len({entry[:-1] for entry in self.coord_updates})

    @property
    def asked_in(self) -> np.ndarray:
        """How often it has learned from COORDINATE in each cell, shape (cells,), int64."""
        counts: np.ndarray = self.star_updates[:, COORDINATE]
        return counts

    def epsilon(self, step: int) -> float:
        """Return the probability of exploring at a time step; 0 without learning."""
        if not self.learning:
            return 0.0
        return float(self._epsilon[min(step, len(self._epsilon) - 1)])

    def values(self, cell: int) -> list[float]:
        """Return Q*(cell, .)."""
        values: list[float] = self._tables.q_star[cell].tolist()
        return values

    def decide(self, step: int, cell: int) -> Decision:
        """Choose A_k(t) by the learning policy pi_epsilon (Algorithm 1, line 4)."""
        action = self.explored(step, self.values(cell), self.actions, streams.TIE)
        if action != COORDINATE:
            return Decision(action)
        draw, robots = self._draws.at(step)[streams.PEER], len(self.peers) + 1
        return Decision(action, asked_peers(self._asks_whom, self.number, robots, draw))

    def explored(self, step: int, values: Values, count: int, tie: int) -> int:
        """Return the action that the learning policy pi_epsilon chooses.

        Args:
            step: t.
            values: those of the actions.
            count: how many of them compete.
            tie: the column of `streams.POLICY` that decides between ties.
        """
        draws = self._draws.at(step)
        if draws[streams.EXPLORE] < self.epsilon(step):
            return int(draws[streams.EXPLORED_ACTION] * count)
        return greedy(values, count, draws[tie])

    def act(
        self, step: int, cell: int, decision: Decision, perceived: tuple[int, ...] | None
    ) -> Action:
        """Turn the decision into a primitive action (Algorithm 1, lines 5 to 10).

        Args:
            step: t.
            cell: X_k(t).
            decision: what `decide` returned for this step.
            perceived: the local states of the asked peers; None where ActivePercept is FALSE.
        """
        if decision.action != COORDINATE:
            return Action(decision.action, False, NOBODY, False)
        move = self.coordinate(step, cell, perceived)
        return action_of(decision, move, perceived=perceived is not None)

    def coordinate(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> int:
        """Return the primitive action that COORDINATE becomes; arguments as of `act`."""
        tie = self._draws.at(step)[streams.PRIMITIVE_TIE]
        return greedy(self.values_asking(cell, perceived), PRIMITIVES, tie)

    def values_asking(self, cell: int, perceived: tuple[int, ...] | None) -> list[float]:
        """Return the values by which COORDINATE chooses a move: Q^C, or Q* after a failed percept.

        Args:
            cell: X_k(t).
            perceived: the local states of the asked peers; None where ActivePercept is FALSE.
        """
        if perceived is None:
            return self.values(cell)
        values: list[float] = self._tables.q_coord[cell, *perceived].tolist()
        return values

    def learn(self, step: int, choice: Choice, reward: Reward, next_cell: int) -> None:
        """Update Q^C, then Q* (Algorithm 1, lines 12 to 14 and 18).

        Both bootstrap on `bootstrap` of the next cell, or on the goal's value.

        Args:
            step: t.
            choice: what it did there.
            reward: R_k(t) in its parts.
            next_cell: X_k(t+1).
        """
        if not self.learning:
            return
        cell, decision, action, perceived = choice
        total = weighed(reward, self.weights)
        at_goal = next_cell == self.goal
        bootstrap = self._goal_value if at_goal else self.bootstrap(next_cell, step)
        if perceived is not None:
            entry = (cell, *perceived, action.move)
            self.update(self._coord, self.coord_updates, entry, step, total, bootstrap)
        entry = (cell, decision.action)
        self.update(self._tables.q_star, self.star_updates, entry, step, total, bootstrap)

    def bootstrap(self, cell: int, step: int) -> float:
        """Return what it expects from a cell on, which is not its goal: max_b Q*(cell, b).

        A rule of another paper is a subclass with another one; `TableMinds` has its compiled form.

        Args:
            cell: X_k(t+1).
            step: t.
        """
        return greatest(self._tables.q_star[cell].tolist(), self.actions)

    def memory(self) -> Memory:
        """Return what the agent has learned; a copy.

        An agent of one's own that remembers more than tables and their counts of updates cannot
        go on from here: its learning is not to be broken off.
        """
        q_star, q_coord = self._tables.q_star, self._coord
        states = sorted({entry[:-1] for entry in self.coord_updates})
        moves = range(PRIMITIVES)
        updates = [[self.coord_updates[*state, move] for move in moves] for state in states]
        return Memory(
            q_star.copy(),
            self.star_updates.copy(),
            np.array(states, dtype=np.int32).reshape(len(states), len(q_coord.shape) - 1),
            np.array([q_coord[state] for state in states]).reshape(len(states), PRIMITIVES),
            np.array(updates, dtype=np.int64).reshape(len(states), PRIMITIVES),
        )

    def check(self, memory: Memory) -> None:
        """Raise `ValueError` unless an agent of this run can have learned that."""
        cells = len(self._tables.q_star)
        check_learned(memory, cells, self.actions, len(self._coord.shape) - 1)
        check_range(memory.states, 0, cells, "states")

    def go_on_from(self, memory: Memory) -> None:
        """Go on with what another agent of the same run has learned.

        Raises:
            ValueError: as of `check`.
        """
        self.check(memory)
        q_star, q_coord = self._tables.q_star, self._coord
        q_star[:] = memory.q_star
        self.star_updates[:] = memory.star_updates
        rows = zip(memory.states.tolist(), memory.values, memory.updates.tolist(), strict=True)
        for state, values, updates in rows:
            for move, count in enumerate(updates):
                if count:
                    q_coord[*state, move] = values[move]
                    self.coord_updates[*state, move] = count

    def update(
        self,
        table: Any,
        updates: np.ndarray | Counter[tuple[int, ...]],
        entry: tuple[int, ...],
        step: int,
        reward: float,
        bootstrap: float,
    ) -> None:
        """Update an entry of a table by QLUpdate, with the step size of its count.

        Args:
            table: Q* or Q^C.
            updates: its counts: `star_updates` or `coord_updates`.
            entry: index of the entry.
            step: the time step t.
            reward: R_k(t), weighed.
            bootstrap: what the next cell is worth.
        """
        count = int(updates[entry]) + 1
        updates[entry] = count
        by_count, by_step = self._step_sizes
        last = len(by_count) - 1
        alpha = step_size(float(by_count[min(count, last)]), float(by_step[min(step, last)]))
        table[entry] = updated(float(table[entry]), alpha, reward, self.discount, bootstrap)


class TableMinds(NamedTuple):
    """The compiled form of `Agent`; attributes as of `loops.Minds`.

    A joint state's number in `rows` has the cells as its digits: the own cell, then the peers'.
    """

    q_star: np.ndarray
    star_updates: np.ndarray
    rows: Rows

    @staticmethod
    def roles() -> tuple[int, ...]:
        """No streams beside the game's."""
        return ()

    @classmethod
    def initial(cls, scenario: Scenario, learner: "Learner", block: int) -> "TableMinds":
        """Return what robots know before learning; as of `loops.Minds`."""
        team, cells = len(scenario.robots), len(scenario.map.cells)
        q_star = np.stack([learner.tables(scenario, k).q_star for k in range(team)])
        first = scenario.q_coord_init
        sparse = learner.asks and scenario.sparse
        rows = make_rows(team, cells * cells if learner.asks and not sparse else 0, first)
        if sparse:
            rows = make_rows(team, 0, first, 1, MOST_ROWS)
            rows = rows.empty(rows.rows_for(0, block))
        return cls(q_star, np.zeros(q_star.shape, dtype=np.int32), rows)

    def tables(self, scenario: Scenario, learner: "Learner") -> list[Tables]:
        """Return what each robot has learned; rows that trials only looked at are left out."""
        cells, agents = len(scenario.map.cells), scenario.perceived
        if not learner.asks:
            initial = initial_tables(scenario, asks=False).q_coord
            return [Tables(q_star, initial) for q_star in self.q_star]
        if not scenario.sparse:
            shape = (cells, cells, PRIMITIVES)
            pairs = zip(self.q_star, self.rows.values, strict=True)
            return [Tables(q_star, q_coord.reshape(shape)) for q_star, q_coord in pairs]
        memories = [self.memory(k, scenario) for k in range(len(self.q_star))]
        return [
            Tables(q_star, SparseTable(cells, agents, self.rows.first, m.states, m.values))
            for q_star, m in zip(self.q_star, memories, strict=True)
        ]

    def memory(self, k: int, scenario: Scenario) -> Memory:
        """Return what robot k has learned, as its agent remembers it; a copy."""
        keys, values, updates = self.rows.learned(k)
        shape = (len(scenario.map.cells),) * scenario.perceived
        states = np.stack(np.unravel_index(keys, shape), axis=1).astype(np.int32)
        star_updates = self.star_updates[k].astype(np.int64)
        return Memory(self.q_star[k].copy(), star_updates, states, values, updates)

    def remember(self, memories: Sequence[Memory], scenario: Scenario) -> "TableMinds":
        """Return what robots know that remember all this; hashed rows are still to be placed."""
        shape = (len(scenario.map.cells),) * scenario.perceived
        keys = [np.ravel_multi_index(tuple(memory.states.T), shape) for memory in memories]
        found: TableMinds = with_memories(self, memories, keys)
        return found

    @staticmethod
    def coordinate(
        state: loops.State, minds: "TableMinds", step: int, k: int, epsilon: float
    ) -> int:
        """Turn COORDINATE into a move by the row of Q^C that is perceived, or by Q*."""
        return move_by_rows(state, minds, step, k)

    @staticmethod
    def bootstrap(state: loops.State, minds: "TableMinds", step: int, k: int, y: int) -> float:
        """Return max_b Q*(y, b)."""
        return greatest(minds.q_star[k, y], state.problem.actions)

    @staticmethod
    def learn(state: loops.State, minds: "TableMinds", now: loops.Transition) -> None:
        """Update Q^C, then Q* (Algorithm 1, lines 12 to 14 and 18)."""
        step, k, y, reward, floor = now
        problem, choice = state.problem, state.choice
        x, action, row = choice.cells[k], choice.actions[k], choice.rows[k]
        total = weighed(reward, problem.weights)
        after = loops.worth_of(state, minds, step, k, y)
        if row != loops.NO_ROW:
            values, updates = minds.rows.values[k, row], minds.rows.updates[k, row]
            learn_entry(problem, values, updates, choice.moves[k], total, after, floor)
        values, updates = minds.q_star[k, x], minds.star_updates[k, x]
        learn_entry(problem, values, updates, action, total, after, floor)


@inlined
def move_by_rows(state: loops.State, minds: Any, step: int, k: int) -> int:
    """Return robot k's move by the row of Q^C that it perceives, or by Q*; note the row."""
    row, cells = loops.NO_ROW, state.game.cells
    if len(cells) > 1:
        key = perceived_state(state, k, step)
        if key != loops.NO_ROW:
            row = row_to_learn(minds.rows, k, key)
    state.choice.rows[k] = row
    if row == loops.NO_ROW:
        values = minds.q_star[k, cells[k]]
    else:
        values = minds.rows.values[k, row]
    return loops.greedy_action(values, PRIMITIVES, state.draws, k, step, streams.PRIMITIVE_TIE)


@inlined
def learn_entry(
    problem: loops.CompiledScenario,
    values: np.ndarray,
    updates: np.ndarray,
    action: int,
    reward: float,
    bootstrap: float,
    floor: float,
) -> None:
    """Update one entry of a row by QLUpdate, with the step size of its count."""
    count = updates[action] + 1
    updates[action] = count
    alpha = step_size(problem.alpha_by_count[count], floor)
    values[action] = updated(values[action], alpha, reward, problem.discount, bootstrap)


@inlined
def perceived_state(state: loops.State, k: int, step: int) -> int:
    """Return the number of the joint state that robot k's COORDINATE perceives, or `NO_ROW`."""
    problem, draws, cells = state.problem, state.draws, state.game.cells
    key: int = cells[k]
    size, team = len(problem.places), len(cells)
    draw = loops.percept_draw(draws, k, step)
    chances = problem.percept[key]
    first, end = 0, team
    if not problem.all_peers:
        which = loops.drawn(draws, streams.POLICY, k, step, streams.PEER) if team > 2 else 0.0
        first = drawn_peer(k, team, which)
        end = first + 1
    for peer in range(first, end):
        if peer != k:
            if not succeeds(draw, chances[cells[peer]]):
                return loops.NO_ROW
            key = key * size + cells[peer]
    return key


def with_memories(minds: Any, memories: Sequence[Memory], keys: Sequence[np.ndarray]) -> Any:
    """Return the compiled form of robots that remember something.

    Args:
        minds: as `initial` returns it; its arrays are changed.
        memories: what each robot remembers.
        keys: the keys of each robot's rows.

    Returns:
        `minds`; hashed rows are there in any order, for `rehash` to find their places.
    """
    rows = minds.rows
    if rows.hashed:
        rows = rows.empty(max(1, *map(len, keys)))
    for k, memory in enumerate(memories):
        minds.q_star[k] = memory.q_star
        minds.star_updates[k] = memory.star_updates
        if rows.values.size:
            rows.put(k, keys[k], memory.values, memory.updates)
    return minds._replace(rows=rows)
