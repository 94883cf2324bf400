# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several bags on one page, played by one clock."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.show.page import controls
from sparse_coord_ros.show.page.bag_source import (
    FIRST_RATE,
    FRAME_SECONDS,
    LINGER,
    SHOWN_RATE,
    BagSource,
)
from sparse_coord_ros.show.page.message_board import MessageBoard

CONTROLS = (
    controls.PAUSE,
    controls.STEP,
    controls.RATE,
    controls.SEEK,
    controls.AXIS,
)


class Aligned(NamedTuple):
    """How the time steps of several runs lie beside each other on one axis.

    The axis is cut into segments, such as episodes. All runs begin a segment at once, and those
    that have ended it wait for the others.

    Attributes:
        starts: the first time step of each segment, shape (runs, segments).
        lengths: how many steps after it the segment ends, same shape.
        offsets: where each segment begins on the axis, shape (segments,).
        last: the last position of the axis.
    """

    starts: np.ndarray
    lengths: np.ndarray
    offsets: np.ndarray
    last: int

    def segment_at(self, position: int) -> int:
        """Return the segment in which a position of the axis lies."""
        return int(np.searchsorted(self.offsets, position, side="right")) - 1

    def steps_at(self, position: int) -> list[int]:
        """Return the time step of each run at a position of the axis."""
        segment = self.segment_at(position)
        into = np.minimum(position - self.offsets[segment], self.lengths[:, segment])
        steps: list[int] = (self.starts[:, segment] + into).tolist()
        return steps

    def position_of(self, run: int, step: int) -> int:
        """Return the position at which a run shows a time step, or the last one before it."""
        starts = self.starts[run]
        segment = max(0, int(np.searchsorted(starts, step, side="right")) - 1)
        into = np.clip(step - starts[segment], 0, self.lengths[run, segment])
        return int(self.offsets[segment] + into)


def aligned(starts: np.ndarray, lengths: np.ndarray) -> Aligned:
    """Return the axis of segments that begin and end at these time steps."""
    widths = lengths.max(axis=0) + 1
    ends = np.cumsum(widths)
    return Aligned(starts, lengths, ends - widths, int(ends[-1]) - 1)


