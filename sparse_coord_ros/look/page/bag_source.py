# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as the source of the page: played, held, stepped, sought in; followed while it grows."""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sparse_coord_ros.bags.layout import being_recorded
from sparse_coord_ros.errors import BagError, SparseCoordError
from sparse_coord_ros.game.miscoordination import miscoordinations
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.history import History, concatenated, no_history
from sparse_coord_ros.look.episodes import logged_asks
from sparse_coord_ros.look.page import messages as frames
from sparse_coord_ros.look.page.board import Board
from sparse_coord_ros.look.page.commands import PAUSE, RATE, SEEK, STEP, Command
from sparse_coord_ros.look.page.values import evaluation_message
from sparse_coord_ros.palette import ANSWERED, REFUSED
from sparse_coord_ros.runlog.log import NONE, RunLog
from sparse_coord_ros.runlog.percepts import ENDED
from sparse_coord_ros.runlog.window import open_log
from sparse_coord_ros.wire import PERCEPT_ENDS

CONTROLS = (PAUSE, STEP, RATE, SEEK)

TICK_SECONDS = 1 / 30
LOOK_SECONDS = 0.5
"""Between two looks at whether the file has grown."""

CURVES_SECONDS = 0.7
"""Between two messages of curves while the log is read."""

FIRST_RATE = 10.0
DIALOGUE = 40
"""Questions that the page shows."""


