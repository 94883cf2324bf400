# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What matters in a recorded run: where robots ask, meet and change their minds, and what for."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.grid import GridMap, regions
from sparse_coord_ros.core.game.interactions import (
    can_miscoordinate,
    interactions_of,
    miscoordinations,
)
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.agent import NOBODY, Agent
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.evaluation import check_tables, greedy_agents
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.runlog.growing import Episodes
from sparse_coord_ros.log.runlog.log import RunLog, learning_steps
from sparse_coord_ros.protocol.wire import COORDINATION_MAP, PerceptEnd
from sparse_coord_ros.protocol.wire.messages import OCCUPIED, Messages
from sparse_coord_ros.show.narrator import Narrator
from sparse_coord_ros.show.page.controls import (
    CROSSING,
    EXCHANGE,
    MISCOORDINATION,
    POLICY,
    QUESTION,
    STEP_KINDS,
    STOPPED,
)
from sparse_coord_ros.show.policy import entered, policy_of
from sparse_coord_ros.show.steps import (
    exchanges_in,
    logged_step,
    questions_of,
    stops_in,
)


def kinds_of(scenario: Scenario) -> list[str]:
    """Return the kinds of key steps that a scenario can have."""
    inter = interactions_of(scenario)
    kinds = [QUESTION, POLICY]
    kinds += [MISCOORDINATION] if can_miscoordinate(inter) else []
    kinds += [CROSSING] if scenario.map.doorways else []
    kinds += [EXCHANGE] if inter.swaps else []
    kinds += [STOPPED] if inter.blocks else []
    return kinds


class Change(NamedTuple):
    """Where a robot would ask from a time step on.

    Attributes:
        step: the time step.
        made: learning steps before it.
        asks: whether it would ask, by cell, shape (cells,).
    """

    step: int
    made: int
    asks: np.ndarray


