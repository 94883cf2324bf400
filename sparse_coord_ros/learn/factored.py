# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The agent that learns Q* and Q^C in factors (`learn.factors`)."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sparse_coord_ros.compiling import inlined, inner
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game import streams
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.links import ruled_out
from sparse_coord_ros.game.perception import succeeds
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.settings import LARGEST_WHOLE
from sparse_coord_ros.game.world import (
    UNKNOWN_PARTNERS,
    Reward,
    RewardWeights,
)
from sparse_coord_ros.learn import factors, loops
from sparse_coord_ros.learn.agent import (
    Agent,
    Choice,
    Memory,
    Tables,
    check_learned,
    with_memories,
)
from sparse_coord_ros.learn.algorithm import Values
from sparse_coord_ros.learn.archive import MOST_UPDATES, check_finite, check_range, member
from sparse_coord_ros.learn.rows import FREE_PLACE, Rows, find_row, make_rows, row_to_learn

if TYPE_CHECKING:
    from sparse_coord_ros.learn.learners import Learner

VALUES = ("u", "r_bar", "w", "door")
REMEMBERED = (*VALUES, "commons", "moved", "successor", "last", "tried")
"""Fields of `Own` that an agent remembers as `Memory.more`; of `tried` only what is in use."""


def check_peers(scenario: Scenario) -> None:
    """Raise `SettingError` unless COORDINATE perceives every peer."""
    if len(scenario.robots) > 2 and scenario.peers != "all":
        raise SettingError(
            f"setting peers: value is {scenario.peers!r}, allowed with learner factored and more "
            "than two robots: all; set peers=all, or leave it out"
        )


def initial_factored(scenario: Scenario, weights: RewardWeights) -> Tables:
    """Return the first robot's tables before learning: U is `q_coord_init`, all else 0.

    Raises:
        SettingError: COORDINATE does not perceive every peer.
    """
    check_peers(scenario)
    cells, robots, first = len(scenario.map.cells), len(scenario.robots), scenario.q_coord_init
    begun = factors.Factors(
        individual=np.full((cells, PRIMITIVES), first),
        common=np.zeros((cells, PRIMITIVES)),
        asking=np.zeros(cells),
        states=np.empty((0, 3), dtype=np.int32),
        corrections=np.empty((0, PRIMITIVES)),
    )
    star = np.full((cells, len(ACTIONS)), first + 0.0)
    star[:, COORDINATE] = first - weights.ask_cost * scenario.ask_cost + 0.0
    return Tables(star, factors.coordination_table(begun, 0, robots), begun)


@inner
def terms_of(problem: Any, goal: int, weights: Values) -> factors.Terms:
    """Return the numbers of the rule for a robot with that goal.

    Args:
        problem: a scenario, or its compiled form.
        goal: the robot's goal cell.
        weights: as of `game.world.RewardWeights`.
    """
    after = problem.discount * problem.goal_value
    return factors.Terms(
        weights[2] * problem.ask_cost,
        problem.discount,
        goal,
        problem.goal_value,
        weights[0] * problem.goal_reward + after,
        max(1.0, weights[1]),
    )


