# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 once more, from the log alone: what a robot learns from what it was told."""

from copy import deepcopy
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.agent import NOBODY, Agent, Decision, Tables
from sparse_coord_ros.core.algorithm import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.factored import FactoredAgent
from sparse_coord_ros.core.frame import EAST_NORTH, Frame, action_numbers, reward_from
from sparse_coord_ros.core.schedules import exploration, step_sizes
from sparse_coord_ros.core.sparse import SparseTable
from sparse_coord_ros.core.streams import PEER, POLICY
from sparse_coord_ros.core.wire import ACCOUNT_LABELS, ACTION_LABELS
from sparse_coord_ros.core.world import Action
from sparse_coord_ros.engine.rerun import Learned, Rule, Said, as_lists, coordinates, loop
from sparse_coord_ros.runlog.draws import draws_at
from sparse_coord_ros.runlog.log import NONE, RunLog

BLOCK = 1 << 16
"""Actions whose draws and numbers are made ready at once."""


class Story(NamedTuple):
    """One robot's actions in the log, and what came of them; n actions, K robots.

    Attributes:
        row: which time step of the log, shape (n,).
        step: the time step.
        cell: where it was, next_cell: where it was a step later; NONE where the log does not say.
        action, move: A_k(t), and the primitive action that it became.
        peers: whom it asks if it chooses COORDINATE, shape (n, number of them).
        seen: in which cells it perceived them, shape (n, number of them); NONE in all where not.
        told: whether the log holds the reward and both states.
        learned: whether it has learned from the action.
        reward: shape (n, 4); partners: shape (n,), as of `RunLog`.
    """

    row: np.ndarray
    step: np.ndarray
    cell: np.ndarray
    next_cell: np.ndarray
    action: np.ndarray
    move: np.ndarray
    peers: np.ndarray
    seen: np.ndarray
    told: np.ndarray
    learned: np.ndarray
    reward: np.ndarray
    partners: np.ndarray


def tell(log: RunLog, k: int) -> Story:
    """Return robot k's story: what the log says, up to an action or a state that makes no sense.

    Whether it has learned from an action its next one says; from the last one the numbers beside
    the tables. Where nothing says so (format 1), it has where reward and both states are there.
    """
    rows = np.searchsorted(log.step, log.tracks.actions[k].step)
    odd = (log.cells[rows, k] == NONE) | (log.move[rows, k] == NONE)
    if odd.any():
        rows = rows[: int(np.argmax(odd))]
    step, count = log.step[rows], len(rows)
    after = np.minimum(rows + 1, len(log.step) - 1)
    followed = (rows + 1 < len(log.step)) & (log.step[after] == step + 1)
    next_cell = np.where(followed, log.cells[after, k], NONE)
    told = (next_cell != NONE) & ~np.isnan(log.reward[rows, k, 0])
    said = log.numbers[rows, k, len(ACTION_LABELS) + ACCOUNT_LABELS.index("learned")]
    learned = told & (not log.run.greedy)
    if log.tracks.format > 1:
        learned[:-1], learned[-1:] = said[1:] == 1.0, False
        for entry in log.all_tables:
            if entry.robot == k and count and entry.step > step[-1]:
                learned[-1] = entry.counts.get("learned", 0) > int(learned[:-1].sum())
    peers = _peers(log, k, step)
    seen = np.full(peers.shape, NONE, dtype=np.int64)
    percepts = log.tracks.percepts[k]
    right = percepts.step[percepts.rows["count"] == 1 + peers.shape[1]]
    if peers.size:
        seen = np.where(
            np.isin(step, right)[:, None], log.percept[rows[:, None], k, peers], NONE
        ).astype(np.int64)
        seen[(seen == NONE).any(axis=1)] = NONE
    return Story(
        row=rows,
        step=step,
        cell=log.cells[rows, k].astype(np.int64),
        next_cell=next_cell.astype(np.int64),
        action=log.action[rows, k].astype(np.int64),
        move=log.move[rows, k].astype(np.int64),
        peers=peers,
        seen=seen,
        told=told,
        learned=learned,
        reward=log.reward[rows, k],
        partners=log.partners[rows, k],
    )


def _peers(log: RunLog, k: int, step: np.ndarray) -> np.ndarray:
    """Return whom robot k asks at some time steps if it chooses COORDINATE."""
    others = np.array([other for other in range(len(log.names)) if other != k], dtype=np.int64)
    if log.run.scenario.peers == "all" or not len(others):
        return np.tile(others, (len(step), 1))
    draws = draws_at(log.run.seed, k, POLICY, step)[:, PEER]
    return others[(draws * len(others)).astype(np.int64)][:, None]