class KeySteps:
    """Gathers the time steps that matter, part by part of a log.

    Args:
        run: the run.

    Attributes:
        steps: by kind the time steps, ascending.
        changes: of each robot, since when it would ask elsewhere.
    """

    def __init__(self, run: RunConfig) -> None:
        self.steps: dict[str, np.ndarray] = {
            kind: np.empty(0, np.int64) for kind in STEP_KINDS
        }
        self.changes: list[list[Change]] = [[] for _ in run.scenario.robots]
        self._run = run
        self._episodes = 0
        self._near = near_doorways(run.scenario.map)
        self._places = Messages(run).places

    def add(self, part: Episodes) -> None:
        """Take in a part of the log."""
        log = part.log
        asked = log.asked.any(axis=1)
        followed = np.diff(log.step, append=-1) == 1
        after = np.roll(log.cells, -1, axis=0)
        inter = interactions_of(self._run.scenario)
        met_next = miscoordinations(inter, log.cells.T, after.T) & followed
        exchanges = exchanges_in(inter, log.cells.T, after.T)
        next_cell = self._run.scenario.map.next_cell
        stops = stops_in(inter, next_cell, log.cells.T, log.move.T, after.T)
        for kind, pairs in ((EXCHANGE, exchanges), (STOPPED, stops)):
            happening = np.zeros(len(log.step), dtype=bool)
            for _, _, happened in pairs:
                happening |= happened
            self._add(kind, log.step[happening & followed])
        self._add(QUESTION, log.step[asked])
        self._add(MISCOORDINATION, log.step[met_next])
        if not len(self.steps[CROSSING]):
            self._add(CROSSING, self._first_crossing(part))
        self._add_policy_changes(log)
        self._episodes += len(np.unique(log.episode))

    def _add(self, kind: str, steps: np.ndarray) -> None:
        self.steps[kind] = np.concatenate([self.steps[kind], steps])

    def _first_crossing(self, part: Episodes) -> np.ndarray:
        """Return the first meeting at a doorway in an episode that goes well, shape (0 or 1,)."""
        log = part.log
        history = part.history
        fine = history.arrived.all(axis=1) & (history.miscoordinations == 0)
        good = log.episode[np.isin(log.step, history.first_step[fine])]
        at = np.isin(log.episode, good) & self.meetings(log.cells)
        first: np.ndarray = log.step[at][:1]
        return first

    def _add_policy_changes(self, log: RunLog) -> None:
        """Take in since when each robot would ask elsewhere than before."""
        for k, changes in enumerate(self.changes):
            steps, rows = log.series[COORDINATION_MAP, k]
            here = np.isin(steps, log.step)
            steps = steps[here]
            episodes = log.episode[np.searchsorted(log.step, steps)] + self._episodes
            for step, episode, data in zip(
                steps.tolist(), episodes.tolist(), rows["data"][here], strict=True
            ):
                asks = np.frombuffer(data, dtype=np.int8)[self._places] == OCCUPIED
                if not changes or (changes[-1].asks != asks).any():
                    changes.append(Change(step, learning_steps(step, episode), asks))
        changed = {change.step for changes in self.changes for change in changes[1:]}
        self.steps[POLICY] = np.array(sorted(changed), dtype=np.int64)

    def meetings(self, cells: np.ndarray, *, apart: bool = False) -> np.ndarray:
        """Return where two robots are in front of one doorway, or in it; cells (T, K): (T,).

        Args:
            cells: of each robot.
            apart: whether they must be in different cells.
        """
        meeting = np.zeros(len(cells), dtype=np.bool_)
        for near in self._near:
            here = np.isin(cells, near)
            met = here.sum(axis=1) >= 2
            if apart:
                lowest = np.where(here, cells, cells.max()).min(axis=1)
                highest = np.where(here, cells, cells.min()).max(axis=1)
                met &= lowest < highest
            meeting |= met
        return meeting

    def since(self, robot: int, cell: int) -> tuple[int, int | None]:
        """Return the first learning step, and since when a robot would ask in a cell to the end.

        The second value is None if it would not.
        """
        changes = self.changes[robot]
        since = None
        for change in changes:
            if not change.asks[cell]:
                since = None
            elif since is None:
                since = change.made
        first = changes[0].made if changes else 0
        return first, since


def near_doorways(grid: GridMap) -> list[np.ndarray]:
    """Return for each doorway the cells at most one move away, its own included, ascending.

    Doorway cells beside each other are one doorway.
    """
    inside = np.isin(np.arange(len(grid.cells)), sorted(grid.doorways))
    cell = np.arange(len(grid.cells))[:, None]
    lead = grid.next_cell
    region = regions(np.where(inside[lead] & inside[:, None], lead, cell))
    near = []
    for number in np.unique(region[inside]):
        cells = np.flatnonzero(inside & (region == number))
        near.append(np.union1d(cells, lead[cells]))
    return near


class Highlight(NamedTuple):
    """An episode that shows what was learned.

    Attributes:
        first, last: its time steps.
        step: of its most important question; None: no robot asks.
        robot: the robot that asks then; cell: its cell.
        text: the question and its consequence, in words; in a pair also of the other robot, if it
            asks then.
        matters: whether the robot would have made another move without the answer, as its tables
            say.
    """

    first: int
    last: int
    step: int | None
    robot: int
    cell: int
    text: str
    matters: bool