class BagSource:
    """Plays a bag to a board.

    Args:
        path: the bag, as of `read_run`.
        board: where the messages go.
        now: a monotonic clock, in seconds.

    Attributes:
        log: the bag.
        position: the time step that is shown, with its fraction.
        paused: whether time stands still.
        rate: time steps a second; 0: as far as the log goes.

    Raises:
        SparseCoordError: as of `LongLog`.
    """

    def __init__(
        self, path: Path, board: Board, *, now: Callable[[], float] = time.monotonic
    ) -> None:
        self.log = open_log(path)
        self.run = self.log.run
        self.board = board
        self._now = now
        self._commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        if self.log.empty:
            damage, begun = self.log.damage, being_recorded_still(self.log.path)
            self.log.close()
            if begun:
                raise BagError(
                    f"{path}: holds no message yet, its recorder has only begun; try again soon"
                )
            raise BagError(
                f"{path}: holds no message to show{'' if damage is None else f'; {damage}'}; see "
                "'sparse_coord info'"
            )
        self.growing = not self.log.finished and being_recorded_still(self.log.path)
        self.first = self._first_step()
        self.position = float(self.log.last_step if self.growing else self.first)
        self.paused = False
        self.following = self.growing
        self.rate = FIRST_RATE
        self._then = now()
        self._window: RunLog | None = None
        self._shown: tuple[int, str] | None = None
        self._tables: tuple[int, ...] = ()
        self._asked: list[tuple[int, np.ndarray]] = []
        self._asked_put = -1
        self._entries: deque[frames.Message] = deque(maxlen=DIALOGUE)
        self._last_said = -1
        self._stop = threading.Event()
        self._said: str | None = None
        self.board.put(
            frames.run_message(
                self.run, source="bag", title=_title(self.log.path), controls=CONTROLS
            )
        )
        self._say()

    def _first_step(self) -> int:
        log = self.log.begin()
        acted = np.flatnonzero((log.cells != NONE).any(axis=1))
        return int(log.step[acted[0]]) if len(acted) else int(log.step[0])

    def command(self, command: Command) -> None:
        """Do what a page asks for, with the next tick."""
        self._commands.put(command)

    # In the thread of the source.

    def play(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Play until told to stop."""
        reading = threading.Thread(target=self._read_through, daemon=True)
        reading.start()
        looked = self._now()
        try:
            while not stop():
                began = self._now()
                if self.growing and began - looked >= LOOK_SECONDS:
                    looked = began
                    self.look()
                self.tick()
                self._stop.wait(max(0.0, TICK_SECONDS - (self._now() - began)))
        finally:
            self._stop.set()
            reading.join()
            self.log.close()

    def look(self) -> None:
        """Take in what the file has grown by."""
        log = self.log
        growing = being_recorded_still(log.path)
        if log.extend():
            self._window = None
        if log.finished or log.damage is not None or not growing:
            self.growing = False
            self._say()

    def tick(self) -> None:
        """Do what was asked for, move on, and show the time step that is reached."""
        now = self._now()
        passed, self._then = now - self._then, now
        while not self._commands.empty():
            self._do(self._commands.get())
        last = float(self.log.last_step)
        if self.following:
            self.position = last
            if not self.growing:
                self.following, self.paused = False, True
        elif not self.paused:
            on = passed * self.rate if self.rate else last
            self.position = min(self.position + on, last)
            if self.position >= last:
                self.following = self.growing
                self.paused = not self.growing
        self.show()

    def _do(self, command: Command) -> None:
        last = self.log.last_step
        if command.name == PAUSE:
            self.paused = command.value
            self.following = False
            if not self.paused and self.position >= last:
                self.following = self.growing
                if not self.growing:
                    self.position = float(self.first)
        elif command.name == RATE:
            self.rate = command.value
        elif command.name == SEEK:
            self.position = float(min(max(command.value, self.first), last))
            self.following = self.growing and self.position >= last
        elif command.name == STEP:
            self.paused, self.following = True, False
            self.position = float(self._beside(command.value))

    def _beside(self, count: int) -> int:
        """Return the time step so many steps on in the log, or back."""
        log = self._around(int(self.position))
        row = int(np.searchsorted(log.step, int(self.position), side="right")) - 1 + count
        if 0 <= row < len(log.step):
            return int(log.step[row])
        return int(min(max(int(self.position) + count, self.first), self.log.last_step))

    def _around(self, step: int) -> RunLog:
        window = self._window
        margin = 2  # a transition needs the next state
        if window is None or not (
            len(window.step) and window.step[0] <= step <= window.step[-1] - margin
        ):
            window = self._window = self.log.around(step)
            self._say()
        return window

    @property
    def state(self) -> str:
        """What is going on, in a word."""
        if self.following:
            return "following"
        if self.paused:
            return "ended" if self.position >= self.log.last_step else "paused"
        return "playing"

    def show(self) -> None:
        """Put what belongs to the position on the board, where it is not there already."""
        try:
            log = self._around(int(self.position))
        except SparseCoordError as error:
            self._trouble(str(error))
            return
        row = int(np.searchsorted(log.step, int(self.position), side="right")) - 1
        if row < 0:
            return
        step = int(log.step[row])
        key = (step, f"{self.state} {self.rate} {self.log.last_step}")
        if key != self._shown:
            self._shown = key
            self.board.put(
                frames.frame_message(
                    moment_of(log, row),
                    state=self.state,
                    rate=self.rate,
                    first=self.first,
                    last=self.log.last_step,
                )
            )
            self._tell(log, row)
        self._show_tables(step)
        self._show_asked(step)

    def _tell(self, log: RunLog, row: int) -> None:
        """Show the questions up to a row; after a seek those of the steps before it."""
        step = int(log.step[row])
        if step < self._last_said or self._last_said < int(log.step[0]):
            self._entries.clear()
            self._last_said = int(log.step[0]) - 1
        begin = int(np.searchsorted(log.step, self._last_said, side="right"))
        asking = begin + np.flatnonzero(log.asked[begin : row + 1].any(axis=1))
        for place in asking[-DIALOGUE:].tolist():
            self._entries.extend(frames.in_words(self.run, moment_of(log, place)))
        if len(asking) or not self._entries:
            self.board.put(frames.dialogue_message(list(self._entries)))
        self._last_said = step

    def _show_tables(self, step: int) -> None:
        robots = range(len(self.run.scenario.robots))
        steps = self.log.table_steps()
        due = tuple(max((at for at in steps[k] if at <= step), default=NONE) for k in robots)
        if due == self._tables:
            return
        self._tables = due
        found: dict[int, tuple[int, Tables]] = {}
        for k in robots:
            try:
                entry = self.log.tables_before(k, step)
            except SparseCoordError as error:
                self._trouble(str(error))
                continue
            if entry is not None:
                found[k] = (entry.step, entry.tables)
        self.board.put(frames.tables_message(self.run, found))

    def _show_asked(self, step: int) -> None:
        known = self._asked
        place = int(np.searchsorted([until for until, _ in known], step, side="right")) - 1
        if place >= 0 and place != self._asked_put:
            self._asked_put = place
            self.board.put(frames.asked_message(known[place][1], known[place][0]))

    def _say(self) -> None:
        log = self.log
        if log.damage is not None:
            text = f"damaged: {log.damage}; what is before it is shown"
        elif self.growing:
            text = "still being recorded: the page follows it"
        elif not log.finished:
            text = "never closed by its recorder: what there is of it is shown"
        else:
            text = ""
        if text != self._said:
            self._said = text
            self.board.put(frames.notice_message(text, level="warning" if text else "info"))

    def _trouble(self, text: str) -> None:
        self.board.put(frames.notice_message(f"damaged: {text}", level="warning"))

    # In a thread beside it.

    def _read_through(self) -> None:
        """Compute the learning curves from the log, stretch by stretch, and go on as it grows."""
        whole: list[History] = []
        open_one = no_history(len(self.run.scenario.robots))
        asked = np.zeros(
            (len(self.run.scenario.robots), len(self.run.scenario.map.cells)), dtype=np.int64
        )
        begin = put = 0.0
        try:
            while not self._stop.is_set():
                grew = False
                growing = self.growing
                for part in self.log.episodes(int(begin)):
                    self._say()
                    if self._stop.is_set():
                        return
                    grew = True
                    open_one = part.history
                    if part.open_step is not None:  # its last episode may go on
                        done = History(**{n: a[:-1] for n, a in part.history.arrays().items()})
                        begin = part.open_step
                    else:
                        done, begin = part.history, part.last_step + 1
                    whole = [concatenated([*whole, done])]
                    asked = asked + part.asked
                    self._asked.append((int(begin) - 1, asked))
                    if time.monotonic() - put > CURVES_SECONDS:
                        put = time.monotonic()
                        self._put_curves(whole, open_one, part.open_step, int(begin))
                    time.sleep(0.002)  # playing comes first
                if grew or not put:
                    put = time.monotonic()
                    last = None if open_one.episodes == 0 else int(open_one.first_step[-1])
                    self._put_curves(whole, open_one, last if begin == last else None, None)
                if not growing:
                    break
                self._stop.wait(LOOK_SECONDS)
            if not self._stop.is_set():
                self._evaluate()
        except SparseCoordError as error:
            self._trouble(str(error))

    def _put_curves(
        self, whole: list[History], newest: History, open_step: int | None, reached: int | None
    ) -> None:
        parts = list(whole)
        if open_step is not None and newest.episodes:
            parts.append(History(**{n: a[-1:] for n, a in newest.arrays().items()}))
        history = concatenated(parts) if parts else newest
        share = None if reached is None else reached / max(1, self.log.last_step)
        self.board.put(frames.curves_message(history, until=share))

    def _evaluate(self) -> None:
        """Say what the newest tables are worth, where all robots have some of them."""
        entries = [self.log.tables_before(k, 2**62) for k in range(len(self.run.scenario.robots))]
        found = [entry for entry in entries if entry is not None]
        if len(found) == len(entries) and any(entry.step for entry in found):
            step = min(entry.step for entry in found)
            tables = [entry.tables for entry in found]
            self.board.put(evaluation_message(self.run, tables, step))


def _title(path: Path) -> str:
    """Return what the page calls a bag: its directory."""
    return str(path if path.is_dir() else path.parent)


def being_recorded_still(path: Path) -> bool:
    """Whether a recorder holds the file's lock; one that was renamed or removed has none."""
    try:
        return being_recorded(path)
    except BagError:
        return False


def moment_of(log: RunLog, row: int) -> frames.Moment:
    """Return a time step of a log, given by its row."""
    robots = range(len(log.names))
    asks = []
    for one in logged_asks(log, row):
        code = log.numbers[row, one.asker, ENDED]
        ended = {ANSWERED: "answered", REFUSED: "refused"}.get(one.outcome, "no answer")
        if code in range(len(PERCEPT_ENDS)):
            ended = PERCEPT_ENDS[int(code)]
        asks.append(frames.Ask(one.asker, one.peers, one.outcome, ended))
    rewards: list[tuple[float, float, float, float] | None] = []
    for parts in log.reward[row].tolist():
        individual, common, ask_cost, total = parts
        rewards.append(None if total != total else (individual, common, ask_cost, total))
    after = None
    met = False
    if row + 1 < len(log.step) and log.step[row + 1] == log.step[row] + 1:
        after = [None if cell == NONE else cell for cell in log.cells[row + 1].tolist()]
        acted = any(reward is not None for reward in rewards)
        met = acted and bool(miscoordinations(log.run.scenario, log.cells[row + 1 : row + 2])[0])
    return frames.Moment(
        step=int(log.step[row]),
        cells=[None if cell == NONE else cell for cell in log.cells[row].tolist()],
        moves=[None if log.move[row, k] == NONE else int(log.move[row, k]) for k in robots],
        asks=tuple(asks),
        rewards=rewards,
        after=after,
        miscoordination=met,
    )
