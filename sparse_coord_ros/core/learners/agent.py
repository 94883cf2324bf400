# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One robot in plain Python: it decides, acts and learns, with any learner.

Robot nodes, the verification of logs, films and PettingZoo's tests drive this object; the loops
of `core.runs.loop` call the same functions for all robots of a team.
"""

from array import array
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import (
    LEARNING,
    PEER,
    REPLAY,
    ROBOT,
    draw,
    key_of,
)
from sparse_coord_ros.core.game.perception import asked_peers
from sparse_coord_ros.core.game.plugins import is_shipped
from sparse_coord_ros.core.game.rules import UNKNOWN_PARTNERS
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.schedules import probabilities, step_sizes
from sparse_coord_ros.core.game.specs import Spec
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners import rules
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.mind import Memory, as_lists, memory_of
from sparse_coord_ros.core.learners.policy import choose, choose_move
from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED, Task, Transition
from sparse_coord_ros.core.learners.tables import Tables

NOBODY = -1
"""In place of a peer: the robot asked none, or several."""


class Decision(NamedTuple):
    """An agent's choice at a time step, before active perception.

    Attributes:
        action: A_k(t), as of `core.game.actions`.
        peers: the agents to ask where the action is COORDINATE, in ascending order; else none.
    """

    action: int
    peers: tuple[int, ...] = ()


class Choice(NamedTuple):
    """What an agent did at a time step.

    Attributes:
        cell: X_k(t).
        decision: A_k(t).
        action: the primitive action that it became.
        perceived: the perceived local states of the asked peers; None where it did not ask, or
            ActivePercept is FALSE.
    """

    cell: int
    decision: Decision
    action: Action
    perceived: tuple[int, ...] | None


class Schedules(NamedTuple):
    """Numbers by time step or by count, for plain Python: compact, and quick to index.

    Attributes:
        epsilon: probability of an explored action [time step].
        floors: least step size [time step].
        step_sizes: the step size of the n-th update of an entry, without the floor [n].
    """

    epsilon: Any
    floors: Any
    step_sizes: Any


@lru_cache(maxsize=8)
def schedules(epsilon: Spec, step_size: Spec, budget: int) -> Schedules:
    """Return the schedules of a run; they are kept, as all robots of a process share them."""
    sizes = step_sizes(step_size, budget)
    tables = (probabilities(epsilon, budget), sizes.by_step, sizes.by_count)
    return Schedules(*(array("d", table.tobytes()) for table in tables))


DOING = {
    "begin_episode": "beginning an episode",
    "decide": "deciding",
    "act": "acting",
    "values_asking": "acting",
    "move_if_it_waits": "acting",
    "learn": "learning",
}
"""What a learner does in the methods of an agent."""


def _blaming(
    learner: Learner, doing: str, method: Callable[..., Any]
) -> Callable[..., Any]:
    """Return a method that reports a failure of the user's own learner in one line."""

    def blaming(*args: Any) -> Any:
        with learner.blamed(doing):
            return method(*args)

    return blaming