def highlight(
    log: RunLog, team: "LearnedTeam", key_steps: KeySteps, narrator: Narrator
) -> Highlight:
    """Return the latest episode of a part of a log in which what was learned matters most.

    That is where a robot asks, as its tables say that it would; goes where they say that it would
    go after this answer, and would not go without it; at a doorway at which the other one is, too,
    in another cell; best where several robots do so at once; and all arrive without a
    miscoordination. Cells that a greedy robot reaches from its start come first: an
    episode of learning may begin elsewhere.

    Args:
        log: the part, with at least one episode.
        team: what its robots learned.
        key_steps: of the run.
        narrator: of its scenario.
    """
    history = log.history()
    good = history.arrived.all(axis=1) & (history.miscoordinations == 0)
    begins = np.searchsorted(log.step, history.first_step)
    ends = begins + history.length
    ranks = _ranks(log, team, key_steps)
    number = _best_episode(ranks, begins, ends, good)
    begin = int(begins[number])
    end = int(ends[number])
    first = int(log.step[begin])
    last = int(log.step[end - 1])
    offset, k = divmod(int(ranks[begin:end].argmax()), len(log.names))
    row = begin + offset
    if not ranks[row, k]:
        what = "no robot asks another one"
        if log.asked.any():
            what = "no question is answered"
        text = f"In the last episodes {what}."
        return Highlight(first, last, None, 0, 0, text, False)
    cell = int(log.cells[row, k])
    step = logged_step(log, row)
    learned = team.would_do_it_again(step, k)
    text = _told(step, k, narrator, learned=learned)
    other = 1 - k
    in_a_pair = len(team.policies) == 2
    if in_a_pair and ranks[row, other] and team.learned_to_ask(step, other):
        text += f" {_told(step, other, narrator, learned=True)}"
    if not good[number]:
        met = ""
        if can_miscoordinate(interactions_of(log.run.scenario)):
            met = " without a miscoordination"
        text = f"Here not all robots arrive{met}. {text}"
    matters = team.learned_to_ask(step, k)
    return Highlight(first, last, int(log.step[row]), k, cell, text, matters)


def _ranks(log: RunLog, team: "LearnedTeam", key_steps: KeySteps) -> np.ndarray:
    """Return how much each answered question shows of what was learned, shape (T, K); others: 0.

    A rank is a binary number: each property outweighs all that come after it.
    """
    ranks = np.zeros(log.asked.shape, dtype=np.int64)
    apart = key_steps.meetings(log.cells, apart=True)
    for k, policy in enumerate(team.policies):
        rows = np.flatnonzero(log.asked[:, k] & log.perceived[:, k])
        cells = log.cells[rows, k]
        moves = log.move[rows, k]
        reached = np.isin(cells, team.reached[k])
        by_answer = [
            team.chose_by_answer(logged_step(log, row), k) for row in rows.tolist()
        ]
        asks = policy.asks[cells]
        another_move = ~policy.moves[cells, moves]
        ranks[rows, k] = (
            1
            + 64 * reached
            + 32 * np.array(by_answer, dtype=bool)
            + 16 * asks
            + 8 * another_move
            + 4 * apart[rows]
        )
    learned = ranks >= 1 + 64 + 32 + 16 + 8 + 4
    ranks += 2 * (learned & (learned.sum(axis=1, keepdims=True) >= 2))
    return ranks


def _best_episode(
    ranks: np.ndarray, begins: np.ndarray, ends: np.ndarray, good: np.ndarray
) -> int:
    """Return the latest of the episodes that show most.

    Args:
        ranks: the rank of each question, shape (T, K).
        begins: first row of each episode.
        ends: the row after its last one.
        good: whether all arrive in it without a miscoordination.
    """
    best = 0
    best_worth = (False, -1, False)
    for number in range(len(begins)):
        fine = bool(good[number])
        rank = int(ranks[begins[number] : ends[number]].max())
        worth = (fine and rank > 0, rank, fine)
        if worth >= best_worth:
            best = number
            best_worth = worth
    return best


def shown_by(
    steps: Sequence[TeamTransition], team: "LearnedTeam", narrator: Narrator
) -> str:
    """Return a question of a greedy episode whose answer changes the move, in words.

    Args:
        steps: the episode.
        team: what its robots learned.
        narrator: of its scenario.

    Returns:
        An empty text if there is no such question.
    """
    for step in steps:
        for question in questions_of(step):
            answered = question.end == PerceptEnd.ANSWERED
            if answered and team.learned_to_ask(step, question.asker):
                return _told(step, question.asker, narrator, learned=True)
    return ""


