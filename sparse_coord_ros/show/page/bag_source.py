# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag on the page: played, held, stepped, sought in; followed while it grows."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path

import numpy as np

from sparse_coord_ros.base.errors import BagError, SparseCoordError
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.plugins import leaving_out
from sparse_coord_ros.core.runs.history import blank_history, concatenated
from sparse_coord_ros.log.bags.layout import being_recorded
from sparse_coord_ros.log.runlog import explain
from sparse_coord_ros.log.runlog.growing import GrowingLog
from sparse_coord_ros.log.runlog.log import NONE, RecordedTables, RunLog
from sparse_coord_ros.log.runlog.relearned import AskedQuestion, Relearned
from sparse_coord_ros.show.narrator import Narrator
from sparse_coord_ros.show.page import controls, page_messages
from sparse_coord_ros.show.page.counts import Counts
from sparse_coord_ros.show.page.key_steps import (
    Highlight,
    KeySteps,
    LearnedTeam,
    highlight,
    kinds_of,
)
from sparse_coord_ros.show.page.live_source import ASKED_SO_FAR
from sparse_coord_ros.show.page.message_board import Message, MessageBoard
from sparse_coord_ros.show.steps import logged_step, logged_trails, questions_of

BAG_CONTROLS = (
    controls.PAUSE,
    controls.STEP,
    controls.RATE,
    controls.SEEK,
    controls.JUMP,
)

FRAME_SECONDS = 1 / 30
GROWTH_SECONDS = 0.5
"""Time between two checks whether the file has grown."""

LOOKING = 10
"""The pause after such a check, in times of what it took: it arranges the whole log anew."""

FIRST_RATE = 10.0

SHOWN_RATE = 2.0
"""Time steps a second of the episode that shows what was learned, until the user sets a rate."""

SHOWN_STEPS = 3000
"""That episode is searched for among this many last time steps."""

LINGER = 3
"""Steps for which its end is shown before it is played again."""

MARKS = 300
"""Marks of a kind on the time line at most."""

KIND_NAMES = {
    controls.QUESTION: "question",
    controls.MISCOORDINATION: "miscoordination",
    controls.POLICY: "change of where a robot would ask",
    controls.CROSSING: "crossing",
    controls.EXCHANGE: "exchange",
    controls.STOPPED: "robot that another one stops",
}
"""The names of what a page can jump to."""

STILL_STEPS = 10_000
"""A request for tables of a time step is dropped once this many newer steps have followed."""


