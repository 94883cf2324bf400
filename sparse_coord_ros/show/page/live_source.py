# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team that learns now, on the page: each new transition; costly messages less often."""

import time
from collections import deque
from collections.abc import Container, Sequence

import numpy as np

from sparse_coord_ros.core.runs.history import History
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.runlog import explain
from sparse_coord_ros.show.narrator import Narrator
from sparse_coord_ros.show.page import page_messages
from sparse_coord_ros.show.page.message_board import Message, MessageBoard
from sparse_coord_ros.show.policy import row_asking
from sparse_coord_ros.show.steps import TRAIL, Question, questions_of, trails_of

SLOW_SECONDS = 1.0
"""Between two messages of curves, tables and asks, or longer:"""

SLOW_SHARE = 0.01
LONGEST_SECONDS = 5.0
"""Share of the time that making them may take, as a long run has long curves; but after so long
they come in any case."""


ASKED_SO_FAR = "asked here so far"


class LiveView:
    """Takes every transition, and shows some: as many as a screen can show.

    Args:
        run: the run.
        board: where the messages go.
        source: live or train.
        title: what the page is called.
        controls: the controls of its page.

    Attributes:
        state: what the team is doing, in a word.
        asked: how often each robot asked in each cell, [robot][cell].
        last: the newest transition.
        newest: by robot the newest tables, and the time step before which they were learned.
        known: the robots, from 0, whose tables are known.
    """

    def __init__(
        self,
        run: RunConfig,
        board: MessageBoard,
        *,
        source: str,
        title: str,
        controls: Sequence[str],
    ) -> None:
        self.run = run
        self.board = board
        self.state = "waiting"
        robots = len(run.scenario.robots)
        cells = len(run.scenario.map.cells)
        self.asked = [[0] * cells for _ in range(robots)]
        self.last: TeamTransition | None = None
        self.newest: page_messages.TablesThen = {}
        self._passed: deque[tuple[int | None, ...]] = deque(maxlen=TRAIL)
        self._narrator = Narrator(run.scenario)
        self.known: Container[int] = range(robots)
        self._shown: tuple[TeamTransition | None, str, float | None] | None = None
        self._told: deque[Message] = deque(maxlen=page_messages.MOST_ENTRIES)
        self._slow = -np.inf
        self._began = 0.0
        self._counted: tuple[float, int] | None = None
        self._speed: int | None = None
        self._lacking = ""
        board.clear()
        shown = {"source": source, "title": title, "controls": controls}
        board.put("run", **shown, **page_messages.run_fields(run))
        self.notice("")

    def notice(self, text: str) -> None:
        """Show a line; an empty one takes it away. What the curves lack stays beside it."""
        line = "; ".join(part for part in (text, self._lacking) if part)
        self.board.put("notice", text=line)

    def lack(self, text: str) -> None:
        """Say, for as long as the run is shown, what the curves lack."""
        self._lacking = text
        self.notice("")

    def take(self, seen: TeamTransition) -> None:
        """Take in a transition; this is called for each one, so it must be fast."""
        if self.last is not None and seen.step != self.last.step + 1:
            self._passed.clear()
        self._passed.append(seen.cells)
        self.last = seen
        for k, action in enumerate(seen.actions):
            if action is not None and action.asked:
                cell = seen.cells[k]
                assert cell is not None  # a robot that acts knows its cell
                self.asked[k][cell] += 1

    def show(
        self,
        *,
        transitions: int,
        episode: int,
        rate: float | None = 0.0,
        still: tuple[int, Sequence[int]] | None = None,
        speed: float | None = None,
    ) -> None:
        """Show the newest transition; called some twenty times a second.

        Args:
            transitions: made so far.
            episode: number of the episode, from 0.
            rate: time steps a second that are wanted; 0: as fast as the team acts; None: that is
                not known.
            still: the time step, and where the robots are, while there was no transition.
            speed: time steps a second; None: as they are counted.
        """
        now = time.monotonic()
        if self._counted is None:
            self._counted = now, transitions
        elif now - self._counted[0] >= SLOW_SECONDS:
            then, made = self._counted
            self._speed = round((transitions - made) / (now - then))
            self._counted = now, transitions
        key = (self.last, self.state, rate)
        if key == self._shown:
            return
        new = self._shown is None or self._shown[0] is not self.last
        self._shown = key
        seen = self.last
        if seen is None:
            robots = len(self.asked)
            step, cells = (0, (None,) * robots) if still is None else still
            seen = TeamTransition(step, tuple(cells), (None,) * robots, None, False)
        trails = trails_of(
            self._passed or [seen.cells], self.run.scenario.map.next_cell
        )
        frame: Message = {"made": transitions, "episode": episode, "rate": rate}
        frame |= {"state": self.state, "speed": self._speed if speed is None else speed}
        frame |= page_messages.frame_fields(seen, trails, self._narrator)
        self.board.put("frame", **frame)
        if new:
            self._tell(seen, transitions - 1)

    def _tell(self, seen: TeamTransition, made: int) -> None:
        """Show the questions of a transition in words, made after so many."""
        rows = {
            question.asker: self._row(seen, question) for question in questions_of(seen)
        }
        entries = page_messages.in_words(
            self.run, seen, self.known, self._narrator, rows, {}, made
        )
        asks = list(entries)
        if asks:
            self._told.extend(asks)
            self.board.put("dialogue", entries=list(self._told))

    def _row(self, seen: TeamTransition, question: Question) -> str:
        """Return what the row of the newest tables holds that decides after a question."""
        asked = page_messages.asked_of(seen, question)
        if asked is None or asked.robot not in self.newest:
            return ""
        _, tables = self.newest[asked.robot]
        row = row_asking(tables, asked.cell, asked.perceived)
        if row is None:
            return ""
        return f", in the newest tables {explain.row_in_words(row)}"

    def slow_due(self) -> bool:
        """Return whether it is time for `show_learned`: once a second where a page is there."""
        self._began = time.thread_time()
        return self.board.pages > 0 and time.monotonic() >= self._slow

    def show_learned(
        self,
        history: History,
        tables: page_messages.TablesThen,
        *,
        asked: np.ndarray | None = None,
        where: str = ASKED_SO_FAR,
    ) -> None:
        """Show learning curves, what the tables say, and where the robots asked.

        Args:
            history: the episodes so far.
            tables: by robot, with the time step before which they were learned.
            asked: questions by robot and cell, if another object counts, shape (K, cells).
            where: in which episodes they were counted, in words.
        """
        self.newest = tables
        self.board.put("curves", read=1.0, **page_messages.curve_fields(history))
        page_messages.put_tables(self.board, self.run, tables)
        page_messages.put_so_far(self.board, self.run, history)
        counted = np.array(self.asked) if asked is None else asked
        self.board.put("asked", robots=counted.tolist(), where=where)
        # on a busy machine less than has passed
        spent = time.thread_time() - self._began
        pause = min(max(SLOW_SECONDS, spent / SLOW_SHARE), LONGEST_SECONDS)
        self._slow = time.monotonic() + pause
