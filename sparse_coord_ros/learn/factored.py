# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The agent that learns Q* and Q^C in factors (`learn.factors`)."""

import numpy as np

from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.game.links import PerceptStream
from sparse_coord_ros.game.perception import percept_probabilities, succeeds
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.streams import (
    BLIND,
    BLIND_ACTION,
    BLIND_EXPLORE,
    LEARNING,
    REPLAY,
    Stream,
)
from sparse_coord_ros.game.world import SUM_OF_PARTS, Action, Reward, RewardWeights
from sparse_coord_ros.learn.agent import Agent, Decision, Memory, Tables
from sparse_coord_ros.learn.factors import (
    UNSEEN,
    FactorMemory,
    FactorRule,
    Factors,
    Own,
    Terms,
    coordination_table,
    counted,
    key_of,
    keys_of,
    learn_asking,
    learn_correction,
    learn_move,
    refresh,
    replay,
    sorted_factors,
    states_of,
    unseen_key,
)

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


def initial_factored(scenario: Scenario, number: int, weights: RewardWeights) -> Tables:
    """Return one robot's tables before learning: U is `q_coord_init`, all else 0.

    Raises:
        SettingError: COORDINATE does not perceive every peer.
    """
    check_peers(scenario)
    cells, robots = len(scenario.map.cells), len(scenario.robots)
    factors = Factors(
        individual=np.full((cells, PRIMITIVES), scenario.q_coord_init),
        common=np.zeros((cells, PRIMITIVES)),
        asking=np.zeros(cells),
        states=np.empty((0, 3), dtype=np.int32),
        corrections=np.empty((0, PRIMITIVES)),
    )
    star = np.full((cells, PRIMITIVES + 1), scenario.q_coord_init + 0.0)
    star[:, COORDINATE] = scenario.q_coord_init - weights.ask_cost * scenario.ask_cost + 0.0
    return Tables(star, coordination_table(factors, number, robots), factors)


def terms_of(scenario: Scenario, goal: int, weights: RewardWeights) -> Terms:
    """Return the numbers of the rule for a robot with that goal."""
    arrival = weights.individual * scenario.goal_reward
    return Terms(
        cost=weights.ask_cost * scenario.ask_cost,
        discount=scenario.discount,
        goal=goal,
        goal_value=scenario.goal_value,
        arrival=arrival + scenario.discount * scenario.goal_value,
    )


