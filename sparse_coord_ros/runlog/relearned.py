# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot's loop of `engine.rerun` learns again from its log, as tables or as factors."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from sparse_coord_ros.engine.rerun import (
    FactorRules,
    Learned,
    LearnedFactors,
    Rule,
    Said,
    SaidFactors,
    as_lists,
    coordinates,
    correct,
    loop,
)
from sparse_coord_ros.game.perception import percept_probabilities
from sparse_coord_ros.game.schedules import exploration, step_sizes
from sparse_coord_ros.game.streams import BLIND, POLICY, REPLAY
from sparse_coord_ros.game.world import UNKNOWN_PARTNERS
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.algorithm import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.learn.factored import terms_of
from sparse_coord_ros.learn.factors import (
    UNSEEN,
    Own,
    coordination_table,
    key_of,
    keys_of,
    sorted_factors,
    unseen_key,
)
from sparse_coord_ros.learn.sparse import SparseTable
from sparse_coord_ros.runlog.draws import draws_at, percept_draws
from sparse_coord_ros.runlog.log import NONE, RunLog
from sparse_coord_ros.runlog.story import Story, askers

BLOCK = 1 << 16
"""Actions whose draws and numbers are made ready at once."""


class Relearned(ABC):
    """One robot's tables, and the loop that learns them again.

    Args:
        log: the log.
        k: the robot's number.
        story: its story.
        tables: what it began with.
        loop_name: of `engine.rerun.LOOPS`.
        compiled: as of `engine.rerun.loop`.
    """

    def __init__(
        self,
        log: RunLog,
        k: int,
        story: Story,
        tables: Tables,
        loop_name: str,
        compiled: bool | None,
    ) -> None:
        self._log, self._k, self._story, self._begun = log, k, story, tables
        self._loop, self._arrays = loop(loop_name, len(story.step), compiled=compiled)
        scenario = log.run.scenario
        self._learning = not log.run.greedy
        budget = scenario.steps if self._learning else 0
        alpha = step_sizes(scenario.step_size, budget)
        self._epsilon = exploration(scenario.epsilon, budget) * self._learning
        self._floor = alpha.by_step
        # A forged log may have more actions than the run has steps.
        more = max(0, len(story.step) + 2 - len(alpha.by_count))
        by_count = np.concatenate([alpha.by_count, np.repeat(alpha.by_count[-1:], more)])
        self._by_count = self._native(by_count)
        self._actions = len(ACTIONS) if log.run.rule.asks else PRIMITIVES
        weights = log.run.rule.weights(scenario)
        self._weights = (float(weights[0]), float(weights[1]), float(weights[2]))
        self._block = (0, 0)

    def _native(self, values: Any) -> Any:
        """Return arrays as the loop takes them."""
        return values if self._arrays else as_lists(values)

    def follow(self, begin: int, to: int) -> tuple[int, int, int]:
        """Go on from an action to another, or to the first that the log says otherwise.

        Returns:
            As of `engine.rerun.follow`.
        """
        first, end = self._block
        if not first <= begin < end:
            first, end = begin, min(begin + BLOCK, len(self._story.step))
            self._block, self._said = (first, end), self._native(self._say(slice(first, end)))
        stop = min(to, end)
        arguments = (self._rule, self._learned, self._said, self._by_count)
        found, action, move = self._loop(*arguments, begin - first, stop - first)
        if found == stop - first < to - first:
            return self.follow(stop, to)
        return first + found, action, move

    _rule: Any
    _learned: Any

    @abstractmethod
    def _say(self, part: slice) -> Any:
        """Return what the log says of some actions, as arrays."""

    def _said_of_all(self, part: slice) -> dict[str, Any]:
        """Return what the log says of some actions, whoever learns."""
        story = self._story
        steps = story.step[part]
        scheduled = np.minimum(steps, len(self._epsilon) - 1)
        return {
            **{name: getattr(story, name)[part] for name in ("cell", "next_cell", "action")},
            "move": story.move[part],
            "learned": story.learned[part],
            "reward": story.reward[part, :3],
            "draws": self._draws(POLICY, steps),
            "epsilon": self._epsilon[scheduled],
            "alpha": self._floor[scheduled],
        }

    def _draws(self, role: int, steps: np.ndarray) -> np.ndarray:
        return draws_at(self._log.run.seed, self._k, role, steps)

    @property
    @abstractmethod
    def shows(self) -> bytes:
        """For each cell 1 where the robot would choose COORDINATE, else 0."""

    @abstractmethod
    def tables(self) -> Tables:
        """Return what is learned so far."""

    @abstractmethod
    def entry(self, *state: int, action: int) -> float:
        """Return an entry of Q* (of a cell) or of Q^C (of a joint state of the story)."""

    @abstractmethod
    def values(self, i: int) -> list[float]:
        """Return the four values by which COORDINATE goes at an action."""

    def corrections(self, i: int) -> dict[tuple[int, int], float]:
        """Return rho of an action's move by (peer, its cell); empty without factors."""
        return {}