class FactoredAgent(Agent):
    """Agent k: chooses as Algorithm 1 does, learns the factors of its two tables.

    Args:
        rule: the parts of the rule.
        tables: tables to begin with, with their factors.
        others: as of `Agent`.
    """

    def __init__(
        self,
        scenario: Scenario,
        number: int,
        seed: int,
        *,
        rule: factors.FactorRule,
        tables: Tables,
        phase: int = streams.LEARNING,
        **others: Any,
    ) -> None:
        super().__init__(scenario, number, seed, tables=tables, phase=phase, **others)
        assert tables.factors is not None
        self._cells, self._robots = len(scenario.map.cells), len(scenario.robots)
        self._rule, self._terms = rule, terms_of(scenario, self.goal, self.weights)
        self._felt = self.weights.common * scenario.penalties[number]
        self._right_of_way = rule.right_of_way and self._robots > 2
        known, nothing = tables.factors, np.zeros((self._cells, PRIMITIVES), dtype=np.int64)
        last = np.zeros(2 + self._robots, dtype=np.int64)
        arrays = (*known[:3], np.zeros(self._cells), nothing, nothing, nothing, last, last[:0])
        more = dict(zip(REMEMBERED, arrays, strict=True))
        updates = np.zeros(tables.q_star.shape, dtype=np.int64)
        no_counts = np.zeros(known.corrections.shape, dtype=np.int64)
        self._rho: dict[int, list[float]] = {}
        self.go_on_from(
            Memory(tables.q_star, updates, known.states, known.corrections, no_counts, more)
        )
        self._by_count = self._step_sizes.by_count.tolist()
        self._floor = self._step_sizes.by_step.tolist()
        self._ruled_out = ruled_out(scenario)
        self._replays = streams.Stream(seed, number, streams.REPLAY, phase)
        self._blind = streams.Stream(seed, number, streams.BLIND, phase)

    @property
    def tables(self) -> Tables:
        """What it has learned so far; a copy."""
        return factored_tables(self.memory(), self.number, self._robots)

    @property
    def coord_visited(self) -> int:
        """Number of rows of rho that were updated."""
        return len(self._counts)

    def values(self, cell: int) -> list[float]:
        """Return Q*(cell, .)."""
        return list(self._own.star[cell])

    def correction(self, cell: int, perceived: tuple[int, ...] | None) -> list[float]:
        """Return Q^C(x, z, .) - U(x, .) of a joint state, or of a failed percept.

        Args:
            cell: the own cell.
            perceived: the peers' cells; None: the percept failed.
        """
        correction = [0.0] * PRIMITIVES
        for row, _ in self._acted_on(cell, perceived):
            for b in range(PRIMITIVES):
                correction[b] += row[b]
        return correction

    def _acted_on(
        self, cell: int, perceived: tuple[int, ...] | None
    ) -> list[tuple[list[float], int]]:
        """Return the rows of rho that a percept adds up to, and whose each is: the sum of 2^j."""
        rows = self._rows(cell, perceived)
        if perceived is not None:
            seen = zip(rows, self.peers, perceived, strict=True)
            right = self._right_of_way
            rows = [row for row, j, z in seen if factors.counted(self.number, j, cell, z, right)]
        return [(self._rho[key], peers) for key, peers in rows if key in self._rho]

    def corrections(
        self, cell: int, perceived: tuple[int, ...] | None, move: int
    ) -> dict[tuple[int, int], float]:
        """Return rho of a move, by (peer, its cell); by twice `UNSEEN` if the percept failed.

        Args:
            cell: the own cell.
            perceived: the peers' cells; None: the percept failed.
            move: the primitive action.
        """
        unseen = [(factors.UNSEEN, factors.UNSEEN)]
        places = unseen if perceived is None else zip(self.peers, perceived, strict=True)
        rows = self._rows(cell, perceived)
        nothing = [0.0] * PRIMITIVES
        return {
            place: self._rho.get(key, nothing)[move]
            for place, (key, _) in zip(places, rows, strict=True)
        }

    def coordinate(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> int:
        """Return the move that COORDINATE becomes; after a failed percept it is explored."""
        draws = self._blind.at(step)
        if perceived is None and draws[streams.BLIND_EXPLORE] < self.epsilon(step):
            return int(draws[streams.BLIND_ACTION] * PRIMITIVES)
        return super().coordinate(step, cell, perceived)

    def values_asking(self, cell: int, perceived: tuple[int, ...] | None) -> list[float]:
        """Return U + rho, of what was perceived or of failed percepts."""
        correction = self.correction(cell, perceived)
        return [u + c for u, c in zip(self._own.u[cell], correction, strict=True)]

    def learn(self, step: int, choice: Choice, reward: Reward, next_cell: int) -> None:
        """Learn U, r_bar or rho and W, then replay; arguments as of `Agent.learn`."""
        if not self.learning:
            return
        cell, decision, action, perceived = choice
        own, rule, terms = self._own, self._rule, self._terms
        by_count, floor = self._by_count, self._floor[min(step, len(self._floor) - 1)]
        individual = self.weights.individual * reward.individual
        once = reward.common if reward.partners else 0.0
        common = self.weights.common * once
        asked = decision.action == COORDINATE
        factors.learn_move(
            own, cell, action.move, next_cell, individual, common, asked, terms, by_count, floor
        )
        if asked:
            ruled_out = self._ruled_out[cell]
            if perceived is None and ruled_out[cell]:
                common = once
            for key, peers in self._rows(cell, perceived):
                brought = common if reward.partners & peers else 0.0
                rho, counts = self._row(key)
                factors.learn_correction(rho, counts, action.move, brought, by_count, floor)
            if rule.look_back and own.last[0] == step:
                self._look_back(perceived, ruled_out, floor)
            own.last[:2] = step + 1, action.move
            seen = perceived or (factors.UNSEEN,) * len(self.peers)
            for robot, place in zip((self.number, *self.peers), (cell, *seen), strict=True):
                own.last[2 + robot] = place
            correction = self.correction(cell, perceived)
            factors.learn_asking(own, cell, correction, rule.percept_update, by_count, floor)
        factors.refresh(own, cell, terms)
        factors.replay(own, rule.replays, self._replays.at(step)[0], terms)

    def _look_back(
        self, perceived: tuple[int, ...] | None, ruled_out: np.ndarray, floor: float
    ) -> None:
        """Learn from two questions in a row what each move would have brought at the first."""
        own, before = self._own, self._own.last[2:]
        x = before[self.number]
        cells = list(perceived or self.peers)
        cells.insert(self.number, x)
        sight = factors.Sight(perceived is not None, cells, ruled_out)
        there, blame = [0.0] * PRIMITIVES, [[0.0] * self._robots for _ in range(PRIMITIVES)]
        for b in range(PRIMITIVES):
            s = own.successor[x][b]
            if own.moved[x][b] and s != self.goal:
                there[b] = self._surplus(s, perceived)
                best = factors.best_of(own.u[s])
                for rho, peers in self._acted_on(s, perceived) if perceived else ():
                    blame[b][peers.bit_length() - 1] = min(0.0, rho[best])
        outlook = factors.Outlook(self._surplus(x, perceived), there, blame)
        first = tuple(before[peer] for peer in self.peers)
        for key, peers in self._rows(x, None if factors.UNSEEN in first else first):
            rho, counts = self._row(key)
            factors.look_back(own, x, rho, counts, peers, sight, outlook, self._by_count, floor)

    def _surplus(self, cell: int, perceived: tuple[int, ...] | None) -> float:
        correction = self.correction(cell, perceived)
        return factors.surplus(self._own, cell, correction, self.discount)

    def _rows(self, cell: int, perceived: tuple[int, ...] | None) -> list[tuple[int, int]]:
        """Return the keys of rho's rows of a percept, and whose each is: the sum of 2^j."""
        cells, robots = self._cells, self._robots
        if perceived is None:
            return [(factors.unseen_key(cell, cells, robots), ~(1 << self.number))]
        return [
            (factors.key_of(cell, peer, place, cells, robots), 1 << peer)
            for peer, place in zip(self.peers, perceived, strict=True)
        ]

    def _row(self, key: int) -> tuple[list[float], list[int]]:
        """Return a row of rho and its counts, to be changed."""
        rho = self._rho.setdefault(key, [0.0] * PRIMITIVES)
        return rho, self._counts.setdefault(key, [0] * PRIMITIVES)

    @property
    def asked_in(self) -> np.ndarray:
        """How often it has learned from COORDINATE in each cell, shape (cells,), int64."""
        return np.array(self._own.updates, dtype=np.int64)[:, COORDINATE]

    def memory(self) -> Memory:
        """Return what the agent has learned; a copy.

        `states` are those of rho, shape (rows, 3), as of `Factors`, and `values` is rho;
        `star_updates` counts how often each move was tried, and COORDINATE.
        """
        own, nothing = self._own, [0] * PRIMITIVES
        keys = sorted(self._rho)
        counts = [self._counts.get(key, nothing) for key in keys]
        return Memory(
            np.array(own.star),
            np.array(own.updates, dtype=np.int64),
            factors.states_of(keys, self._cells, self._robots).reshape(len(keys), 3),
            np.array([self._rho[key] for key in keys]).reshape(len(keys), PRIMITIVES),
            np.array(counts, dtype=np.int64).reshape(len(keys), PRIMITIVES),
            {
                **{name: np.array(getattr(own, name)) for name in REMEMBERED[:-1]},
                "tried": np.array(own.tried[: own.used[0]], dtype=np.int64),
            },
        )

    def check(self, memory: Memory) -> None:
        """Raise `ValueError` unless an agent of this run can have learned that."""
        check_learned(memory, self._cells, self.actions, 3)
        factors.check_states(memory.states, self._cells, self._robots)
        self._check_model(memory)
        self._check_last(memory.more)

    def _check_model(self, memory: Memory) -> None:
        """Check the factors, where moves led and how often, and where r^C was felt."""
        more, moves = memory.more, (self._cells, PRIMITIVES)
        shapes = {"u": moves, "r_bar": moves, "w": moves[:1], "door": moves[:1]}
        for name in VALUES:
            check_finite(member(more, name, np.float64, *shapes[name]), name)
        if not np.isin(more["door"], [0.0, self._felt]).all():
            raise ValueError(f"door has an r^C that is neither 0 nor {self._felt:g}")
        made = memory.star_updates[:, :PRIMITIVES]
        tried = member(more, "tried", np.int64, None)
        if not np.array_equal(np.sort(tried), np.flatnonzero(made)):
            raise ValueError("tried are not the moves that were counted")
        for name in ("commons", "moved"):
            counts = member(more, name, np.int64, *moves, below=MOST_UPDATES)
            if (counts > made).any():
                raise ValueError(f"{name} counts a move more often than it was tried")
        successor = member(more, "successor", np.int64, *moves, below=self._cells)
        left = more["moved"] > 0
        if successor[~left].any() or (successor == np.arange(self._cells)[:, None])[left].any():
            raise ValueError("successor is not another cell just where a move led out of its own")

    def _check_last(self, more: Mapping[str, np.ndarray]) -> None:
        """Check what is kept of the last step with COORDINATE."""
        last = member(more, "last", np.int64, 2 + self._robots)
        step, move, *_ = last
        here = last[2 + self.number]
        peers = np.delete(last[2:], self.number)
        failed = bool(np.all(peers == factors.UNSEEN))
        check_range(step, 0, LARGEST_WHOLE, "last")
        check_range(move, 0, PRIMITIVES, "last")
        check_range(here, 0, self._cells, "last")
        check_range(peers, factors.UNSEEN if failed else 0, self._cells, "last")

    def go_on_from(self, memory: Memory) -> None:
        """Go on with what another agent of the same run has learned.

        Raises:
            ValueError: as of `check`.
        """
        self.check(memory)
        used = len(memory.more["tried"])
        tried = np.zeros(self._cells * PRIMITIVES, dtype=np.int64)
        tried[:used] = memory.more["tried"]
        self._own = factors.Own(
            star=memory.q_star.tolist(),
            value=memory.q_star.max(axis=1).tolist(),
            updates=memory.star_updates.tolist(),
            used=[used],
            **{name: array.tolist() for name, array in {**memory.more, "tried": tried}.items()},
        )
        keys = factors.keys_of(memory.states, self._cells, self._robots).tolist()
        self._rho |= dict(zip(keys, memory.values.tolist(), strict=True))
        counts = zip(keys, memory.updates.tolist(), strict=True)
        self._counts: dict[int, list[int]] = {key: count for key, count in counts if any(count)}


def factored_tables(memory: Memory, number: int, robots: int) -> Tables:
    """Return the tables of a robot (from 0) that remembers this; rows of rho that are 0 go."""
    kept = (memory.values != 0.0).any(axis=1)
    u, r_bar, w = (memory.more[name] for name in VALUES[:3])
    known = factors.Factors(u, r_bar, w, memory.states[kept], memory.values[kept])
    return Tables(memory.q_star, factors.coordination_table(known, number, robots), known)


DENSE_ROWS = 2**19
"""Rows of a robot's rho, 16 MiB, above which only those that it learned are kept."""

PERCEIVED = 0
"""In place of a row of Q^C: the percept succeeded."""


class FactoredMinds(NamedTuple):
    """The compiled form of `FactoredAgent`.

    Attributes:
        q_star, star_updates: as of `loops.Minds`; the updates count how often each move was
            tried, and COORDINATE.
        rows: rho, by the keys of `learn.factors`.
        own: the robots' factors and models, with the robot as first axis of each array.
        partners: as of `game.world.Reward` [k].
        correction: space for Q^C(x, z, .) - U(x, .) [move].
        ruled_out: as of `game.links.ruled_out`.
        found: where the rows are that it adds up to [robot].
        there, blame: space for those of `factors.Outlook`.
        rule: the parts of the rule; `right_of_way` is False for two robots.
    """

    q_star: np.ndarray
    star_updates: np.ndarray
    rows: Rows
    own: factors.Own
    partners: np.ndarray
    correction: np.ndarray
    ruled_out: np.ndarray
    found: np.ndarray
    there: np.ndarray
    blame: np.ndarray
    rule: factors.FactorRule

    @staticmethod
    def roles() -> tuple[int, ...]:
        """Streams that it draws from while it learns."""
        return (streams.REPLAY, streams.BLIND)

    @classmethod
    def initial(cls, scenario: Scenario, learner: "Learner", block: int) -> "FactoredMinds":
        """Return what robots know before learning; as of `loops.Minds`."""
        team, cells = len(scenario.robots), len(scenario.map.cells)
        q_star = np.repeat(learner.tables(scenario).q_star[None], team, axis=0)
        keys = factors.keys_below(cells, team)
        rows = make_rows(
            team, 0 if keys > DENSE_ROWS else keys, 0.0, team, factors.rows_at_most(cells, team)
        )
        if keys > DENSE_ROWS:
            rows = rows.empty(rows.rows_for(0, block))
        star_updates = np.zeros(q_star.shape, dtype=np.int32)
        counts = np.zeros((3, team, cells, PRIMITIVES), dtype=np.int64)
        own = factors.Own(
            np.full((team, cells, PRIMITIVES), scenario.q_coord_init),
            np.zeros((team, cells, PRIMITIVES)),
            np.zeros((team, cells)),
            q_star,
            q_star.max(axis=2),
            star_updates,
            np.zeros((team, cells)),
            counts[0],
            counts[1],
            counts[2],
            np.zeros((team, 2 + team), dtype=np.int64),
            np.zeros((team, cells * PRIMITIVES), dtype=np.int64),
            np.zeros((team, 1), dtype=np.int64),
        )
        assert learner.factors is not None
        return cls(
            q_star,
            star_updates,
            rows,
            own,
            partners=np.full(team, UNKNOWN_PARTNERS, dtype=np.int64),
            correction=np.zeros(PRIMITIVES),
            ruled_out=ruled_out(scenario),
            found=np.full(team, loops.NO_ROW, dtype=np.int64),
            there=np.zeros(PRIMITIVES),
            blame=np.zeros((PRIMITIVES, team)),
            rule=learner.factors._replace(right_of_way=learner.factors.right_of_way and team > 2),
        )

    def tables(self, scenario: Scenario, learner: "Learner") -> list[Tables]:
        """Return what each robot has learned."""
        robots = range(len(self.partners))
        return [factored_tables(self.memory(k, scenario), k, len(robots)) for k in robots]

    def memory(self, k: int, scenario: Scenario) -> Memory:
        """Return what robot k has learned, as its agent remembers it; a copy."""
        keys, values, updates = self.rows.learned(k)
        states = factors.states_of(keys, len(scenario.map.cells), len(self.partners))
        star_updates = self.star_updates[k].astype(np.int64)
        more = {name: getattr(self.own, name)[k].copy() for name in REMEMBERED}
        more["tried"] = more["tried"][: self.own.used[k, 0]]
        return Memory(self.q_star[k].copy(), star_updates, states, values, updates, more)

    def remember(self, memories: Sequence[Memory], scenario: Scenario) -> "FactoredMinds":
        """Return what robots know that remember all this; hashed rows are still to be placed."""
        for k, memory in enumerate(memories):
            for name in REMEMBERED:
                array = memory.more[name]
                getattr(self.own, name)[k][: len(array)] = array
            self.own.value[k] = memory.q_star.max(axis=1)
            self.own.used[k] = len(memory.more["tried"])
        cells, robots = len(scenario.map.cells), len(memories)
        keys = [factors.keys_of(memory.states, cells, robots) for memory in memories]
        found: FactoredMinds = with_memories(self, memories, keys)
        return found

    @staticmethod
    def begin_step(state: loops.State, minds: "FactoredMinds") -> None:
        """Note where everybody is, also who has arrived."""
        for k in range(len(state.game.cells)):
            state.choice.cells[k] = state.game.cells[k]

    @staticmethod
    def end_step(state: loops.State, minds: "FactoredMinds") -> None:
        """Note what the referee says."""
        if state.problem.referee:
            loops.find_partners(state, minds.partners)

    @staticmethod
    def coordinate(
        state: loops.State, minds: "FactoredMinds", step: int, k: int, epsilon: float
    ) -> int:
        """Turn COORDINATE into a move by U + rho."""
        problem, game, choice, draws = state
        x = game.cells[k]
        seen = PERCEIVED if len(game.cells) > 1 else loops.NO_ROW
        draw = loops.percept_draw(draws, k, step)
        for peer in range(len(game.cells)):
            if peer != k and not succeeds(draw, problem.percept[x, game.cells[peer]]):
                seen = loops.NO_ROW
        choice.rows[k] = seen
        values = minds.correction
        correct(minds, k, x, game.cells, seen)
        for b in range(PRIMITIVES):
            values[b] = minds.own.u[k, x, b] + values[b]
        if seen == loops.NO_ROW and epsilon > 0.0:
            if loops.drawn(draws, streams.BLIND, k, step, streams.BLIND_EXPLORE) < epsilon:
                return int(
                    loops.drawn(draws, streams.BLIND, k, step, streams.BLIND_ACTION) * PRIMITIVES
                )
        return loops.greedy_action(values, PRIMITIVES, draws, k, step, streams.PRIMITIVE_TIE)

    @staticmethod
    def learn(state: loops.State, minds: "FactoredMinds", now: loops.Transition) -> None:
        """Learn U, r_bar or rho and W, then replay, as `FactoredAgent.learn`."""
        step, k, y, reward, floor = now
        problem, _, choice, draws = state
        weights, rule = problem.weights, minds.rule
        x, m, seen = choice.cells[k], choice.moves[k], choice.rows[k]
        asked = choice.actions[k] == COORDINATE
        by_count = problem.alpha_by_count
        terms = terms_of(problem, problem.goals[k], weights)
        own = own_of(minds.own, k)
        individual = weights[0] * reward[0]
        once = reward[1] if minds.partners[k] != 0 else 0.0
        common = weights[1] * once
        factors.learn_move(own, x, m, y, individual, common, asked, terms, by_count, floor)
        if asked:
            size, team = minds.q_star.shape[1], len(choice.cells)
            sight = factors.Sight(seen == PERCEIVED, choice.cells, minds.ruled_out[x])
            if seen == loops.NO_ROW:
                brought = once if sight.ruled_out[x] else common
                key = factors.unseen_key(x, size, team)
                learn_row(minds.rows, k, key, m, brought, by_count, floor)
            for peer in range(team):
                if peer != k and seen == PERCEIVED:
                    brought = common if (minds.partners[k] >> peer) & 1 else 0.0
                    key = factors.key_of(x, peer, choice.cells[peer], size, team)
                    learn_row(minds.rows, k, key, m, brought, by_count, floor)
            if rule.look_back and own.last[0] == step:
                look_back(minds, own, k, sight, terms, by_count, floor)
            own.last[0], own.last[1] = step + 1, m
            for robot in range(team):
                known = robot == k or seen == PERCEIVED
                own.last[2 + robot] = choice.cells[robot] if known else factors.UNSEEN
            correct(minds, k, x, choice.cells, seen)
            factors.learn_asking(own, x, minds.correction, rule.percept_update, by_count, floor)
        factors.refresh(own, x, terms)
        if rule.replays > 0:
            factors.replay(
                own, rule.replays, loops.drawn(draws, streams.REPLAY, k, step, 0), terms
            )


@inlined
def own_of(team: factors.Own, k: int) -> factors.Own:
    """Return robot k's factors and model of those of all robots."""
    return factors.Own(
        team.u[k],
        team.r_bar[k],
        team.w[k],
        team.star[k],
        team.value[k],
        team.updates[k],
        team.door[k],
        team.commons[k],
        team.moved[k],
        team.successor[k],
        team.last[k],
        team.tried[k],
        team.used[k],
    )


@inlined
def correct(minds: FactoredMinds, k: int, x: int, cells: np.ndarray, seen: int) -> None:
    """Set `minds.correction` to Q^C(x, z, .) - U(x, .) of what robot k perceived.

    `minds.found` is set to the rows that it adds up to.
    """
    correction = minds.correction
    for b in range(PRIMITIVES):
        correction[b] = 0.0
    size, team = minds.q_star.shape[1], len(cells)
    if seen == loops.NO_ROW:
        add_row(minds.rows, k, factors.unseen_key(x, size, team), correction)
        return
    for peer in range(team):
        minds.found[peer] = loops.NO_ROW
        if peer != k and factors.counted(k, peer, x, cells[peer], minds.rule.right_of_way):
            key = factors.key_of(x, peer, cells[peer], size, team)
            minds.found[peer] = add_row(minds.rows, k, key, correction)


@inlined
def look_back(
    minds: FactoredMinds,
    own: factors.Own,
    k: int,
    sight: factors.Sight,
    terms: factors.Terms,
    by_count: np.ndarray,
    floor: float,
) -> None:
    """Learn from two questions in a row, as `FactoredAgent`."""
    rows, before, size, team = minds.rows, own.last[2:], minds.q_star.shape[1], len(sight.cells)
    x = before[k]
    for b in range(PRIMITIVES):
        s, known = own.successor[x][b], own.moved[x][b] > 0 and own.successor[x][b] != terms.goal
        minds.there[b] = surplus(minds, own, k, s, sight, terms.discount) if known else 0.0
        best = factors.best_of(own.u[s])
        for peer in range(team):
            row = minds.found[peer] if known and sight.perceived else loops.NO_ROW
            rho = rows.values[k, row, best] if row != loops.NO_ROW else 0.0
            minds.blame[b, peer] = min(0.0, rho)
    here = surplus(minds, own, k, x, sight, terms.discount)
    outlook = factors.Outlook(here, minds.there, minds.blame)
    for peer in range(team):
        blind = before[peer] == factors.UNSEEN
        if peer == k or blind and peer != (k == 0):  # a failed percept has one row
            continue
        key, peers = factors.key_of(x, peer, before[peer], size, team), 1 << peer
        if blind:
            key, peers = factors.unseen_key(x, size, team), ~(1 << k)
        row = row_to_learn(rows, k, key)
        rho, counts = rows.values[k, row], rows.updates[k, row]
        factors.look_back(own, x, rho, counts, peers, sight, outlook, by_count, floor)


@inlined
def surplus(
    minds: FactoredMinds,
    own: factors.Own,
    k: int,
    x: int,
    sight: factors.Sight,
    discount: float,
) -> float:
    """Return `factors.surplus` of what robot k perceived, were it in x."""
    correct(minds, k, x, sight.cells, PERCEIVED if sight.perceived else loops.NO_ROW)
    return factors.surplus(own, x, minds.correction, discount)


@inlined
def add_row(rows: Rows, k: int, key: int, correction: np.ndarray) -> int:
    """Add a row of rho, if there is one; return where it is, or `loops.NO_ROW`."""
    row, dense = key, rows.keys.shape[1] == 0
    if not dense:
        row = find_row(rows.keys[k], key)
    if not dense and rows.keys[k, row] == FREE_PLACE:
        return loops.NO_ROW
    for b in range(PRIMITIVES):
        correction[b] += rows.values[k, row, b]
    return row


@inlined
def learn_row(
    rows: Rows,
    k: int,
    key: int,
    m: int,
    common: float,
    by_count: np.ndarray,
    floor: float,
) -> None:
    """Learn one entry of rho, in a new row if there is none."""
    row = row_to_learn(rows, k, key)
    factors.learn_correction(rows.values[k, row], rows.updates[k, row], m, common, by_count, floor)