class FactoredAgent(Agent):
    """Agent k: chooses as Algorithm 1 does, learns the factors of its two tables.

    A robot knows where a peer is if it perceived it, or if the peer asked it in this time step
    and the robot's own percept of the step would have succeeded: its own draw lies below the
    percept model's probability for the two cells. So a request gives no more than a percept.

    Args:
        scenario: the problem.
        number: k, from 0.
        seed: the run's seed.
        rule: the parts of the rule.
        weights: how much each part of a reward counts while it learns.
        tables: tables to go on from, with their factors; initial ones where None.
        learning: False: act greedily and never update.
        phase: LEARNING or EVALUATION: which random draws the agent uses.

    Raises:
        SettingError: COORDINATE does not perceive every peer.
    """

    def __init__(
        self,
        scenario: Scenario,
        number: int,
        seed: int,
        *,
        rule: FactorRule,
        weights: RewardWeights = SUM_OF_PARTS,
        tables: Tables | None = None,
        learning: bool = True,
        phase: int = LEARNING,
    ) -> None:
        begun = initial_factored(scenario, number, weights) if tables is None else tables
        super().__init__(
            scenario, number, seed, weights=weights, tables=begun, learning=learning, phase=phase
        )
        if begun.factors is None:
            raise ValueError("tables without factors")
        self._cells, self._robots = len(scenario.map.cells), len(scenario.robots)
        self._rule, self._terms = rule, terms_of(scenario, self.goal, weights)
        self._right_of_way = rule.right_of_way and self._robots > 2
        nothing = np.zeros((self._cells, PRIMITIVES), dtype=np.int64)
        factors = begun.factors
        self._take(
            begun.q_star,
            np.zeros(begun.q_star.shape, dtype=np.int64),
            FactorMemory(*factors[:3], nothing, nothing, nothing, np.empty(0, dtype=np.int64)),
        )
        keys = keys_of(factors.states, self._cells, self._robots).tolist()
        self._rho: dict[int, list[float]] = dict(
            zip(keys, factors.corrections.tolist(), strict=True)
        )
        self._counts: dict[int, list[int]] = {}
        self._by_count = self._step_sizes.by_count.tolist()
        self._floor = self._step_sizes.by_step.tolist()
        self._percepts = PerceptStream(scenario.link, seed, number, phase)
        self._probabilities = percept_probabilities(scenario.perception, scenario.map).tolist()
        self._replays = Stream(seed, number, REPLAY, phase)
        self._blind = Stream(seed, number, BLIND, phase)
        self._askers: dict[int, dict[int, int]] = {}

    def _take(self, star: np.ndarray, updates: np.ndarray, memory: FactorMemory) -> None:
        tried = np.zeros(self._cells * PRIMITIVES, dtype=np.int64)
        tried[: len(memory.tried)] = memory.tried
        self._own = Own(
            u=memory.individual.tolist(),
            r_bar=memory.common.tolist(),
            w=memory.asking.tolist(),
            star=star.tolist(),
            value=star.max(axis=1).tolist(),
            updates=updates.tolist(),
            commons=memory.commons.tolist(),
            moved=memory.moved.tolist(),
            successor=memory.successor.tolist(),
            tried=tried.tolist(),
            used=[len(memory.tried)],
        )

    @property
    def tables(self) -> Tables:
        """What it has learned so far; a copy."""
        own = self._own
        factors = sorted_factors(
            np.array(own.u),
            np.array(own.r_bar),
            np.array(own.w),
            np.fromiter(self._rho, dtype=np.int64),
            np.array(list(self._rho.values())).reshape(-1, PRIMITIVES),
            self._robots,
        )
        q_coord = coordination_table(factors, self.number, self._robots)
        return Tables(np.array(own.star), q_coord, factors)

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
            keys = [unseen_key(cell, self._cells, self._robots)]
        else:
            keys = [
                self._key(cell, j, z)
                for j, z in zip(self._peers, perceived, strict=True)
                if counted(self.number, j, cell, z, self._right_of_way)
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
            keys[UNSEEN, UNSEEN] = unseen_key(cell, self._cells, self._robots)
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
        if perceived is None and draws[BLIND_EXPLORE] < self.epsilon(step):
            return int(draws[BLIND_ACTION] * PRIMITIVES)
        return super().coordinate(step, cell, perceived)

    def values_asking(self, cell: int, perceived: tuple[int, ...] | None) -> list[float]:
        """Return U + rho, of what was perceived or of failed percepts."""
        correction = self.correction(cell, perceived)
        return [u + c for u, c in zip(self._own.u[cell], correction, strict=True)]

    def learn(
        self,
        step: int,
        cell: int,
        decision: Decision,
        action: Action,
        perceived: tuple[int, ...] | None,
        reward: Reward,
        next_cell: int,
    ) -> None:
        """Learn U, r_bar or rho and W, then replay; arguments as of `Agent.learn`."""
        if not self.learning:
            return
        own, rule, terms = self._own, self._rule, self._terms
        by_count, floor = self._by_count, self._floor[min(step, len(self._floor) - 1)]
        individual = self._weights.individual * reward.individual
        common = self._weights.common * (reward.common if reward.partners else 0.0)
        asked = decision.action == COORDINATE
        learn_move(
            own, cell, action.move, next_cell, individual, common, asked, terms, by_count, floor
        )
        for peer, place in self._known(step, cell, perceived).items():
            share = common if reward.partners >> peer & 1 else 0.0
            self._correct(self._key(cell, peer, place), action.move, share, floor)
        if asked:
            if perceived is None:
                key = unseen_key(cell, self._cells, self._robots)
                self._correct(key, action.move, common, floor)
            correction = self.correction(cell, perceived)
            learn_asking(own, cell, correction, rule.percept_update, by_count, floor)
        refresh(own, cell, terms)
        replay(own, rule.replays, self._replays.at(step)[0], terms)

    def _known(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> dict[int, int]:
        """Return the cells of the peers that it knows of, in ascending order of the peers."""
        if perceived is not None:
            return dict(zip(self._peers, perceived, strict=True))
        if not self._rule.share or step not in self._askers:
            return {}
        draw = self._percepts.at(step)[0]
        probabilities = self._probabilities[cell]
        askers = sorted(self._askers[step].items())
        return {peer: place for peer, place in askers if succeeds(draw, probabilities[place])}

    def _key(self, cell: int, peer: int, place: int) -> int:
        return key_of(cell, peer, place, self._cells, self._robots)

    def _correct(self, key: int, move: int, common: float, floor: float) -> None:
        rho = self._rho.setdefault(key, [0.0] * PRIMITIVES)
        counts = self._counts.setdefault(key, [0] * PRIMITIVES)
        learn_correction(rho, counts, move, common, self._by_count, floor)

    @property
    def asked_in(self) -> np.ndarray:
        """How often it has learned from COORDINATE in each cell, shape (cells,), int64."""
        return np.array(self._own.updates, dtype=np.int64)[:, COORDINATE]

    def memory(self) -> Memory:
        """Return what the agent has learned; a copy."""
        own = self._own
        keys = sorted(self._counts)
        return Memory(
            np.array(own.star),
            np.array(own.updates, dtype=np.int64),
            states_of(keys, self._cells, self._robots).reshape(len(keys), 3),
            np.array([self._rho[key] for key in keys]).reshape(len(keys), PRIMITIVES),
            np.array([self._counts[k] for k in keys], dtype=np.int64).reshape(-1, PRIMITIVES),
            FactorMemory(
                individual=np.array(own.u),
                common=np.array(own.r_bar),
                asking=np.array(own.w),
                commons=np.array(own.commons, dtype=np.int64),
                moved=np.array(own.moved, dtype=np.int64),
                successor=np.array(own.successor, dtype=np.int64),
                tried=np.array(own.tried[: own.used[0]], dtype=np.int64),
            ),
        )

    def go_on_from(self, memory: Memory) -> None:
        """Go on with what another agent of the same run has learned."""
        assert memory.factors is not None
        self._take(memory.q_star, memory.star_updates, memory.factors)
        keys = keys_of(memory.states, self._cells, self._robots).tolist()
        self._rho |= dict(zip(keys, memory.values.tolist(), strict=True))
        self._counts = dict(zip(keys, memory.updates.tolist(), strict=True))