def due_numbers(story: Story) -> np.ndarray:
    """Return the numbers of the logged actions as they must be, by `ACTION_LABELS`."""
    asked = story.action == COORDINATE
    numbers = np.zeros((len(story.step), len(ACTION_LABELS)))
    numbers[:, :2] = np.array(EAST_NORTH)[story.move]
    numbers[:, 2] = asked
    if story.peers.shape[1] == 1:
        numbers[:, 3] = np.where(asked, story.peers[:, 0] + 1, 0)
    numbers[:, 4] = asked & (story.seen != NONE).all(axis=1) & (story.seen.shape[1] > 0)
    return numbers


def askers(log: RunLog, k: int) -> dict[int, list[tuple[int, int]]]:
    """Return who asked robot k at which time step, and from which cell: those that it heard."""
    frame = Frame(log.run)
    heard: dict[int, list[tuple[int, int]]] = {}
    for request in log.requests:
        answer = request.said or request.answer
        cell = frame.cell(*request.position)
        if request.peer == k and cell is not None and answer and answer[0] == request.step:
            heard.setdefault(request.step, []).append((request.asker, cell))
    return heard


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
        self._log, self._k, self._story = log, k, story
        self._agent: Agent | None = None
        if not log.run.rule.compiled or log.run.rule.factors is not None:
            self._askers = askers(log, k) if log.run.rule.factors is not None else {}
            self._agent = log.run.rule.agent(
                log.run.scenario, k, log.run.seed, tables=deepcopy(tables), learning=_learns(log)
            )
            return
        self._begun = tables
        self._loop, self._arrays = loop(len(story.step), compiled=compiled)
        self._prepare(tables)

    def _prepare(self, tables: Tables) -> None:
        log, story = self._log, self._story
        scenario, rule = log.run.scenario, log.run.rule
        budget = scenario.steps if _learns(log) else 0
        alpha = step_sizes(scenario.step_size, budget)
        self._epsilon = exploration(scenario.epsilon, budget) * _learns(log)
        self._floor = alpha.by_step
        self._by_count = alpha.by_count if self._arrays else alpha.by_count.tolist()
        actions = len(ACTIONS) if rule.asks else PRIMITIVES
        weights = tuple(float(weight) for weight in rule.weights(scenario))
        self._rule = Rule(
            actions,
            _learns(log),
            scenario.robots[self._k].goal,
            float(scenario.discount),
            float(scenario.goal_value),
            weights,  # type: ignore[arg-type]
        )
        perceived = (story.seen != NONE).all(axis=1) & (story.seen.shape[1] > 0)
        states = np.concatenate([story.cell[:, None], story.seen], axis=1)[perceived]
        self._keys, place = np.unique(states, axis=0, return_inverse=True)
        self._rows = np.full(len(story.step), -1, dtype=np.int64)
        self._rows[perceived] = place.reshape(-1)
        q_coord = np.empty((len(self._keys), PRIMITIVES))
        for row, key in enumerate(self._keys.tolist()):
            q_coord[row] = tables.q_coord[tuple(key)]
        q_star = np.array(tables.q_star, dtype=np.float64)
        learned = Learned(
            q_star,
            q_coord,
            np.zeros(q_star.shape, dtype=np.int64),
            np.zeros(q_coord.shape, dtype=np.int64),
            np.array([coordinates(row, actions) for row in q_star.tolist()], dtype=np.uint8),
        )
        self._learned = learned if self._arrays else as_lists(learned)
        self._block = (0, 0)

    def advance(self, to: int) -> bool:
        """Go on to an action; return whether all before it are the logged ones."""
        while self.reached < to and self.other is None:
            if self._agent is not None:
                self._step(self._agent)
                continue
            first, end = self._block
            if not first <= self.reached < end:
                self._load(self.reached)
                first, end = self._block
            stop = min(to, end)
            found, action, move = self._loop(
                self._rule,
                self._learned,
                self._said,
                self._by_count,
                self.reached - first,
                stop - first,
            )
            self.reached = first + found
            if self.reached < stop:
                self.other = self._action(self.reached, action, move)
        return self.other is None

    def _load(self, begin: int) -> None:
        """Make a block of actions ready."""
        story = self._story
        part = slice(begin, begin + BLOCK)
        scheduled = np.minimum(story.step[part], len(self._epsilon) - 1)
        said = Said(
            cell=story.cell[part],
            next_cell=story.next_cell[part],
            action=story.action[part],
            move=story.move[part],
            row=self._rows[part],
            learned=story.learned[part],
            reward=story.reward[part, :3],
            draws=draws_at(self._log.run.seed, self._k, POLICY, story.step[part]),
            epsilon=self._epsilon[scheduled],
            alpha=self._floor[scheduled],
        )
        self._said = said if self._arrays else as_lists(said)
        self._block = (begin, min(begin + BLOCK, len(story.step)))

    def _action(self, i: int, action: int, move: int) -> Action:
        """Return an action that came of a choice."""
        asked = action == COORDINATE
        peers = self._story.peers[i]
        peer = int(peers[0]) if asked and len(peers) == 1 else NOBODY
        return Action(int(move), asked, peer, asked and self._seen(i) is not None)

    def _seen(self, i: int) -> tuple[int, ...] | None:
        seen = tuple(self._story.seen[i].tolist())
        return seen if seen and NONE not in seen else None

    def _step(self, agent: Agent) -> None:
        """Let the agent itself choose, and learn."""
        story, i = self._story, self.reached
        step, cell = int(story.step[i]), int(story.cell[i])
        decision: Decision = agent.decide(step, cell)
        seen = self._seen(i) if decision.peers else None
        action = agent.act(step, cell, decision, seen)
        logged = (int(story.action[i]) == COORDINATE, int(story.move[i]))
        if (action.asked, action.move) != logged:
            self.other = action
            return
        if story.learned[i]:
            self.hear(i)
            said = story.partners[i : i + 1]
            reward = reward_from([*story.reward[i].tolist(), *said[~np.isnan(said)].tolist()])
            agent.learn(step, cell, decision, action, seen, reward, int(story.next_cell[i]))
        self.reached += 1

    def hear(self, i: int) -> None:
        """Let the agent know who asked it in the time step of an action."""
        if self._agent is not None:
            step = int(self._story.step[i])
            for peer, place in self._askers.get(step, ()):
                self._agent.asked(step, peer, place)

    def values(self, i: int) -> list[float]:
        """Return the four values by which COORDINATE goes at an action, by the tables now."""
        seen, cell = self._seen(i), int(self._story.cell[i])
        if self._agent is not None:
            return self._agent.values_asking(cell, seen)[:PRIMITIVES]
        return [self.entry(cell, *(seen or ()), action=a) for a in range(PRIMITIVES)]

    def corrections(self, i: int) -> dict[tuple[int, int], float]:
        """Return rho of an action's move by (peer, its cell), by the tables now.

        What the robot learns from the action can change these: the peers that it perceived or that
        asked it, and `UNSEEN` where its percept failed. Learners without factors have none.
        """
        if not isinstance(self._agent, FactoredAgent):
            return {}
        cell, move = int(self._story.cell[i]), int(self._story.move[i])
        return self._agent.corrections(int(self._story.step[i]), cell, self._seen(i), move)

    def entry(self, *state: int, action: int) -> float:
        """Return an entry of Q* (of a cell) or of Q^C (of a joint state of the story)."""
        if self._agent is not None:
            tables = self._agent.tables
            return float((tables.q_star if len(state) == 1 else tables.q_coord)[(*state, action)])
        if len(state) == 1:
            return float(self._learned.q_star[state[0]][action])
        row = int(np.flatnonzero((self._keys == state).all(axis=1))[0])
        return float(self._learned.q_coord[row][action])

    @property
    def shows(self) -> bytes:
        """For each cell 1 where the robot would choose COORDINATE, else 0."""
        if self._agent is not None:
            rows, actions = self._agent.tables.q_star.tolist(), self._agent.actions
            return bytes(coordinates(row, actions) for row in rows)
        return bytes(self._learned.shows)

    def tables(self) -> Tables:
        """Return what is learned so far."""
        if self._agent is not None:
            return self._agent.tables
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
            assert isinstance(begun, np.ndarray)  # learners with other tables are followed apart
            q_coord = begun.copy()
        for key, row in zip(self._keys[updated].tolist(), rows[updated].tolist(), strict=True):
            for action, value in enumerate(row):
                q_coord[(*key, action)] = value
        return Tables(q_star, q_coord)


def _learns(log: RunLog) -> bool:
    return not log.run.greedy


def said_otherwise(logged: np.ndarray, computed: Action | np.ndarray) -> tuple[str, str]:
    """Return in which numbers an action differs, as (logged, computed)."""
    due = computed.tolist() if isinstance(computed, np.ndarray) else action_numbers(computed)
    pairs = zip(ACTION_LABELS, logged.tolist(), due, strict=False)
    odd = [(name, a, b) for name, a, b in pairs if repr(a) != repr(b)]
    return (
        " ".join(f"{name}={a:g}" for name, a, _ in odd),
        " ".join(f"{name}={b:g}" for name, _, b in odd),
    )
