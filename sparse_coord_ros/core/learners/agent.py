# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One robot in plain Python: it decides, acts and learns, with any learner.

Robot nodes, the verification of logs, films and PettingZoo's tests drive this object; the loops
of `core.runs.loop` call the same functions for all robots of a team.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import viewed
from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import LEARNING, PEER, draw
from sparse_coord_ros.core.game.perception import asked_peers
from sparse_coord_ros.core.game.plugins import is_shipped
from sparse_coord_ros.core.game.rules import UNKNOWN_PARTNERS
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.mind import Memory, memory_of, team_mind, with_room
from sparse_coord_ros.core.learners.rules import (
    NOT_PERCEIVED,
    Transition,
    check_action,
    everybody_but,
    greedy_action,
    scheduled,
)
from sparse_coord_ros.core.learners.tables import Tables

NOBODY = -1
"""In place of a peer: the robot asked none, or several."""


class Decision(NamedTuple):
    """An agent's choice at a time step, before active perception.

    Attributes:
        action: A_k(t): a move, or COORDINATE.
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


DOING = {
    "begin_episode": "beginning an episode",
    "decide": "deciding",
    "act": "acting",
    "values_asking": "acting",
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
        task: its team's task.
        mind: its team's mind, of which it uses its own part.
        peers: the other robots, in ascending order.
        values_at_last: the values by which its last COORDINATE chose a move.
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
        self.values_at_last = [0.0] * PRIMITIVES
        task = learner.task(scenario, seed, phase, learning=learning)
        self.task = viewed(task)
        self.go_on_from(memory)
        if not is_shipped(learner):
            for name, doing in DOING.items():
                setattr(self, name, _blaming(learner, doing, getattr(self, name)))

    def go_on_from(self, memory: Memory | None) -> None:
        """Continue with the memory of another agent of the same run; None: an empty one."""
        memories = () if memory is None else (memory,)
        self.mind = team_mind(self.learner, self.scenario, [self.number], memories)

    def begin_episode(self) -> None:
        """Begin an episode."""
        self.learner.begin_episode(self.mind, self.task, self.number)

    def decide(self, step: int, cell: int) -> Decision:
        """Choose A_k(t): the learner's way to explore (Algorithm 1, line 4), or greedily."""
        k = self.number
        if self.learning:
            action = self.learner.decide(self.mind, self.task, k, step, cell)
            check_action(action, self.task.actions)
        else:
            action = greedy_action(self.mind, self.task, k, step, cell)
        if action != COORDINATE:
            return Decision(action)
        chance = draw(self.task.keys[k], step, PEER)
        peers = asked_peers(self.scenario.peers, k, self.task.robots, chance)
        return Decision(action, peers)

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
        seen, cells = self._percept(cell, decision.peers, perceived)
        k = self.number
        values = [0.0] * PRIMITIVES
        self.learner.asking_values(self.mind, self.task, k, cell, seen, cells, values)
        move = self.learner.move_after_asking(
            self.mind, self.task, k, step, cell, seen, cells, values
        )
        check_action(move, PRIMITIVES)
        self.values_at_last = values
        return action_of(decision, move, perceived=perceived is not None)

    def learn(
        self,
        step: int,
        choice: Choice,
        reward: Reward,
        next_cell: int,
        team: tuple[Sequence[int], Sequence[int]] | None = None,
    ) -> None:
        """Learn from a transition (Algorithm 1, lines 12 to 18).

        Args:
            step: t.
            choice: what it did there.
            reward: R_k(t) in its parts.
            next_cell: X_k(t+1).
            team: the cells of all robots at t and at t+1; only needed with `task.sees_all`.
        """
        if not self.learning:
            return
        cell, decision, action, perceived = choice
        if self.task.sees_all:
            assert team is not None
            seen = everybody_but(self.number, self.task.robots)
            cells, next_cells = team
        else:
            seen, cells = self._percept(cell, decision.peers, perceived)
            _, next_cells = self._percept(next_cell, (), None)
        now = Transition(
            step=step,
            cell=cell,
            action=decision.action,
            move=action.move,
            answered=perceived is not None,
            seen=seen,
            cells=cells,
            next_cell=next_cell,
            next_cells=next_cells,
            individual=reward.individual,
            common=reward.common,
            asking=reward.ask_cost,
            partners=reward.partners if self.learner.partners else UNKNOWN_PARTNERS,
        )
        after = self.task.goal_value
        if next_cell != self.goal:
            after = self.learner.bootstrap(
                self.mind, self.task, self.number, next_cell, now
            )
        self.learner.learn(self.mind, self.task, self.number, now, after)
        if self.task.full[0]:
            self.mind = with_room(self.mind)
            self.task.full[0] = False

    def epsilon(self, step: int) -> float:
        """Return the probability of exploring at a time step; 0 without learning."""
        return scheduled(self.task.epsilon, step) if self.learning else 0.0

    @property
    def q_star(self) -> np.ndarray:
        """Q*, shape (cells, actions); a copy."""
        q_star: np.ndarray = self.mind.q_star[self.number].copy()
        return q_star

    def values(self, cell: int) -> list[float]:
        """Return Q*(cell, .)."""
        values: list[float] = self.mind.q_star[self.number, cell].tolist()
        return values

    def values_asking(
        self, cell: int, perceived: tuple[int, ...] | None
    ) -> list[float]:
        """Return the values by which COORDINATE chooses a move: Q^C, or Q* after a failed percept.

        Args:
            cell: X_k(t).
            perceived: the local states of the asked peers, in their order (of one peer of several
                it does not matter which it is); None where ActivePercept is FALSE.
        """
        peers = () if perceived is None else self.peers[: len(perceived)]
        seen, cells = self._percept(cell, peers, perceived)
        values = [0.0] * PRIMITIVES
        self.learner.asking_values(
            self.mind, self.task, self.number, cell, seen, cells, values
        )
        return [float(value) for value in values]

    @property
    def asked_in(self) -> np.ndarray:
        """How often it has learned from COORDINATE in each cell, shape (cells,), int64."""
        asked: np.ndarray = self.mind.updates[self.number, :, COORDINATE].copy()
        return asked

    @property
    def tables(self) -> Tables:
        """The learned tables, a copy."""
        return Tables(self.scenario, self.learner, self.number, self.memory())

    def memory(self) -> dict[str, np.ndarray]:
        """Return the memory, a copy."""
        return memory_of(self.learner, self.mind, self.number)

    def _percept(
        self, cell: int, peers: tuple[int, ...], perceived: tuple[int, ...] | None
    ) -> tuple[int, list[int]]:
        """Return the peers that are perceived, the sum of 2^j, and the cells that are known."""
        cells = [NOT_PERCEIVED] * self.task.robots
        cells[self.number] = cell
        seen = 0
        if perceived is not None:
            for peer, peer_cell in zip(peers, perceived, strict=True):
                seen |= 1 << peer
                cells[peer] = peer_cell
        return seen, cells


def action_of(decision: Decision, move: int, *, perceived: bool) -> Action:
    """Return the action of an agent, from its decision and its move."""
    asks = decision.action == COORDINATE
    peers = decision.peers
    peer = peers[0] if asks and len(peers) == 1 else NOBODY
    return Action(move, asks, peer, asks and perceived)