class Comparison(controls.Played):
    """Plays several bags side by side.

    Args:
        sources: the bags.
        board: where the clock and the titles go; each source has a board of its own.
        rate: time steps a second; 0: as far as the logs go.

    Attributes:
        axis: what the runs have in common now, of `controls.AXES`.
        position: where they are on it, with its fraction.
        paused: whether time stands still.
        rate: time steps a second.
    """

    def __init__(
        self,
        sources: Sequence[BagSource],
        board: MessageBoard,
        *,
        rate: float = FIRST_RATE,
    ) -> None:
        super().__init__()
        self.sources = list(sources)
        self.board = board
        self.rate = rate
        self.paused = False
        self.position = 0.0
        self._watched = False
        self._made_of: object = None
        self._shown: Aligned | None = None
        learned = all(source.highlight is not None for source in sources)
        self.axis = controls.LEARNED_EPISODE if learned else controls.TIME_STEP
        if learned:
            self.rate = min(rate or SHOWN_RATE, SHOWN_RATE)
        board.put(
            "run",
            titles=titles_of([source.run for source in sources]),
            axes=self._axes(),
            controls=CONTROLS,
        )
        board.source = self

    def show_step(self, step: int) -> None:
        """Begin at a time step of all runs: that of a learning step of the first."""
        self.axis = controls.TIME_STEP
        step = self.sources[0].log.so_far.time_step(step)
        self.position = float(self.alignment().position_of(0, step))

    def _axes(self) -> list[str]:
        """Return the axes that there are."""
        learned = all(source.highlight is not None for source in self.sources)
        return [
            axis
            for axis in controls.AXES
            if learned or axis != controls.LEARNED_EPISODE
        ]

    def alignment(self) -> Aligned:
        """Return how the runs lie beside each other on the axis now.

        It is made anew only where the axis is another one, or more of a log is known.
        """
        known = [
            (source.highlight, source.history.episodes, source.log.last_step)
            for source in self.sources
        ]
        if self._made_of != (self.axis, known):
            self._made_of = (self.axis, known)
            self._alignment = self._align()
        return self._alignment

    def _align(self) -> Aligned:
        """Return the axis, made of what is known of the logs."""
        if self.axis == controls.LEARNED_EPISODE:
            shown = [source.highlight for source in self.sources]
            ends = np.array(
                [(shot.first, shot.last) for shot in shown if shot is not None]
            )
            # up to the state in which the last step ends
            return aligned(ends[:, :1], ends[:, 1:] + 1 - ends[:, :1])
        if self.axis == controls.EPISODE:
            histories = [source.history for source in self.sources]
            count = min(history.episodes for history in histories)
            if count:
                starts = np.array([history.first_step[:count] for history in histories])
                lengths = np.array([history.length[:count] for history in histories])
                return aligned(starts, lengths)
        first = min(source.first for source in self.sources)
        last = np.array([[source.log.last_step - first] for source in self.sources])
        return aligned(np.full(last.shape, first), last)

    def play(self) -> None:
        """Play until interrupted."""
        with ExitStack() as stack:
            for source in self.sources:
                stack.enter_context(source.reading())
            while True:
                for source in self.sources:
                    source.look_when_due()
                self.tick()
                time.sleep(FRAME_SECONDS)

    def move_on(self, seconds: float) -> None:
        """Play for so long; what was learned again and again, all runs up to their ends.

        Time passes while a page is open. The first page sees what was learned from its start.
        """
        watched = self.board.pages > 0
        begins = watched and not self._watched
        self._watched = watched
        if begins and self.axis == controls.LEARNED_EPISODE:
            self.position = 0.0
            return
        if self.paused or not watched:
            return
        last = float(self.alignment().last)
        self.position += seconds * self.rate if self.rate else last
        again = self.axis == controls.LEARNED_EPISODE
        if again and self.position >= last + LINGER:
            self.position = 0.0
        elif not again and self.position >= last:
            self.paused = not any(source.growing for source in self.sources)

    def carry_out(self, control: controls.Control) -> None:
        """Do what a page asks for."""
        axis = self.alignment()
        match control.name:
            case controls.PAUSE:
                self.paused = control.value
                if not control.value and self.position >= axis.last:
                    self.position = 0.0
            case controls.RATE:
                self.rate = control.value
            case controls.SEEK:
                self.position = float(np.clip(control.value, 0, axis.last))
            case controls.STEP:
                self.paused = True
                at = int(self.position) + control.value
                self.position = float(np.clip(at, 0, axis.last))
            case controls.AXIS if control.value in self._axes():
                step = axis.steps_at(int(min(self.position, axis.last)))[0]
                self.axis = control.value
                self.position = float(self.alignment().position_of(0, step))
                if control.value == controls.LEARNED_EPISODE:
                    self.position = 0.0
                    self.paused = False

    def show(self) -> None:
        """Show every run at the position, and the clock where it has changed.

        The clock carries the frames: each board has a stream of its own, which may come sooner or
        later than another one.
        """
        axis = self.alignment()
        position = int(min(max(self.position, 0.0), axis.last))
        steps = axis.steps_at(position)
        for source, step in zip(self.sources, steps, strict=True):
            source.show_at(step, paused=self.paused)
        if axis is not self._shown:
            self._shown = axis
            self.board.put_new(
                "aligned",
                axis=self.axis,
                starts=axis.starts.tolist(),
                lengths=axis.lengths.tolist(),
                offsets=axis.offsets.tolist(),
            )
        self.board.put_new(
            "clock",
            axis=self.axis,
            state="paused" if self.paused else "playing",
            position=position,
            last=axis.last,
            segment=axis.segment_at(position),
            rate=self.rate,
            frames=[source.board.get("frame") for source in self.sources],
        )


def titles_of(runs: Sequence[RunConfig]) -> list[str]:
    """Return a short title of each run, which tells it from the others.

    It is its learner's; where two learners are the same, with the scenario and its settings.
    """
    names = [run.learner for run in runs]
    titles: list[str] = []
    for run, name in zip(runs, names, strict=True):
        others = [
            other for other, same in zip(runs, names, strict=True) if same == name
        ]
        labels = {other.scenario.label for other in others}
        if len(labels) > 1:
            name = f"{name}, {run.scenario.label}"
        if len(others) > len(labels):
            name = f"{name}, seed {run.seed}"
        titles.append(name)
    return titles