class Agent:
    """Agent k of a learner.

    Args:
        learner: the learner.
        scenario: the problem; the agent uses its sizes, its learning protocol and the robot's
            goal.
        number: k, from 0.
        seed: the run's seed.
        memory: a memory to continue with; None: an empty one.
        learning: False: act greedily and never learn.
        phase: LEARNING or EVALUATION: which random draws the agent uses.

    Attributes:
        learner, scenario, number, learning: as of the arguments.
        goal: the cell that ends its episodes.
        task: its task.
        mind: its learned tables, as lists; they change as it learns.
        peers: the other robots, in ascending order.
    """

    def __init__(
        self,
        learner: Learner,
        scenario: Scenario,
        number: int,
        seed: int,
        *,
        memory: Memory | None = None,
        learning: bool = True,
        phase: int = LEARNING,
    ) -> None:
        self.learner = learner
        self.scenario = scenario
        self.number = number
        self.learning = learning
        self.goal = scenario.robots[number].goal
        self.peers = tuple(k for k in range(len(scenario.robots)) if k != number)
        self._asks_whom = scenario.peers
        self._weights = learner.weights(scenario)
        self._schedules = schedules(
            scenario.epsilon, scenario.step_size, scenario.steps
        )
        self._key = key_of(seed, phase, number, ROBOT)
        self._values = [0.0] * PRIMITIVES
        self._initial = learner.mind(scenario, number)
        self.task = learner.task(scenario, number, self._schedules.step_sizes)
        self.mind = as_lists(self._initial, memory)
        if not is_shipped(learner):
            for name, doing in DOING.items():
                setattr(self, name, _blaming(learner, doing, getattr(self, name)))

    def begin_episode(self) -> None:
        """Begin an episode."""
        rules.begin_episode(self.mind, self.task)

    def decide(self, step: int, cell: int) -> Decision:
        """Choose A_k(t) by the learning policy pi_epsilon (Algorithm 1, line 4)."""
        epsilon = self.epsilon(step)
        values = self.mind.q_star[cell]
        action = choose(values, self.task.actions, epsilon, self._key, step)
        if action != COORDINATE:
            return Decision(action)
        which = draw(self._key, step, PEER)
        return Decision(
            action, asked_peers(self._asks_whom, self.number, self.task.robots, which)
        )

    def act(
        self,
        step: int,
        cell: int,
        decision: Decision,
        perceived: tuple[int, ...] | None,
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
        move = self._move(self.task, step, cell, decision.peers, perceived)
        return action_of(decision, move, perceived=perceived is not None)

    def move_if_it_waits(
        self, step: int, cell: int, perceived: tuple[int, ...] | None
    ) -> int:
        """Return the move that COORDINATE becomes if the robot does not leave a stand-off.

        `act` returns another move only if the robot leaves a stand-off.

        Args:
            step: t.
            cell: X_k(t).
            perceived: as of `values_asking`.
        """
        waiting = self.task._replace(leaves=False)
        return self._move(waiting, step, cell, self._seen(perceived), perceived)

    def _move(
        self,
        task: Task,
        step: int,
        cell: int,
        peers: tuple[int, ...],
        perceived: tuple[int, ...] | None,
    ) -> int:
        """Return the move that COORDINATE becomes; arguments as of `act`."""
        seen, cells = self._percept(cell, peers, perceived)
        epsilon = self.epsilon(step)
        return choose_move(
            self.mind, task, cell, seen, cells, epsilon, self._key, step, self._values
        )

    def learn(self, step: int, choice: Choice, reward: Reward, next_cell: int) -> None:
        """Learn from a transition (Algorithm 1, lines 12 to 18).

        Args:
            step: t.
            choice: what it did there.
            reward: R_k(t) in its parts.
            next_cell: X_k(t+1).
        """
        if not self.learning:
            return
        cell, decision, action, perceived = choice
        weights = self._weights
        seen, cells = self._percept(cell, decision.peers, perceived)
        partners = reward.partners if self.learner.partners else UNKNOWN_PARTNERS
        replay = 0.0
        if self.learner.draws:
            replay = draw(self._key, step, REPLAY)
        now = Transition(
            step=step,
            cell=cell,
            action=decision.action,
            move=action.move,
            seen=seen,
            cells=cells,
            next_cell=next_cell,
            next_seen=0,
            next_cells=cells,
            individual=weights.individual * reward.individual,
            common=weights.common * reward.common,
            felt=reward.common,
            asking=weights.ask_cost * reward.ask_cost,
            partners=partners,
            epsilon=self.epsilon(step),
            floor=self._scheduled(self._schedules.floors, step),
            draw=replay,
        )
        rules.learn(self.mind, self.task, now)

    def epsilon(self, step: int) -> float:
        """Return the probability of exploring at a time step; 0 without learning."""
        return self._scheduled(self._schedules.epsilon, step) if self.learning else 0.0

    def values(self, cell: int) -> list[float]:
        """Return Q*(cell, .)."""
        return list(self.mind.q_star[cell])

    def values_asking(
        self, cell: int, perceived: tuple[int, ...] | None
    ) -> list[float]:
        """Return the values by which COORDINATE chooses a move: Q^C, or Q* after a failed percept.

        Args:
            cell: X_k(t).
            perceived: the local states of the asked peers, in their order (of one peer of several
                it does not matter which it is); None where ActivePercept is FALSE.
        """
        seen, cells = self._percept(cell, self._seen(perceived), perceived)
        rules.asking_values(self.mind, self.task, cell, seen, cells, self._values)
        return list(self._values)

    @property
    def asked_in(self) -> np.ndarray:
        """How often it has learned from COORDINATE in each cell, shape (cells,), int64."""
        return np.array([row[COORDINATE] for row in self.mind.updates], dtype=np.int64)

    @property
    def tables(self) -> Tables:
        """The learned tables, a copy."""
        return Tables(self.scenario, self.learner, self.number, self.memory())

    def memory(self) -> dict[str, np.ndarray]:
        """Return the memory, a copy."""
        return memory_of(self.mind)

    def go_on_from(self, memory: Memory) -> None:
        """Continue with the memory of another agent of the same run, after a check."""
        self.mind = as_lists(self._initial, memory)

    def _seen(self, perceived: tuple[int, ...] | None) -> tuple[int, ...]:
        """Return peers that are in these cells, as of `values_asking`."""
        return () if perceived is None else self.peers[: len(perceived)]

    def _percept(
        self, cell: int, peers: tuple[int, ...], perceived: tuple[int, ...] | None
    ) -> tuple[int, list[int]]:
        """Return the peers that are perceived, the sum of 2^j, and the cells that are known."""
        cells = [NOT_PERCEIVED] * self.task.robots
        cells[self.number] = cell
        seen = 0
        if perceived is not None:
            for peer, place in zip(peers, perceived, strict=True):
                seen |= 1 << peer
                cells[peer] = place
        return seen, cells

    @staticmethod
    def _scheduled(values: Any, step: int) -> float:
        found: float = values[min(step, len(values) - 1)]
        return found


def action_of(decision: Decision, move: int, *, perceived: bool) -> Action:
    """Return the action of an agent, from its decision and its move."""
    asks = decision.action == COORDINATE
    peers = decision.peers
    peer = peers[0] if asks and len(peers) == 1 else NOBODY
    return Action(move, asks, peer, asks and perceived)