class BagSource(controls.Played):
    """Plays a bag to a board.

    Args:
        path: a bag's directory or file, or a run's directory.
        board: where the messages go.
        rate: time steps a second; 0: as far as the log goes.
        step: the learning step to begin at; None: what was learned is shown.
        progress: called while the bag is read, as by `read_run`.

    Attributes:
        log: the bag.
        growing: whether it is still being recorded.
        first: its first time step.
        position: the time step that is shown, with its fraction.
        paused: whether time stands still.
        history: the episodes that were read so far.
        rate: as given, or wanted since.

    Raises:
        BagError, RunError, ScenarioError, SettingError: the bag contains no run to show.
    """

    def __init__(
        self,
        path: Path,
        board: MessageBoard,
        *,
        rate: float = FIRST_RATE,
        step: int | None = None,
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> None:
        super().__init__()
        self.log = GrowingLog(path, progress)
        self.run = self.log.run
        self.board = board
        self.growing = self._grows()
        if self.log.empty:
            what = "see 'sparse_coord info'"
            if self.growing:
                what = "its recording has just started; try again soon"
            raise BagError(f"{path}: holds no message to show: {what}")
        log = self.log.so_far
        acted = np.flatnonzero((log.cells != NONE).any(axis=1))
        self.first = int(log.step[acted[0]] if len(acted) else log.step[0])
        self.position = float(self.log.last_step if self.growing else self.first)
        self.paused = False
        self.rate = rate
        self._shown_rate = SHOWN_RATE
        self._narrator = Narrator(self.run.scenario)
        self._key_steps = KeySteps(self.run)
        self.highlight: Highlight | None = None
        self._again = False
        self._window: RunLog | None = None
        self._shown: dict[str, object] = {}
        self._relearned = Relearned(self.log)
        scenario = self.run.scenario
        self._counts = Counts(len(scenario.robots), len(scenario.map.cells))
        self._questions: list[tuple[int, AskedQuestion]] = []
        self.history = blank_history(0, len(scenario.robots))
        self._reasons: dict[tuple[int, int], explain.Reason | None] = {}
        self._reasons_known = 0
        self._stop = threading.Event()
        self._looks = time.monotonic()  # when it looks again whether the file has grown
        fields = page_messages.run_fields(self.run)
        path_of_bag = self.log.path
        in_a_folder = path_of_bag.is_file() and path_of_bag.parent.name != ""
        title = str(path_of_bag.parent if in_a_folder else path_of_bag)
        board.put("run", source="bag", title=title, controls=BAG_CONTROLS, **fields)
        board.source = self
        self._notice()
        if not self.growing:
            self._find_highlight()
            self._show_again()
        if step is not None:
            self._go(self.log.so_far.time_step(step))

    def _find_highlight(self) -> None:
        """Find the episode that shows what was learned, and say so."""
        last = self.log.last_step
        most = max(SHOWN_STEPS, 4 * self.run.scenario.max_steps)
        try:
            log = self.log.so_far.between(max(0, last - most), last)
            # the first one may be cut
            whole = log.history().first_step[int(last > most) :]
            newest = self.newest()
            if len(whole) and newest:
                team = LearnedTeam(self.run, [entry.tables for entry in newest])
                log = log.between(int(whole[0]), last)
                self.highlight = highlight(log, team, self._key_steps, self._narrator)
        except SparseCoordError:  # that it is damaged is said where all of it is read
            return
        if self.highlight is not None:
            tables = {entry.robot: (entry.step, entry.tables) for entry in newest}
            page_messages.put_tables(self.board, self.run, tables)
            self._tell_learned()

    def newest(self) -> list[RecordedTables]:
        """Return every robot's newest tables; an empty list if a robot has none."""
        newest = []
        for k in range(len(self.run.scenario.robots)):
            entry = self.log.so_far.tables_before(k)
            if entry is None:
                return []
            newest.append(entry)
        return newest

    def _tell_learned(self, *, read: bool = False) -> None:
        """Say what was learned; and since when, if the whole log has been `read`."""
        shown = self.highlight
        if shown is None:
            return
        evaluation = self.board.get("evaluation")
        question = shown.text
        if evaluation is not None and not shown.matters:
            question = ""
        lines = [page_messages.headline(question, evaluation)]
        if read and lines == [shown.text] and shown.matters:
            first, since = self._key_steps.since(shown.robot, shown.cell)
            name = self._narrator.names[shown.robot]
            lines.append(since_in_words(name, first, since))
        page_messages.put_learned(self.board, lines, first=shown.first, step=shown.step)

    def _show_again(self) -> None:
        """Play the episode that shows what was learned, in a loop."""
        if self.highlight is not None:
            self._go(self.highlight.first)
            self._again = True
            self._shown_rate = SHOWN_RATE
            self.paused = False

    def _go(self, step: int) -> None:
        """Show a time step, and what comes after it."""
        self.position = float(min(max(step, self.first), self.log.last_step))
        self._again = False

    @property
    def _pace(self) -> float:
        """Time steps a second now."""
        if not self._again:
            return self.rate
        return min(self.rate or np.inf, self._shown_rate)

    def _new(self, what: str, key: object) -> bool:
        """Whether a message differs from the last one of its kind."""
        new = self._shown.get(what) != key
        self._shown[what] = key
        return new

    def _grows(self) -> bool:
        """Whether a recorder holds the file's lock; a renamed or removed file has no lock."""
        try:
            return not self.log.finished and being_recorded(self.log.last_file)
        except BagError:
            return False

    # In the thread of the source.

    def play(self) -> None:
        """Play until interrupted; time stands still while no page is open."""
        self.tick()
        with self.reading():
            while True:
                self.look_when_due()
                if self.board.pages:
                    self.tick()
                else:
                    self.stand_still()
                time.sleep(FRAME_SECONDS)

    def look_when_due(self) -> None:
        """Look whether the file has grown, if the last time was long enough ago."""
        begun = time.monotonic()
        if not self.growing or begun < self._looks:
            return
        self.look()
        now = time.monotonic()
        self._looks = now + max(GROWTH_SECONDS, LOOKING * (now - begun))

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Read the log and learn along in threads of their own; close the bag at the end."""
        tasks = (self.read_through, self._learn_along)
        beside = [threading.Thread(target=task, daemon=True) for task in tasks]
        for thread in beside:
            thread.start()
        try:
            yield
        finally:
            self._stop.set()
            for thread in beside:
                thread.join()

    def show_at(self, step: int, *, paused: bool) -> None:
        """Show a time step; another clock than its own says which."""
        self._go(step)
        self.paused = paused
        self.show()

    def look(self) -> None:
        """Take in what the file has grown by."""
        following = self.following
        growing = self._grows()
        if self.log.extend():
            self._window = None
        if following:
            self.position = float(self.log.last_step)
        if self.log.finished or not growing:
            self._find_highlight()
            self.growing = False
            self._notice()

    def move_on(self, seconds: float) -> None:
        """Play for so long; what was learned again and again, a log up to its end."""
        if self.paused:
            return
        last = float(self.log.last_step)
        on = seconds * self._pace if self._pace else last
        self.position = min(self.position + on, last)
        shown = self.highlight if self._again else None
        if shown is not None and self.position >= shown.last + LINGER:
            self.position = float(shown.first)
        self.paused = self.position >= last and not self.growing

    def carry_out(self, control: controls.Control) -> None:
        """Do what a page asks for."""
        self._say("")
        match control.name:
            case controls.PAUSE:
                self._hold(control.value)
            case controls.RATE:
                self.rate = control.value
                self._shown_rate = np.inf
            case controls.SEEK:
                self._seek(control.value)
            case controls.STEP:
                self.paused = True
                self._go(self._beside(control.value))
            case controls.JUMP if control.value == controls.LEARNED_EPISODE:
                self._show_again()
            case controls.JUMP:
                self._jump(control.value)

    def _hold(self, paused: bool) -> None:
        """Stop, or play; at the end of the log from its beginning."""
        self.paused = paused
        at_end = self.position >= self.log.last_step and not self.growing
        if not paused and at_end:
            self.position = float(self.first)

    def _seek(self, step: int) -> None:
        """Show a time step; at the end of a log that grows, follow it."""
        self._go(step)
        if self.growing and self.position >= self.log.last_step:
            self.paused = False

    def _jump(self, kind: str) -> None:
        """Go to the first crossing, or to the next step of another kind; or say there is none."""
        steps = self._key_steps.steps[kind]
        step = 0 if kind == controls.CROSSING else int(self.position) + 1
        index = int(np.searchsorted(steps, step))
        if index < len(steps):
            self._go(int(steps[index]))
            self.paused = True
            return
        what = f"No {KIND_NAMES[kind]}"
        if kind != controls.CROSSING:
            what = f"{what} after this step"
        read = max(0, self._counts.read_to) / max(1, self.log.last_step)
        if read < 1.0:
            what = f"{what}; {percent(read, whole=True)} of the log are read so far"
        self._say(f"{what}.")

    def _say(self, text: str) -> None:
        """Show the result of a control; an empty text clears it."""
        if self._new("said", text):
            self.board.put("said", text=text)

    def _beside(self, count: int) -> int:
        """Return the time step that is `count` steps later in the log; earlier if negative."""
        log = self._around()
        row = self._row(log) + count
        if 0 <= row < len(log.step):
            return int(log.step[row])
        return int(self.position) + count

    def _row(self, log: RunLog) -> int:
        """Return the row of the position in a part of the log; -1: before it."""
        return int(np.searchsorted(log.step, int(self.position), side="right")) - 1

    def _around(self) -> RunLog:
        """Return the part of the log around the position."""
        window = self._window
        step = int(self.position)
        margin = 2  # a transition needs the next state
        if window is None or not (
            len(window.step) and window.step[0] <= step <= window.step[-1] - margin
        ):
            window = self._window = self.log.around(step)
            self._notice()
        return window

    @property
    def following(self) -> bool:
        """Whether the newest time step is shown, and the next one as soon as it is there."""
        return self.growing and not self.paused and self.position >= self.log.last_step

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
            log = self._around()
            row = self._row(log)
            if row >= 0:
                self._show(log, row)
        except SparseCoordError as error:
            self.board.put("notice", text=f"damaged: {error}")

    def _show(self, log: RunLog, row: int) -> None:
        step = int(log.step[row])
        so_far = self._counts.up_to(step, log)
        around: Message = {"rate": self._pace, "made": self._counts.made_before(step)}
        around |= {"first": self.first, "last": self.log.last_step}
        around |= {"episodes": so_far.episodes, "counted_to": so_far.read_to}
        if self._new("frame", (step, self.state, around)):
            fields = page_messages.frame_fields(
                logged_step(log, row), logged_trails(log, row), self._narrator
            )
            self.board.put("frame", state=self.state, **around, **fields)
        self._tell(log, row)
        if self._new("asked", so_far.questions):
            self.board.put("asked", robots=so_far.asked.tolist(), where=ASKED_SO_FAR)

    def _tell(self, log: RunLog, row: int) -> None:
        """Show the last questions up to a row, if they are not shown already.

        Their details have what decided, once the tables were learned again.
        """
        asking = np.flatnonzero(log.asked[: row + 1].any(axis=1))[
            -page_messages.MOST_ENTRIES :
        ]
        since = None
        if log.step[0] > self.first:
            since = self._counts.made_before(int(log.step[0]))
        last = log.step[asking[-1:]].tolist()
        counted = [self._counts.made_before(step) for step in last]
        if not self._new("dialogue", (last, counted, since, self._reasons_known)):
            return
        known = {k for k, at in enumerate(self.log.so_far.table_steps()) if at}
        entries: list[Message] = []
        questions: list[tuple[int, AskedQuestion]] = []
        for question_row in asking.tolist():
            seen = logged_step(log, question_row)
            reasons = {
                k: reason
                for (step, k), reason in self._reasons.items()
                if step == seen.step and reason is not None
            }
            rows = {
                k: f": {explain.row_in_words(reason.values)}"
                for k, reason in reasons.items()
            }
            entries += page_messages.in_words(
                self.run,
                seen,
                known,
                self._narrator,
                rows,
                reasons,
                self._counts.made_before(seen.step),
            )
            asked = (
                page_messages.asked_of(seen, question)
                for question in questions_of(seen)
            )
            questions += [
                (seen.step, question) for question in asked if question is not None
            ]
        self._questions = questions[-page_messages.MOST_ENTRIES :]
        self.board.put(
            "dialogue", entries=entries[-page_messages.MOST_ENTRIES :], since=since
        )

    def _notice(self) -> None:
        """Say what state the file is in."""
        log = self.log
        text = ""
        if self.growing and not log.damaged:
            text = "still being recorded: the page follows it"
        elif log.so_far.damage is not None:
            text = log.so_far.damage
        if self._new("notice", text):
            self.board.put("notice", text=text)

    # In threads beside it.

    def _learn_along(self) -> None:
        while not self._stop.wait(FRAME_SECONDS):
            self.learn()

    def learn(self) -> None:
        """Show what the robots had learned at the time step that is shown.

        As long as a bag that grows is followed, the tables are the newest recorded ones.
        """
        step = int(self.position)
        following = self.following
        steps = self.log.so_far.table_steps() if following else None

        def still() -> bool:
            here = 0 <= self.position - step < STILL_STEPS
            return here and not (following or self._stop.is_set())

        try:
            if not self._new("tables", steps or step):
                if not following:
                    self._find_reasons(
                        0, step, lambda: still() and int(self.position) == step
                    )
                return
            if not following:  # on the way to the time step
                self._find_reasons(self._relearned.begin(step), step, still)
            tables = self._relearned.tables(step, still)
        except SparseCoordError as error:
            self.board.put("notice", text=f"damaged: {error}")
            return
        if still() or following:
            page_messages.put_tables(self.board, self.run, tables)

    def _find_reasons(self, first: int, last: int, still: Callable[[], bool]) -> None:
        """Find what decided after the questions that are shown.

        Args:
            first: of which time step on.
            last: up to which time step.
            still: whether they are still wanted.
        """
        shown = self._questions
        keys = {(step, question.robot) for step, question in shown}
        reasons = {key: reason for key, reason in self._reasons.items() if key in keys}
        for step, group in groupby(shown, key=lambda question: question[0]):
            asked = [
                question
                for _, question in group
                if (step, question.robot) not in reasons
            ]
            if not asked or not first <= step <= last:
                continue
            new = self._relearned.reasons(step, asked, still)
            if not still():
                break
            for index, question in enumerate(asked):
                reasons[step, question.robot] = None if new is None else new[index]
        if reasons != self._reasons:
            self._reasons = reasons
            self._reasons_known += 1

    def read_through(self) -> None:
        """Compute the learning curves from the log, stretch by stretch, and go on as it grows."""
        scenario = self.run.scenario
        whole = blank_history(0, len(scenario.robots))
        begin = 0
        recorded_now = self.growing
        try:
            if not recorded_now:  # that a team fails comes before what it learned
                self._evaluate()
                self._tell_learned()
            while True:
                growing = self.growing
                for part in self.log.episodes(begin):
                    self._notice()
                    if self._stop.is_set():
                        return
                    self.history = whole = concatenated([whole, part.history])
                    self._counts = self._counts.with_part(begin, part)
                    begin = part.last_step + 1
                    if part.open_step is not None:  # its last episode may go on
                        whole = whole.first(-1)
                        begin = part.open_step
                    self._key_steps.add(part)
                    self._mark()
                    share = begin / max(1, self.log.last_step)
                    self._show_curves(share)
                    time.sleep(0.002)  # playing comes first
                self._show_curves(1.0)
                if not growing:
                    break
                if self._stop.wait(GROWTH_SECONDS):
                    return
            if recorded_now:
                self._evaluate()
            self._tell_learned(read=True)
        except SparseCoordError as error:
            self.board.put("notice", text=f"damaged: {error}")

    def _show_curves(self, read: float) -> None:
        """Show the learning curves of the share of the log that was `read`."""
        self.board.put("curves", read=read, **page_messages.curve_fields(self.history))
        if self.growing:
            page_messages.put_so_far(self.board, self.run, self.history)

    def _mark(self) -> None:
        """Show on the time line where what matters is."""
        per_mark = max(1, (self.log.last_step - self.first) // MARKS)
        marks = {}
        for kind in kinds_of(self.run.scenario):
            steps = self._key_steps.steps[kind]
            few = np.zeros(len(steps), dtype=bool)
            few[np.unique(steps // per_mark, return_index=True)[1]] = True
            if self.highlight is not None:  # of that episode all
                shown = self.highlight
                few |= (steps >= shown.first) & (steps <= shown.last)
            marks[kind] = steps[few].tolist()
        self.board.put("marks", **marks)

    def _evaluate(self) -> None:
        """Show the value of the newest tables, where all robots have learned some."""
        newest = self.newest()
        if any(entry.step for entry in newest):
            step = min(entry.step for entry in newest)
            tables = [entry.tables for entry in newest]
            with leaving_out(
                "their value", lambda problem: self.board.put("notice", text=problem)
            ):
                measures = page_messages.measured(self.run, tables)
                value = page_messages.evaluation_fields(
                    self.run, tables, measures, step
                )
                self.board.put("evaluation", **value)


def since_in_words(name: str, first: int, since: int | None) -> str:
    """Say since when a robot would ask where it does.

    Args:
        name: of the robot.
        first: the learning step of its first tables.
        since: the one since which its tables say so; None: the newest tables do not.
    """
    if since is None:
        return f"By its newest tables {name} would not ask there."
    if since == first:
        return f"By its tables {name} would have asked there from the start."
    return f"{name} learned to ask there at about step {float(f'{since:.3g}'):,.0f}."
