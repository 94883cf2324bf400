# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What matters in a recorded run: where robots ask, meet and change their minds, and what for."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.miscoordination import miscoordinations
from sparse_coord_ros.core.learners.agent import NOBODY, Agent
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.evaluation import check_tables, greedy_agents
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.log.runlog.window import Episodes
from sparse_coord_ros.protocol.wire.frame import Frame
from sparse_coord_ros.protocol.wire.occupancy import OCCUPIED, OccupancyData
from sparse_coord_ros.show.page.controls import (
    CROSSING,
    KINDS,
    MISCOORDINATION,
    POLICY,
    QUESTION,
)
from sparse_coord_ros.show.policy import entered, policy_of
from sparse_coord_ros.show.steps import logged_step, questions_of
from sparse_coord_ros.show.words import Words


class Moments:
    """Gathers the time steps that matter, part by part of a log.

    Args:
        run: the run.
        words: of its scenario.

    Attributes:
        steps: by kind the time steps, ascending.
        changes: of each robot the time step and where it would ask from then on, shape (cells,).
    """

    def __init__(self, run: RunConfig, words: Words) -> None:
        self.steps: dict[str, np.ndarray] = {
            kind: np.empty(0, np.int64) for kind in KINDS
        }
        self.changes: list[list[tuple[int, np.ndarray]]] = [
            [] for _ in run.scenario.robots
        ]
        self._run = run
        self._near = words.doorways.near
        self._places = OccupancyData(Frame(run)).places

    def add(self, part: Episodes) -> None:
        """Take in a part of the log."""
        log = part.log
        history = part.history
        scenario = self._run.scenario
        asked = log.asked.any(axis=1)
        followed = np.diff(log.step, append=-1) == 1
        met = np.roll(miscoordinations(scenario, log.cells), -1) & followed
        found = {QUESTION: log.step[asked], MISCOORDINATION: log.step[met]}
        if not len(self.steps[CROSSING]):
            fine = history.arrived.all(axis=1) & (history.miscoordinations == 0)
            good = log.episode[np.isin(log.step, history.first_step[fine])]
            at = np.isin(log.episode, good) & self.meetings(log.cells)
            found[CROSSING] = log.step[at][:1]
        for kind, steps in found.items():
            self.steps[kind] = np.concatenate([self.steps[kind], steps])
        for k, known in enumerate(self.changes):
            steps, rows = log.messages.coordination_maps[k]
            here = np.isin(steps, log.step)
            for step, data in zip(
                steps[here].tolist(), rows["data"][here], strict=True
            ):
                asks = np.frombuffer(data, dtype=np.int8)[self._places] == OCCUPIED
                if not known or (known[-1][1] != asks).any():
                    known.append((step, asks))
        changed = {step for known in self.changes for step, _ in known[1:]}
        self.steps[POLICY] = np.array(sorted(changed), dtype=np.int64)

    def meetings(self, cells: np.ndarray) -> np.ndarray:
        """Return where two robots are in front of one doorway, or in it; cells (T, K): (T,)."""
        found = np.zeros(len(cells), dtype=np.bool_)
        for near in self._near:
            found |= np.isin(cells, near).sum(axis=1) >= 2
        return found

    def since(self, robot: int, cell: int) -> tuple[int, int | None]:
        """Return the first time step, and since when a robot would ask in a cell up to the end.

        None: it would not.
        """
        last = None
        known = self.changes[robot]
        for step, asks in known:
            last = (step if last is None else last) if asks[cell] else None
        return (known[0][0] if known else 0), last


class Highlight(NamedTuple):
    """An episode that shows what was learned.

    Attributes:
        first, last: its time steps.
        step: of its question that matters most; None: nobody asks.
        robot: who asks then, cell: where.
        text: what comes of it, in words.
    """

    first: int
    last: int
    step: int | None
    robot: int
    cell: int
    text: str


