# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team that learns now on the page, whatever tells of it: ROS, or the simulation."""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.history import History
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.learn.simulation import Glimpse
from sparse_coord_ros.look.page import messages
from sparse_coord_ros.look.page.board import Board
from sparse_coord_ros.look.steps import TimeStep, seen_step

SLOW_SECONDS = 1.0
"""Between two messages of curves, tables and asks, or longer:"""

SLOW_SHARE = 0.01
"""Share of the time that making them may take. A long run has long curves."""

WORDS_SECONDS = 0.2
"""Between two messages of questions in words: quicker nobody reads."""


class LiveView:
    """Takes every transition, and shows some: as many as a screen can show.

    Args:
        run: the run.
        board: where the messages go.
        source, title, controls: as of `messages.run_message`.
        now: a monotonic clock, in seconds.

    Attributes:
        state: what the team is doing, in a word.
        asked: how often each robot asked in each cell, [robot][cell].
        last: the newest transition.
    """

    def __init__(
        self,
        run: RunConfig,
        board: Board,
        *,
        source: str,
        title: str,
        controls: Sequence[str],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.run, self.board = run, board
        self.state = "waiting"
        robots, cells = len(run.scenario.robots), len(run.scenario.map.cells)
        self.asked = [[0] * cells for _ in range(robots)]
        self._now = now
        self.last: Glimpse | None = None
        self._shown: tuple[Glimpse | None, str, float] | None = None
        self._told: deque[messages.Message] = deque(maxlen=messages.DIALOGUE)
        self._slow = self._counted = self._worded = -1e9
        self._words_due = False
        self._began: float | None = None
        self._count_then = 0
        self._speed: float | None = None
        self._lacking = ""
        board.clear()
        board.put(messages.run_message(run, source=source, title=title, controls=controls))
        board.put(messages.dialogue_message([]))
        self.notice("")

    def notice(self, text: str) -> None:
        """Show a line; an empty one takes it away. What the curves lack stays beside it."""
        said = "; ".join(one for one in (text, self._lacking) if one)
        self.board.put(messages.notice_message(said))

    def lack(self, text: str) -> None:
        """Say, for as long as the run is shown, what the curves lack."""
        self._lacking = text
        self.notice("")

    def take(self, seen: Glimpse) -> None:
        """Take in a transition; called for each, so it does next to nothing."""
        self.last = seen
        for k, action in enumerate(seen.actions):
            if action is not None and action.asked:
                self.asked[k][seen.cells[k]] += 1

    def show(
        self, *, transitions: int, episode: int, rate: float = 0.0, still: Sequence[int] = ()
    ) -> None:
        """Show the newest transition; called some twenty times a second.

        Args:
            transitions: made so far.
            episode: number of the episode, from 0.
            rate: time steps a second that are wanted; 0: as fast as the team acts.
            still: where the robots are, while there was no transition.
        """
        now = self._now()
        self._show_words()
        if now - self._counted >= SLOW_SECONDS:
            passed = now - self._counted
            self._speed = None if passed > 60 else (transitions - self._count_then) / passed
            self._counted, self._count_then = now, transitions
        key = (self.last, self.state, rate)
        if key == self._shown:
            return
        last = self.last
        new = self._shown is None or self._shown[0] is not last
        self._shown = key
        if last is None:
            seen = TimeStep(0, tuple(still) or (None,) * len(self.asked))
        else:
            seen = seen_step(last)
        self.board.put(
            messages.frame_message(
                seen,
                state=self.state,
                transitions=transitions,
                episode=episode,
                rate=rate,
                speed=None if self._speed is None else round(self._speed),
            )
        )
        if new and seen.questions:
            self._told.extend(messages.in_words(self.run, seen))
            self._words_due = True
            self._show_words()

    def _show_words(self, *, at_once: bool = False) -> None:
        """Show the questions in words, where there are new ones and it is time for them."""
        if not self._words_due:
            return
        now = self._now()
        if at_once or now - self._worded >= WORDS_SECONDS:
            self._words_due, self._worded = False, now
            self.board.put(messages.dialogue_message(self._told))

    def slow_due(self) -> bool:
        """Return whether it is time for `show_learned`: once a second where a page is there."""
        now = self._now()
        if not self.board.watched or now < self._slow:
            return False
        self._began = now
        return True

    def show_learned(
        self,
        history: History,
        tables: Mapping[int, tuple[int, Tables]] | None,
        rings: Mapping[int, np.ndarray] | None = None,
        *,
        asked: np.ndarray | None = None,
    ) -> None:
        """Show learning curves, what the tables say, and where the robots asked.

        Args:
            history: the episodes so far.
            tables: as of `messages.tables_message`; None: as before.
            rings: likewise.
            asked: as `asked`, where somebody else has counted.
        """
        self._show_words(at_once=True)
        self.board.put(messages.curves_message(history))
        if tables is not None:
            self.board.put(messages.tables_message(self.run, tables, rings))
        step = 0 if self.last is None else self.last.step
        counted = np.array(self.asked) if asked is None else asked
        self.board.put(messages.asked_message(counted, step))
        if self._began is not None:
            now = self._now()
            self._slow = now + max(SLOW_SECONDS, (now - self._began) / SLOW_SHARE)
            self._began = None
