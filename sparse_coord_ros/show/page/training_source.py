# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A learning run without ROS on the page."""

import time

import numpy as np

from sparse_coord_ros.core.runs.run import LearningRun, TeamTransition
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.runs.team import groups_of
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.show.page import page_messages
from sparse_coord_ros.show.page.bag_source import SHOWN_RATE
from sparse_coord_ros.show.page.controls import (
    NEXT,
    PAUSE,
    RATE,
    STEP,
    Control,
    Controlled,
)
from sparse_coord_ros.show.page.live_source import LiveView
from sparse_coord_ros.show.page.message_board import MessageBoard
from sparse_coord_ros.show.sources import OpenedRun

LOOKS_A_SECOND = 30
SHOWN_EPISODES = 200
"""Greedy episodes in which questions are counted, as their mean says."""

TRAINING_CONTROLS = (PAUSE, STEP, RATE, NEXT)


class TrainingView(LiveView, Controlled):
    """Looks at a run; holds it, slows it down, and lets it make single steps as a page asks.

    Args:
        run: the run.
        board: where the messages go.
        title: what the page is called.
        last: whether no page may ask for a next run.
    """

    def __init__(
        self, run: RunConfig, board: MessageBoard, *, title: str, last: bool = False
    ) -> None:
        Controlled.__init__(self)
        controls = TRAINING_CONTROLS[:-1] if last else TRAINING_CONTROLS
        super().__init__(run, board, source="train", title=title, controls=controls)
        self.wants_transition = True
        self._held = self._stepping = False
        self._learning: LearningRun | None = None
        self._rate = 0.0
        self._due = time.monotonic()
        # A compiler may need some seconds before the first look.
        self.state = "preparing"
        self.show(transitions=0, episode=0)
        self._counted = None

    def look(
        self, learning: LearningRun, transition: TeamTransition | None
    ) -> int | None:
        """Look at the run; return how many transitions to make before the next look.

        The last transition is made apart, so that the last frame shows it.
        """
        self._learning = learning
        stepping = self._stepping
        self._stepping = False
        if transition is not None:
            self.take(transition)
        elif stepping:  # it could not be made apart
            return 1
        for control in self.wishes():
            self._do(control)
        self.state = RunState.PAUSED if self._held else RunState.LEARNING
        self.show(transitions=learning.done, episode=0, rate=self._rate)
        if self.slow_due():
            self._show_learned(learning)
        if self._held:
            self.wants_transition = self._stepping
            if not self._stepping:
                time.sleep(1 / LOOKS_A_SECOND)
            return 0
        if learning.done == learning.scenario.steps - 1:
            self.wants_transition = True
            return 0
        self.wants_transition = self.board.pages > 0
        if not self._rate:
            return None
        now = time.monotonic()
        self._due = max(self._due + 1 / min(self._rate, LOOKS_A_SECOND), now - 0.2)
        if self._due > now:
            time.sleep(self._due - now)
        self.wants_transition = True
        many = round(self._rate / LOOKS_A_SECOND) - 1  # one more is made to be shown
        return max(0 if transition is not None else 1, many)

    def _do(self, control: Control) -> None:
        """Do what a page asks for."""
        if control.name == PAUSE:
            self._held = bool(control.value)
        elif control.name == RATE:
            self._rate = control.value
            self._due = time.monotonic()
        elif control.name == STEP:
            self._held = self._stepping = True

    def _show_learned(self, learning: LearningRun, *, over: bool = False) -> None:
        """Show what was learned so far, or `over`: at the end."""
        step = None if over else learning.step
        tables = {
            k: (step, robot_tables) for k, robot_tables in enumerate(learning.tables)
        }
        self.show_learned(learning.history, tables, asked=learning.asked)

    def end(self, state: str = RunState.FINISHED) -> None:
        """Show what was learned at the end, or where the run was stopped."""
        self.state = state
        if self._learning is not None:
            self.show(transitions=self._learning.done, episode=0, rate=self._rate)
            self._show_learned(self._learning, over=state == RunState.FINISHED)


class TrainedView(LiveView):
    """Shows what a run without a bag has learned, and a greedy episode with its questions.

    Args:
        shown: the run.
        board: where the messages go.

    Raises:
        SparseCoordError: a part of the run is missing or cannot be read.
    """

    def __init__(self, shown: OpenedRun, board: MessageBoard) -> None:
        run = shown.config
        tables = shown.tables
        super().__init__(run, board, source="train", title=str(shown.path), controls=())
        self.state = RunState.GREEDY
        groups = len(groups_of(run.scenario, run.rule))
        self._made = int(shown.history.length.sum()) // groups
        newest = {k: (None, robot_tables) for k, robot_tables in enumerate(tables)}
        measures = page_messages.measured(run, tables)
        played = f"asked here in {SHOWN_EPISODES} greedy episodes"
        asked = np.rint(measures.asked * SHOWN_EPISODES).astype(np.int64)
        self.show_learned(shown.history, newest, asked=asked, where=played)
        self._steps = page_messages.put_end(board, run, tables, measures)

    def play(self) -> None:
        """Play the episode again and again until interrupted."""
        while True:
            self._told.clear()
            for seen in self._steps:
                self.take(seen)
                self.show(
                    transitions=self._made, episode=0, rate=SHOWN_RATE, speed=SHOWN_RATE
                )
                time.sleep(1 / SHOWN_RATE)