def _told(step: TeamTransition, k: int, narrator: Narrator, *, learned: bool) -> str:
    """Return an answered question in words.

    Args:
        step: the question's time step.
        k: the robot that asks.
        narrator: of the scenario.
        learned: whether its tables say that it would come there and do the same again; if not,
            or if it asks several robots, only what happened is told.
    """
    [question] = [question for question in questions_of(step) if question.asker == k]
    if not learned or len(question.peers) != 1:
        return f"Here {narrator.question(step, question)}"
    [peer] = question.peers
    cell = step.cells[k]
    at = step.cells[peer]
    assert cell is not None  # it asked
    assert at is not None  # it answered
    move = question.move
    answer = narrator.answer(cell, [(peer, at)])
    does = narrator.does(k, cell, move, narrator.led(cell, move))
    return f"{narrator.names[k]} asks {narrator.where(cell)}, and {does} if {answer}."


class LearnedTeam:
    """What the tables of a team say that its robots do.

    Args:
        run: the run.
        tables: of every robot.

    Attributes:
        policies: of each robot.
        reached: the cells that each robot enters from its start by its policy.

    Raises:
        TablesError: the tables do not fit the run.
    """

    def __init__(self, run: RunConfig, tables: Sequence[Tables]) -> None:
        self.policies = []
        self.reached = []
        for robot, robot_tables in zip(run.scenario.robots, tables, strict=True):
            policy = policy_of(robot_tables, robot.goal)
            self.policies.append(policy)
            self.reached.append(entered(policy, run.scenario.map, robot.start))
        self._agents: list[Agent] = []
        if run.known_rule is not None:
            check_tables(run.scenario, tables, run.rule)
            self._agents = greedy_agents(run.scenario, tables, run.seed, run.rule)
        self._next_cell = run.scenario.map.next_cell
        self._led = cache(self._greatest)

    def _greatest(
        self, k: int, cell: int, perceived: tuple[int, ...]
    ) -> frozenset[int]:
        """Return to which cells the moves lead that are greatest in a robot's row of Q^C."""
        values = self._agents[k].values_asking(cell, perceived)[:PRIMITIVES]
        greatest = np.equal(values, max(values))
        return frozenset(self._next_cell[cell][greatest].tolist())

    def would_do_it_again(self, step: TeamTransition, k: int) -> bool:
        """Whether a robot comes to this cell by its tables, asks there, and moves as it did."""
        cell = step.cells[k]
        comes = cell in self.reached[k]
        asks = bool(self.policies[k].asks[cell])
        return comes and asks and self.chose_by_answer(step, k)

    def learned_to_ask(self, step: TeamTransition, k: int) -> bool:
        """Whether a robot would ask there again, and make another move without the answer."""
        action = step.actions[k]
        cell = step.cells[k]
        if action is None or cell is None or not self.would_do_it_again(step, k):
            return False
        return not self.policies[k].moves[cell, action.move]

    def chose_by_answer(self, step: TeamTransition, k: int) -> bool:
        """Whether a robot that got an answer made the move that its tables now say.

        False where its learner's code may not be imported, as then that is not known, and where
        its tables leave open to which cell it goes.
        """
        if not self._agents:
            return False
        action = step.actions[k]
        cell = step.cells[k]
        if action is None or cell is None:
            return False
        peers = [action.peer]
        if action.peer == NOBODY:
            peers = [peer for peer in range(len(step.cells)) if peer != k]
        perceived = tuple(
            cell_of_peer
            for peer in peers
            if (cell_of_peer := step.cells[peer]) is not None
        )
        if len(perceived) < len(peers):
            return False
        went = int(self._next_cell[cell, action.move])
        return self._led(k, cell, perceived) == {went}