class RelearnedTables(Relearned):
    """Q* and Q^C; arguments as of `Relearned`."""

    def __init__(
        self, log: RunLog, k: int, story: Story, tables: Tables, compiled: bool | None
    ) -> None:
        super().__init__(log, k, story, tables, "follow_tables", compiled)
        scenario = log.run.scenario
        self._rule = Rule(
            self._actions,
            self._learning,
            scenario.robots[k].goal,
            float(scenario.discount),
            float(scenario.goal_value),
            self._weights,
        )
        states = np.concatenate([story.cell[:, None], story.seen], axis=1)[story.perceived]
        self._keys, place = np.unique(states, axis=0, return_inverse=True)
        self._rows = np.full(len(story.step), -1, dtype=np.int64)
        self._rows[story.perceived] = place.reshape(-1)
        q_coord = np.empty((len(self._keys), PRIMITIVES))
        for row, key in enumerate(self._keys.tolist()):
            q_coord[row] = tables.q_coord[tuple(key)]
        q_star = np.array(tables.q_star, dtype=np.float64)
        self._learned = self._native(
            Learned(
                q_star,
                q_coord,
                np.zeros(q_star.shape, dtype=np.int64),
                np.zeros(q_coord.shape, dtype=np.int64),
                np.array(
                    [coordinates(row, self._actions) for row in q_star.tolist()], dtype=np.uint8
                ),
            )
        )

    def _say(self, part: slice) -> Said:
        return Said(row=self._rows[part], **self._said_of_all(part))

    @property
    def shows(self) -> bytes:
        """As of `Relearned`."""
        return bytes(self._learned.shows)

    def values(self, i: int) -> list[float]:
        """As of `Relearned`."""
        cell, seen = int(self._story.cell[i]), self._story.seen_at(i)
        return [self.entry(cell, *(seen or ()), action=a) for a in range(PRIMITIVES)]

    def entry(self, *state: int, action: int) -> float:
        """As of `Relearned`."""
        if len(state) == 1:
            return float(self._learned.q_star[state[0]][action])
        row = int(np.flatnonzero((self._keys == state).all(axis=1))[0])
        return float(self._learned.q_coord[row][action])

    def tables(self) -> Tables:
        """As of `Relearned`."""
        q_star = np.array(self._learned.q_star)
        rows = np.array(self._learned.q_coord).reshape(-1, PRIMITIVES)
        updated = np.array(self._learned.coord_updates).reshape(-1, PRIMITIVES).any(axis=1)
        begun = self._begun.q_coord
        q_coord: np.ndarray | SparseTable
        if isinstance(begun, SparseTable):
            q_coord = SparseTable(
                begun.shape[0], len(begun.shape) - 1, begun.unseen, begun.keys, begun.rows
            )
        else:
            assert isinstance(begun, np.ndarray)  # tables without factors
            q_coord = begun.copy()
        for key, row in zip(self._keys[updated].tolist(), rows[updated].tolist(), strict=True):
            for action, value in enumerate(row):
                q_coord[(*key, action)] = value
        return Tables(q_star, q_coord)


