# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The agent that learns Q* and Q^C in factors (`learn.factors`)."""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sparse_coord_ros.compiling import inlined, inner
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game import streams
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.links import Percepts
from sparse_coord_ros.game.perception import succeeds
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.world import (
    UNKNOWN_PARTNERS,
    Reward,
    RewardWeights,
)
from sparse_coord_ros.learn import factors, loops
from sparse_coord_ros.learn.agent import Agent, Choice, Memory, Tables, with_memories
from sparse_coord_ros.learn.algorithm import Values
from sparse_coord_ros.learn.archive import MOST_UPDATES, check_range, member
from sparse_coord_ros.learn.rows import FREE_PLACE, Rows, find_row, make_rows, row_to_learn

if TYPE_CHECKING:
    from sparse_coord_ros.learn.learners import Learner

VALUES = ("u", "r_bar", "w", "door")
REMEMBERED = (*VALUES, "commons", "moved", "successor", "last", "tried")
"""Fields of `Own` that an agent remembers as `Memory.more`; of `tried` only what is in use."""

STEPS_AT_ONCE = 3
"""Time steps whose askers are remembered: a peer may ask in the next step before the reward of the
last one has come."""


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

    A robot knows where a peer is if it perceived it, or if the peer asked it in this time step
    and the robot's own percept of the step would have succeeded: its own draw lies below the
    percept model's probability for the two cells. So a request gives no more than a percept.

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
        self._percepts = Percepts(scenario, seed, phase)
        self._replays = streams.Stream(seed, number, streams.REPLAY, phase)
        self._blind = streams.Stream(seed, number, streams.BLIND, phase)
        self._askers: dict[int, dict[int, int]] = {}

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
        if perceived is None:
            keys = [factors.unseen_key(cell, self._cells, self._robots)]
        else:
            keys = [
                self._key(cell, j, z)
                for j, z in zip(self._peers, perceived, strict=True)
                if factors.counted(self.number, j, cell, z, self._right_of_way)
            ]
        correction = [0.0] * PRIMITIVES
        for row in (self._rho[key] for key in keys if key in self._rho):
            for b in range(PRIMITIVES):
                correction[b] += row[b]
        return correction

    def corrections(
        self, step: int, cell: int, perceived: tuple[int, ...] | None, move: int
    ) -> dict[tuple[int, int], float]:
        """Return rho of a move where a step teaches it, by (peer, its cell).

        Args:
            step: t; who asked the robot in it is known.
            cell: the own cell.
            perceived: the peers' cells; None where nothing was perceived: the row of failed
                percepts is there as well.
            move: the primitive action.
        """
        keys = {
            (peer, place): self._key(cell, peer, place)
            for peer, place in self._known(step, cell, perceived).items()
        }
        if perceived is None:
            keys[factors.UNSEEN, factors.UNSEEN] = factors.unseen_key(
                cell, self._cells, self._robots
            )
        nothing = [0.0] * PRIMITIVES
        return {place: self._rho.get(key, nothing)[move] for place, key in keys.items()}

    def asked(self, step: int, peer: int, cell: int) -> None:
        """Take note that a peer asks in a time step, from that cell."""
        self._askers.setdefault(step, {})[peer] = cell
        if len(self._askers) > STEPS_AT_ONCE:
            del self._askers[min(self._askers)]

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
        common = self.weights.common * (reward.common if reward.partners else 0.0)
        asked = decision.action == COORDINATE
        factors.learn_move(
            own, cell, action.move, next_cell, individual, common, asked, terms, by_count, floor
        )
        for peer, place in self._known(step, cell, perceived).items():
            share = common if reward.partners >> peer & 1 else 0.0
            self._correct(self._key(cell, peer, place), action.move, share, floor)
        if perceived is not None:
            if rule.look_back and own.last[0] == step:
                self._look_back(perceived, floor)
            own.last[:2] = step + 1, action.move
            for peer, place in zip((self.number, *self._peers), (cell, *perceived), strict=True):
                own.last[2 + peer] = place
        if asked:
            if perceived is None:
                key = factors.unseen_key(cell, self._cells, self._robots)
                once = reward.common if reward.partners else 0.0
                self._correct(key, action.move, once, floor)
            correction = self.correction(cell, perceived)
            factors.learn_asking(own, cell, correction, rule.percept_update, by_count, floor)
        factors.refresh(own, cell, terms)
        factors.replay(own, rule.replays, self._replays.at(step)[0], terms)

    def _look_back(self, perceived: tuple[int, ...], floor: float) -> None:
        """Learn from two percepts in a row what other moves would have brought in the first."""
        own, before = self._own, self._own.last[2:]
        x = before[self.number]
        u, correction = own.u[x], self.correction(x, perceived)
        ahead = self.discount * (factors.gain(u, correction) - own.w[x])
        keys = [self._key(x, peer, before[peer]) for peer in self._peers]
        best = u.index(max(u))
        rows = [self._rho.setdefault(key, [0.0] * PRIMITIVES) for key in keys]
        worst = min(range(len(rows)), key=lambda place: rows[place][best])
        for place, (key, row, z) in enumerate(zip(keys, rows, perceived, strict=True)):
            counts = self._counts.setdefault(key, [0] * PRIMITIVES)
            owed = ahead if place == worst and row[best] < 0.0 else 0.0
            factors.look_back(own, x, row, counts, z, owed, self._by_count, floor)

    def _known(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> dict[int, int]:
        """Return the cells of the peers that it knows of, in ascending order of the peers."""
        if perceived is not None:
            return dict(zip(self._peers, perceived, strict=True))
        if not self._rule.share or step not in self._askers:
            return {}
        sees = functools.partial(self._percepts.sees, step, self.number, cell)
        return {peer: place for peer, place in sorted(self._askers[step].items()) if sees(place)}

    def _key(self, cell: int, peer: int, place: int) -> int:
        return factors.key_of(cell, peer, place, self._cells, self._robots)

    def _correct(self, key: int, move: int, common: float, floor: float) -> None:
        rho = self._rho.setdefault(key, [0.0] * PRIMITIVES)
        counts = self._counts.setdefault(key, [0] * PRIMITIVES)
        factors.learn_correction(rho, counts, move, common, self._by_count, floor)

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

    def go_on_from(self, memory: Memory) -> None:
        """Go on with what another agent of the same run has learned.

        Raises:
            ValueError: it is of another run.
        """
        cells, most = self._cells, {"successor": self._cells, "last": None}
        shapes: dict[str, tuple[int | None, ...]] = {"w": (cells,), "door": (cells,)}
        shapes |= {"last": (2 + self._robots,), "tried": (None,)}
        for name in REMEMBERED:
            shape = shapes.get(name, (cells, PRIMITIVES))
            if name in VALUES:
                member(memory.more, name, np.float64, *shape)
            else:
                below = most.get(name, MOST_UPDATES)
                member(memory.more, name, np.int64, *shape, below=below)
        check_range(memory.more["last"][1:2], 0, PRIMITIVES, "last")
        check_range(memory.more["last"][2:], 0, cells, "last")
        counted = np.flatnonzero(memory.star_updates[:, :PRIMITIVES])
        if not np.array_equal(np.sort(memory.more["tried"]), counted):
            raise ValueError("tried are not the moves that were counted")
        factors.check_states(memory.states, cells, self._robots)
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
        askers: who asked the robot in this time step [k]: the sum of 2^j of the robots j.
        partners: as of `game.world.Reward` [k].
        correction: space for Q^C(x, z, .) - U(x, .) [move].
        rule: the parts of the rule; `right_of_way` is False for two robots.
    """

    q_star: np.ndarray
    star_updates: np.ndarray
    rows: Rows
    own: factors.Own
    askers: np.ndarray
    partners: np.ndarray
    correction: np.ndarray
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
            askers=np.zeros(team, dtype=np.int64),
            partners=np.full(team, UNKNOWN_PARTNERS, dtype=np.int64),
            correction=np.zeros(PRIMITIVES),
            rule=learner.factors._replace(right_of_way=learner.factors.right_of_way and team > 2),
        )

    def tables(self, scenario: Scenario, learner: "Learner") -> list[Tables]:
        """Return what each robot has learned."""
        robots = range(len(self.askers))
        return [factored_tables(self.memory(k, scenario), k, len(robots)) for k in robots]

    def memory(self, k: int, scenario: Scenario) -> Memory:
        """Return what robot k has learned, as its agent remembers it; a copy."""
        keys, values, updates = self.rows.learned(k)
        states = factors.states_of(keys, len(scenario.map.cells), len(self.askers))
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
        """Nobody has asked yet; where everybody is, also who has arrived."""
        cells = state.game.cells
        for k in range(len(cells)):
            minds.askers[k] = 0
            state.choice.cells[k] = cells[k]

    @staticmethod
    def end_step(state: loops.State, minds: "FactoredMinds") -> None:
        """Note what the referee says."""
        if state.problem.referee:
            loops.find_partners(state, minds.partners)

    @staticmethod
    def coordinate(
        state: loops.State, minds: "FactoredMinds", step: int, k: int, epsilon: float
    ) -> int:
        """Turn COORDINATE into a move by U + rho; each peer that was asked takes note."""
        problem, game, choice, draws = state
        x = game.cells[k]
        seen = PERCEIVED if len(game.cells) > 1 else loops.NO_ROW
        draw = loops.percept_draw(draws, k, step)
        for peer in range(len(game.cells)):
            if peer != k:
                minds.askers[peer] |= 1 << k
                if not succeeds(draw, problem.percept[x, game.cells[peer]]):
                    seen = loops.NO_ROW
                    break
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
        size, team = minds.q_star.shape[1], len(choice.cells)
        perceived = asked and seen == PERCEIVED
        if perceived or minds.askers[k] != 0:
            learn_known(state, minds, step, k, common, perceived, floor)
        if perceived:
            look_back(minds, own, step, k, choice.cells, terms.discount, by_count, floor)
            own.last[0], own.last[1] = step + 1, m
            for peer in range(team):
                own.last[2 + peer] = choice.cells[peer]
        if asked:
            if not perceived:
                key = factors.unseen_key(x, size, team)
                learn_row(minds.rows, k, key, m, once, by_count, floor)
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
    """Set `minds.correction` to Q^C(x, z, .) - U(x, .) of what robot k perceived."""
    correction = minds.correction
    for b in range(PRIMITIVES):
        correction[b] = 0.0
    size, team = minds.q_star.shape[1], len(cells)
    if seen == loops.NO_ROW:
        add_row(minds.rows, k, factors.unseen_key(x, size, team), correction)
        return
    for peer in range(team):
        if peer != k and factors.counted(k, peer, x, cells[peer], minds.rule.right_of_way):
            add_row(minds.rows, k, factors.key_of(x, peer, cells[peer], size, team), correction)


@inlined
def learn_known(
    state: loops.State,
    minds: FactoredMinds,
    step: int,
    k: int,
    common: float,
    perceived: bool,
    floor: float,
) -> None:
    """Learn rho of the peers that robot k knows the cells of."""
    problem, choice, partners = state.problem, state.choice, minds.partners[k]
    x, m, size, team = choice.cells[k], choice.moves[k], minds.q_star.shape[1], len(choice.cells)
    for peer in range(team):
        z = choice.cells[peer]
        known = perceived
        if not known and minds.rule.share and (minds.askers[k] >> peer) & 1:
            draw = loops.percept_draw(state.draws, k, step)
            known = succeeds(draw, problem.percept[x, z])
        if known and peer != k:
            share = common if (partners >> peer) & 1 else 0.0
            key = factors.key_of(x, peer, z, size, team)
            learn_row(minds.rows, k, key, m, share, problem.alpha_by_count, floor)


@inlined
def look_back(
    minds: FactoredMinds,
    own: factors.Own,
    step: int,
    k: int,
    cells: np.ndarray,
    discount: float,
    by_count: np.ndarray,
    floor: float,
) -> None:
    """Learn from two percepts in a row, as `FactoredAgent`; nothing if there was but one."""
    if not minds.rule.look_back or own.last[0] != step:
        return
    rows, before, size, team = minds.rows, own.last[2:], minds.q_star.shape[1], len(cells)
    x = before[k]
    correct(minds, k, x, cells, PERCEIVED)
    ahead = discount * (factors.gain(own.u[x], minds.correction) - own.w[x])
    best, worst, least = np.argmax(own.u[x]), -1, 0.0
    for peer in range(team):
        if peer != k:
            row = row_to_learn(rows, k, factors.key_of(x, peer, before[peer], size, team))
            if rows.values[k, row, best] < least:
                worst, least = peer, rows.values[k, row, best]
    for peer in range(team):
        if peer != k:
            row = row_to_learn(rows, k, factors.key_of(x, peer, before[peer], size, team))
            rho, counts, owed = rows.values[k, row], rows.updates[k, row], 0.0
            if peer == worst:
                owed = ahead
            factors.look_back(own, x, rho, counts, cells[peer], owed, by_count, floor)


@inlined
def add_row(rows: Rows, k: int, key: int, correction: np.ndarray) -> None:
    """Add a row of rho, if there is one."""
    row, dense = key, rows.keys.shape[1] == 0
    if not dense:
        row = find_row(rows.keys[k], key)
    if dense or rows.keys[k, row] != FREE_PLACE:
        for b in range(PRIMITIVES):
            correction[b] += rows.values[k, row, b]


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
