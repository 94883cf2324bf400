# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot once more, from the log alone: what it chooses and learns from what it was told."""

from copy import deepcopy

import numpy as np

from sparse_coord_ros.engine.rerun import coordinates
from sparse_coord_ros.game.world import Action
from sparse_coord_ros.learn.agent import NOBODY, Agent, Decision, Tables
from sparse_coord_ros.learn.algorithm import COORDINATE, PRIMITIVES
from sparse_coord_ros.learn.factored import FactoredAgent
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.relearned import Relearned, RelearnedFactors, RelearnedTables
from sparse_coord_ros.runlog.story import Story, askers
from sparse_coord_ros.wire import ACTION_LABELS
from sparse_coord_ros.wire.frame import action_numbers, reward_from


class Follower:
    """One robot's tables, as it learns again what its story tells.

    Args:
        log: the log.
        k: the robot's number.
        story: its story.
        tables: what it began with.
        compiled: as of `engine.rerun.loop`; of learners without a compiled form it has no effect.

    Attributes:
        reached: the action that is next; everything before it is learned, it is not yet chosen.
        other: None, or what it chooses at `reached` where the log says another action.
    """

    def __init__(
        self, log: RunLog, k: int, story: Story, tables: Tables, *, compiled: bool | None = None
    ) -> None:
        self.reached = 0
        self.other: Action | None = None
        self._story = story
        self._learner: Relearned | _Agent
        if not log.run.rule.compiled:
            self._learner = _Agent(log, k, story, tables)
        elif log.run.rule.factors is not None:
            self._learner = RelearnedFactors(log, k, story, tables, compiled)
        else:
            self._learner = RelearnedTables(log, k, story, tables, compiled)

    def advance(self, to: int) -> bool:
        """Go on to an action; return whether all before it are the logged ones."""
        if self.reached < to and self.other is None:
            self.reached, action, move = self._learner.follow(self.reached, to)
            if self.reached < to:
                asked, peers = action == COORDINATE, self._story.peers[self.reached]
                peer = int(peers[0]) if asked and len(peers) == 1 else NOBODY
                seen = asked and self._story.seen_at(self.reached) is not None
                self.other = Action(int(move), asked, peer, seen)
        return self.other is None

    def values(self, i: int) -> list[float]:
        """Return the four values by which COORDINATE goes at an action, by the tables now."""
        return self._learner.values(i)

    def corrections(self, i: int) -> dict[tuple[int, int], float]:
        """Return rho of an action's move by (peer, its cell), by the tables now.

        What the robot learns from the action can change these: the peers that it perceived or that
        asked it, and `UNSEEN` where its percept failed. Learners without factors have none.
        """
        return self._learner.corrections(i)

    def entry(self, *state: int, action: int) -> float:
        """Return an entry of Q* (of a cell) or of Q^C (of a joint state of the story)."""
        return self._learner.entry(*state, action=action)

    @property
    def shows(self) -> bytes:
        """For each cell 1 where the robot would choose COORDINATE, else 0."""
        return self._learner.shows

    def tables(self) -> Tables:
        """Return what is learned so far."""
        return self._learner.tables()


class _Agent:
    """An agent of the user's own, fed action by action; has what `Relearned` has."""

    def __init__(self, log: RunLog, k: int, story: Story, tables: Tables) -> None:
        self._story = story
        self._agent: Agent = log.run.rule.agent(
            log.run.scenario, k, log.run.seed, tables=deepcopy(tables), learning=not log.run.greedy
        )
        self._askers = askers(log, k)

    def follow(self, begin: int, to: int) -> tuple[int, int, int]:
        """Let the agent itself choose, and learn; as of `engine.rerun.follow`."""
        agent, story = self._agent, self._story
        for i in range(begin, to):
            step, cell = int(story.step[i]), int(story.cell[i])
            decision: Decision = agent.decide(step, cell)
            seen = story.seen_at(i) if decision.peers else None
            action = agent.act(step, cell, decision, seen)
            if (action.asked, action.move) != (story.action[i] == COORDINATE, story.move[i]):
                return i, COORDINATE if action.asked else action.move, action.move
            if story.learned[i]:
                self._hear(step)
                said = story.partners[i : i + 1]
                reward = reward_from([*story.reward[i].tolist(), *said[~np.isnan(said)].tolist()])
                agent.learn(step, cell, decision, action, seen, reward, int(story.next_cell[i]))
        return to, 0, 0

    def values(self, i: int) -> list[float]:
        cell, seen = int(self._story.cell[i]), self._story.seen_at(i)
        return self._agent.values_asking(cell, seen)[:PRIMITIVES]

    def corrections(self, i: int) -> dict[tuple[int, int], float]:
        story, step = self._story, int(self._story.step[i])
        if not isinstance(self._agent, FactoredAgent):
            return {}
        self._hear(step)
        return self._agent.corrections(
            step, int(story.cell[i]), story.seen_at(i), int(story.move[i])
        )

    def _hear(self, step: int) -> None:
        """Let the agent know who asked it in a time step."""
        for peer, place in self._askers.get(step, ()):
            self._agent.asked(step, peer, place)

    def entry(self, *state: int, action: int) -> float:
        tables = self._agent.tables
        return float((tables.q_star if len(state) == 1 else tables.q_coord)[(*state, action)])

    @property
    def shows(self) -> bytes:
        rows, actions = self._agent.tables.q_star.tolist(), self._agent.actions
        return bytes(coordinates(row, actions) for row in rows)

    def tables(self) -> Tables:
        return self._agent.tables


def said_otherwise(logged: np.ndarray, computed: Action | np.ndarray) -> tuple[str, str]:
    """Return in which numbers an action differs, as (logged, computed)."""
    due = computed.tolist() if isinstance(computed, np.ndarray) else action_numbers(computed)
    pairs = zip(ACTION_LABELS, logged.tolist(), due, strict=False)
    odd = [(name, a, b) for name, a, b in pairs if repr(a) != repr(b)]
    return (
        " ".join(f"{name}={a:g}" for name, a, _ in odd),
        " ".join(f"{name}={b:g}" for name, _, b in odd),
    )