class RelearnedFactors(Relearned):
    """Q* and Q^C in factors; arguments as of `Relearned`."""

    def __init__(
        self, log: RunLog, k: int, story: Story, tables: Tables, compiled: bool | None
    ) -> None:
        super().__init__(log, k, story, tables, "follow_factors", compiled)
        scenario, rule, begun = log.run.scenario, log.run.rule.factors, tables.factors
        assert rule is not None
        assert begun is not None
        self._cells, self._robots = len(scenario.map.cells), len(scenario.robots)
        self._rule = FactorRules(
            self._actions,
            self._learning,
            self._weights,
            terms_of(scenario, scenario.robots[k].goal, log.run.rule.weights(scenario)),
            rule.replays,
            rule.percept_update,
        )
        self._places = self._known_places(rule.share)
        self._keys, self._known, self._unseen = self._rows()
        self._counted = self._known.copy()
        if rule.right_of_way and self._robots > 2:  # as `learn.factors.counted` says
            first = self._places[:, k:] == story.cell[:, None]
            self._counted[:, k:][first] = -1
        keys = keys_of(begun.states, self._cells, self._robots).tolist()
        self._started = dict(zip(keys, begun.corrections.tolist(), strict=True))
        rho = np.zeros((len(self._keys), PRIMITIVES))
        for row, key in enumerate(self._keys.tolist()):
            rho[row] = self._started.get(key, 0.0)
        star = np.array(tables.q_star, dtype=np.float64)
        counts = np.zeros((self._cells, PRIMITIVES), dtype=np.int64)
        own = Own(
            u=begun.individual.copy(),
            r_bar=begun.common.copy(),
            w=begun.asking.copy(),
            star=star,
            value=star.max(axis=1),
            updates=np.zeros(star.shape, dtype=np.int64),
            commons=counts,
            moved=counts.copy(),
            successor=counts.copy(),
            tried=np.zeros(counts.size, dtype=np.int64),
            used=np.zeros(1, dtype=np.int64),
        )
        peers = np.array([j for j in range(self._robots) if j != k], dtype=np.int64)
        space = np.zeros(PRIMITIVES)
        rows = LearnedFactors(
            own, rho, np.zeros(rho.shape, dtype=np.int64), peers, space, space.copy()
        )
        self._learned = self._native(rows)

    def _known_places(self, share: bool) -> np.ndarray:
        """Return in which cells the robot knows its peers at each action, NONE where not.

        It perceived them, or one asked it and its own percept of the step would have succeeded.
        """
        log, story = self._log, self._story
        places = story.seen.copy()
        places[~story.perceived] = NONE
        if not share:
            return places
        asked = askers(log, self._k)
        rows = np.flatnonzero(np.isin(story.step, list(asked)) & ~story.perceived)
        probabilities = percept_probabilities(log.run.scenario.perception, log.run.scenario.map)
        draws = percept_draws(log.run, self._k, story.step[rows])
        for row, draw in zip(rows.tolist(), draws.tolist(), strict=True):
            for peer, place in dict(asked[int(story.step[row])]).items():
                if draw < probabilities[story.cell[row], place]:
                    places[row, peer - (peer > self._k)] = place
        return places

    def _rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the keys of the rows of rho, and the rows of each action: known and unseen."""
        story, cells, robots = self._story, self._cells, self._robots
        keys = np.full((len(story.step), robots), -1, dtype=np.int64)
        for place, peer in enumerate(j for j in range(robots) if j != self._k):
            there = self._places[:, place] != NONE
            z = self._places[there, place]
            keys[there, place] = key_of(story.cell[there], peer, z, cells, robots)
        blind = ~story.perceived
        keys[blind, -1] = unseen_key(story.cell[blind], cells, robots)
        unique, number = np.unique(keys, return_inverse=True)
        rows = number.reshape(keys.shape) - int(unique[:1].sum() == -1)  # none stays -1
        unique = unique[unique >= 0]
        return unique, np.ascontiguousarray(rows[:, :-1]), np.ascontiguousarray(rows[:, -1])

    def _say(self, part: slice) -> SaidFactors:
        story, steps = self._story, self._story.step[part]
        partners = story.partners[part]
        named = np.isfinite(partners)
        return SaidFactors(
            known=self._known[part],
            counted=self._counted[part],
            unseen=self._unseen[part],
            partners=np.where(named, np.where(named, partners, 0), UNKNOWN_PARTNERS).astype(
                np.int64
            ),
            blind=self._draws(BLIND, steps),
            replay=self._draws(REPLAY, steps)[:, 0],
            **self._said_of_all(part),
        )

    @property
    def shows(self) -> bytes:
        """As of `Relearned`."""
        star = np.asarray(self._learned.own.star)
        asks: np.ndarray = star[:, COORDINATE] > star[:, :PRIMITIVES].max(axis=1)
        return bytes(asks)

    def values(self, i: int) -> list[float]:
        """As of `Relearned`."""
        correct(self._learned, self._counted[i].tolist(), int(self._unseen[i]))
        u = self._learned.own.u[int(self._story.cell[i])]
        return [float(u[b] + self._learned.correction[b]) for b in range(PRIMITIVES)]

    def corrections(self, i: int) -> dict[tuple[int, int], float]:
        """Return rho of an action's move by (peer, its cell).

        What the robot learns from the action can change these: the peers that it perceived or that
        asked it, and `UNSEEN` where its percept failed.
        """
        move, rho = int(self._story.move[i]), self._learned.rho
        peers = [int(peer) for peer in self._learned.peers]
        places, rows = self._places[i].tolist(), self._known[i].tolist()
        known = [(peer, z, row) for peer, z, row in zip(peers, places, rows, strict=True)]
        known += [(UNSEEN, UNSEEN, int(self._unseen[i]))]
        return {(peer, z): float(rho[row][move]) for peer, z, row in known if row >= 0}

    def entry(self, *state: int, action: int) -> float:
        """As of `Relearned`."""
        if len(state) == 1:
            return float(self._learned.own.star[state[0]][action])
        return float(self.tables().q_coord[(*state, action)])

    def tables(self) -> Tables:
        """As of `Relearned`."""
        own = self._learned.own
        rho = dict(self._started)
        rho |= dict(zip(self._keys.tolist(), np.array(self._learned.rho).tolist(), strict=True))
        factors = sorted_factors(
            np.array(own.u),
            np.array(own.r_bar),
            np.array(own.w),
            np.fromiter(rho, dtype=np.int64),
            np.array(list(rho.values())).reshape(-1, PRIMITIVES),
            self._robots,
        )
        q_coord = coordination_table(factors, self._k, self._robots)
        return Tables(np.array(own.star), q_coord, factors)