def highlight(
    log: RunLog, tables: Sequence[Tables], moments: Moments, words: Words
) -> Highlight:
    """Return the latest episode of a part of a log in which what was learned matters most.

    That is where a robot asks, as its tables say that it would; goes where they say that it would
    go after this answer, and where it would not go without one; at a doorway at which the other
    one is, too; and all arrive without a miscoordination. Cells that a greedy robot reaches from
    its start come first: an episode of learning may begin elsewhere.

    Args:
        log: the part, with at least one episode.
        tables: of every robot, what was learned there.
        moments: of the run.
        words: of its scenario.

    Raises:
        TablesError: the tables do not fit the run.
    """
    history = log.history()
    robots = range(len(log.names))
    begins = np.searchsorted(log.step, history.first_step)
    good = history.arrived.all(axis=1) & (history.miscoordinations == 0)
    policies = [policy_of(tables[k], log.run.scenario.robots[k].goal) for k in robots]
    greedy = GreedyMoves(log.run, tables)
    rank = np.zeros(log.asked.shape, dtype=np.int64)
    close = moments.meetings(log.cells)
    starts = [robot.start for robot in log.run.scenario.robots]
    reached = [entered(policies[k], log.run.scenario.map, starts[k]) for k in robots]
    for k in robots:
        at = np.flatnonzero(log.asked[:, k] & log.perceived[:, k])
        cells = log.cells[at, k]
        moves = log.move[at, k]
        asks = policies[k].asks[cells]
        other = ~policies[k].moves[cells, moves]
        by_answer = np.array(
            [greedy.holds(log, row, k) for row in at.tolist()], dtype=bool
        )
        there = np.isin(cells, reached[k])
        rank[at, k] = 1 + 16 * there + 8 * by_answer + 4 * asks + 2 * other + close[at]
    best = [
        (32 * fine + most) * bool(most) + 0.5 * fine
        for begin, length, fine in zip(begins, history.length, good, strict=True)
        for most in [int(rank[begin : begin + length].max())]
    ]
    number = len(best) - 1 - int(np.argmax(best[::-1]))
    begin = int(begins[number])
    end = int(begins[number] + history.length[number])
    row, k = divmod(int(rank[begin:end].argmax()), len(log.names))
    row += begin
    first = int(log.step[begin])
    last = int(log.step[end - 1])
    if not rank[row, k]:
        what = (
            "no question is answered"
            if log.asked.any()
            else "no robot asks another one"
        )
        text = f"In the last episodes {what}."
        return Highlight(first, last, None, 0, 0, text)
    cell = int(log.cells[row, k])
    learned = (
        cell in reached[k]
        and bool(policies[k].asks[cell])
        and greedy.holds(log, row, k)
    )
    text = _told(log, row, k, words, learned=learned)
    if not good[number]:
        text = f"Here not all robots arrive without a miscoordination. {text}"
    return Highlight(first, last, int(log.step[row]), k, cell, text)


def _told(log: RunLog, row: int, k: int, words: Words, *, learned: bool) -> str:
    """Return an answered question in words.

    Args:
        log: the log.
        row: of the question's time step.
        k: who asks.
        words: of the scenario.
        learned: whether its tables say that it would come there and do the same again; if not,
            or if it asks several robots, only what happened is told.
    """
    step = logged_step(log, row)
    [question] = [one for one in questions_of(step) if one.asker == k]
    if not learned or len(question.peers) != 1:
        return f"Here {words.question(step, question)}"
    [peer] = question.peers
    cell = int(log.cells[row, k])
    move = question.move
    led = int(log.run.scenario.map.next_cell[cell, move])
    place, door = words.where(k, cell, led)
    answer = words.answer(k, cell, door, [(peer, int(log.cells[row, peer]))])
    return f"{words.names[k]} asks {place}, and {words.does(k, cell, move, led)} if {answer}."


class GreedyMoves:
    """What the tables of a team say that robots do after an answer.

    Args:
        run: the run.
        tables: of every robot.

    Raises:
        TablesError: the tables do not fit the run.
    """

    def __init__(self, run: RunConfig, tables: Sequence[Tables]) -> None:
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

    def holds(self, log: RunLog, row: int, k: int) -> bool:
        """Whether a robot that got an answer chose what its tables say that it would choose now.

        False where its learner's code may not be imported, as then that is not known, and where
        its tables leave open to which cell it goes.
        """
        if not self._agents:
            return False
        peer = int(log.peer[row, k])
        robots = range(len(log.names))
        peers = [one for one in robots if one != k] if peer == NOBODY else [peer]
        perceived = tuple(log.cells[row, peers].tolist())
        if min(perceived) < 0:
            return False
        cell = int(log.cells[row, k])
        return self._led(k, cell, perceived) == {
            int(self._next_cell[cell, log.move[row, k]])
        }
