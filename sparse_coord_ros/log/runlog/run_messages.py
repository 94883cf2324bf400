# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages sorted by topic and time step, with notes on errors in them."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.log.bags.reader import Bag, open_bag
from sparse_coord_ros.log.runlog import timeline
from sparse_coord_ros.log.runlog.attached import RecordedTables, read_tables
from sparse_coord_ros.log.runlog.bag_run import BagRun, check_bag_run, find_run
from sparse_coord_ros.log.runlog.columns import (
    OFTEN,
    Columns,
    Forms,
    Only,
    Reading,
    no_rows,
)
from sparse_coord_ros.log.runlog.dialogue import Request, put_together
from sparse_coord_ros.log.runlog.difference import (
    MISSING,
    NO_REQUEST,
    TWICE,
    Difference,
)
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import OVER, RunState, messages
from sparse_coord_ros.protocol.wire.events import event_form
from sparse_coord_ros.protocol.wire.frame import Frame
from sparse_coord_ros.protocol.wire.occupancy import OccupancyData
from sparse_coord_ros.protocol.wire.status import RunStatus, read_status, values_of

THE_CLOCK = wire.CLOCK.name


class Series(NamedTuple):
    """The messages of a topic with one message a time step.

    Attributes:
        step: their time steps, ascending, shape (n,).
        rows: their contents, shape (n,).
        repeats: time steps of further messages with the same content, one entry each.
        others: rows of further messages with another content, by time step.
    """

    step: np.ndarray
    rows: np.ndarray
    repeats: np.ndarray = np.empty(0, dtype=np.int64)
    others: Mapping[int, list[Any]] = MappingProxyType({})


OF_NO_RUN = RunStatus("none", "", 0, 0)
"""In place of a status without a run: every world's status names its run."""


def _read_status(message: Any) -> RunStatus:
    """Return a decoded status; ValueError if it names a run and lacks another value."""
    return read_status(message) if "run" in values_of(message) else OF_NO_RUN


class RunMessages:
    """A bag's messages of a run, sorted; without its attachments, which `add_tables` reads.

    Args:
        bag: the bag, or a part of one.
        found: its run.
        only: the topics to read, the others seem to have no messages; None: all.

    Attributes:
        bag: the bag.
        run: the run.
        prefix: the beginning of the names of the run's topics.
        names: the robots.
        clock_topic: the full name of the clock's topic.
        forms: the run's topics by their full names, each with its `Reading`.
        states, rewards, actions, percepts: the messages of each robot. Rows of states have `xy`;
            of rewards and actions `numbers`, in the order of their labels; of percepts `count`
            positions `places`, the own one first.
        clock: the messages of the clock.
        maps: time steps, in the order of the log.
        markers: the same, with the robots' positions `places`; empty if their stamps are not time
            steps.
        coordination_maps: those of each robot, with the grid's `data`.
        statuses: the world's statuses, in the order of the log.
        ended: whether the world's last status is the end of the run. If only a part is read it is
            True.
        requests: the dialogue.
        tables: the attached tables.
        stalls: pauses in which the recorder did not run.
        rollbacks: returns of the team to a checkpoint; superseded messages are left out.
        gaps: the missing time steps before the log's end; unordered.
        problems: the errors in messages and attachments.
        foreign: messages that are not the run's, or that exist in two versions: a foreign node may
            have sent them.
    """

    def __init__(self, bag: Bag, found: BagRun, only: Only = None) -> None:
        self.bag = bag
        self.run = found.run
        self.prefix = found.prefix
        self.names = tuple(robot.name for robot in self.run.scenario.robots)
        self.clock_topic = bag.clock or f"/{wire.CLOCK.name}"
        self.tables: list[RecordedTables] = []
        self.forms = self._forms()
        self._period = Frame(self.run).period
        self.stalls = timeline.stalls(bag)
        self._backs = timeline.rollbacks(bag)
        columns = self._read(only)
        self._files = columns.rows
        self.problems = columns.problems
        self.foreign = columns.foreign
        self.clock = self._series(wire.CLOCK)
        self.states = self._series_of_robots(wire.LOCAL_STATE)
        self.rewards = self._series_of_robots(wire.REWARD)
        self.actions = self._series_of_robots(wire.ACTION)
        self.percepts = self._series_of_robots(wire.PERCEPT)
        self.maps, _ = self._several(wire.MAP)
        self.markers = self._markers()
        self.coordination_maps = [
            self._several(wire.COORDINATION_MAP, k) for k in range(len(self.names))
        ]
        self.gaps, self.rollbacks = self._gaps_between_files()
        self._take_jumps(columns.jumps)
        self._leave_out_foreign_steps()
        for step in self.clock.repeats.tolist():
            self.problems.append(self.difference(step, None, THE_CLOCK, TWICE, "once"))
        own = list(self._own_statuses())
        self.statuses = list(self._checked(own))
        over = bool(own) and own[-1].state in OVER
        self.ended = over or bag.part or only is not None
        self.requests: list[Request] = []
        self._read_dialogue()

    def _forms(self) -> Forms:
        """Return the run's topics by their full names, each with its `Reading`."""
        run = self.run
        frame = Frame(self.run)
        of_team: dict[wire.Topic, Reading] = {
            wire.CLOCK: messages.CLOCK_FORM,
            wire.MAP: messages.grid_form(frame, OccupancyData(frame).map),
            wire.MARKERS: messages.markers_form(frame, run.scenario),
            wire.STATUS: _read_status,
        }
        of_robot: dict[wire.Topic, Reading] = {
            wire.LOCAL_STATE: messages.POSE_FORM,
            wire.REWARD: messages.REWARD_FORM,
            wire.ACTION: messages.ACTION_FORM,
            wire.PERCEPT: messages.percept_form(len(self.names)),
            wire.COORDINATION_MAP: messages.grid_form(frame),
            wire.SERVICE_EVENTS: event_form(self.names),
        }
        found = {self.topic(topic): (topic, form) for topic, form in of_team.items()}
        for k in range(len(self.names)):
            for topic, form in of_robot.items():
                found[self.topic(topic, k)] = topic, form
        return found

    def _read(self, only: Only) -> Columns:
        """Read the bag's messages as columns."""
        begins = {back.file: (back.first - 1) * self._period for back in self._backs}
        return Columns(self.bag, self.forms, only, self._period, begins)

    @property
    def incomplete(self) -> bool:
        """True if a part of the run may be missing in the log."""
        return self.lossy or not self.ended

    @property
    def lossy(self) -> bool:
        """True if a part of the bag may be lost, or was not recorded."""
        return self._cut or bool(self.bag.gaps or self.gaps or self.stalls)

    @property
    def broken_off(self) -> bool:
        """True if the end of the run is not in the bag."""
        return self._cut or not self.ended

    @property
    def _cut(self) -> bool:
        """True if the end of the bag is lost."""
        bag = self.bag
        if not bag.finished or bag.recovered is not None:
            return True
        steps = [series.step[-1] for series in self.states if len(series.step)]
        newest = int(max(steps, default=0)) * self._period
        return any(gap.last_ns is None or gap.last_ns > newest for gap in bag.gaps)

    def of_robot(self, k: int) -> tuple[Series, Series, Series, Series]:
        """Return one robot's states, rewards, actions and percepts."""
        return self.states[k], self.rewards[k], self.actions[k], self.percepts[k]

    def difference(
        self, step: int | None, robot: int | None, *words: str
    ) -> Difference:
        """Return a difference.

        Args:
            step: the time step, or None.
            robot: the robot's number, or None.
            words: the quantity, its logged value, its computed value.
        """
        return Difference(step, None if robot is None else self.names[robot], *words)

    def topic(self, topic: wire.Topic, robot: int | None = None) -> str:
        """Return a topic's full name."""
        if topic is wire.CLOCK:
            return self.clock_topic
        if robot is None:
            return self.prefix + topic.name
        return self.prefix + topic.of(self.names[robot])

    def add_tables(self) -> None:
        """Read the attached tables."""
        self.tables, problems = read_tables(self.bag, self.run, self.rollbacks)
        self.problems += problems

    # Gaps.

    def _of_files(self, topic: wire.Topic, k: int | None = None) -> list[np.ndarray]:
        """Return the rows of a topic, for each file."""
        return [rows[self.topic(topic, k)] for rows in self._files]

    def _gaps_between_files(
        self,
    ) -> tuple[list[timeline.LostSteps], list[timeline.Rollback]]:
        """Return the gaps between the files of the bag, and the roll-backs."""
        clocks = [
            timeline.steps_of(rows, self._period) for rows in self._of_files(wire.CLOCK)
        ]
        heard = [self._heard_from(place) for place in range(len(clocks))]
        heard_to = [self._heard_to(place) for place in range(len(clocks))]
        last_status = 0
        for rows in self._of_files(wire.STATUS):
            for status in rows:
                if status is not OF_NO_RUN:
                    last_status = status.step
        late = not self.run.recorded
        return timeline.gaps(
            self.bag, clocks, heard, heard_to, self._backs, last_status, late
        )

    def _take_jumps(self, jumps: Sequence[timeline.Jump]) -> None:
        """Count jumps in the sequence numbers as gaps; in a log without loss they are problems."""
        if not self.lossy:
            self.problems += [jump.difference for jump in jumps]
            return
        often = {name for name, (topic, _) in self.forms.items() if topic in OFTEN}
        of_steps = [jump for jump in jumps if jump.topic in often]
        self.gaps = timeline.with_jumps(self.gaps, of_steps, self._period)

    def _heard_from(self, place: int) -> int:
        """Return the time step from which on a file has the actions of all rewarded robots."""
        heard = 0
        for k in range(len(self.names)):
            actions = self._of_files(wire.ACTION, k)[place]
            rewards = self._of_files(wire.REWARD, k)[place]
            if not len(actions) or not len(rewards):
                continue
            acted = int(timeline.steps_of(actions, self._period).min())
            rewarded = int(timeline.steps_of(rewards, self._period).min())
            if rewarded < acted:
                heard = max(heard, acted)
        return heard

    def _heard_to(self, place: int) -> int:
        """Return the time step up to which a file has the clock and all robots' states."""
        topics = [self._of_files(wire.CLOCK)[place]]
        for k in range(len(self.names)):
            topics.append(self._of_files(wire.LOCAL_STATE, k)[place])
        ends = [
            int(timeline.steps_of(rows, self._period).max())
            for rows in topics
            if len(rows)
        ]
        return min(ends, default=0)

    # Topics with one message a time step.

    def _rows(self, topic: wire.Topic, k: int | None) -> tuple[np.ndarray, np.ndarray]:
        """Return the time steps and rows of a topic; a stamp between time steps is foreign."""
        rows = timeline.without_superseded(
            self._of_files(topic, k),
            self._backs,
            self._period,
            checkpoints=topic is wire.COORDINATION_MAP,
        )
        steps = timeline.steps_of(rows, self._period)
        due = steps * self._period
        right = (rows["ns"] == due) & (rows["ns"] >= 0)
        if right.all():
            return steps, rows
        for place in np.flatnonzero(~right).tolist():
            ns = int(rows["ns"][place])
            words = f"{topic.name} stamp", f"{ns} ns"
            if ns < 0:
                found = self.difference(None, k, *words, "0 or later")
            else:
                found = self.difference(
                    int(steps[place]), k, *words, f"{due[place]} ns"
                )
            self.foreign.append(found)
        return steps[right], rows[right]

    def _series_of_robots(self, topic: wire.Topic) -> list[Series]:
        """Return the messages of a topic with one message a robot and time step."""
        return [self._series(topic, k) for k in range(len(self.names))]

    def _series(self, topic: wire.Topic, k: int | None = None) -> Series:
        """Return the messages of a topic with one message a time step.

        Of several messages of a time step the first one counts; messages out of order come last.
        """
        steps, rows = self._rows(topic, k)
        if (np.diff(steps) > 0).all():
            return Series(steps, rows)
        ordered = in_order(steps, each_once=True)
        newest = np.maximum.accumulate(np.where(ordered, steps, -1))
        by_step = np.lexsort((~ordered, steps))
        found, first = np.unique(steps[by_step], return_index=True)
        counted = by_step[first]
        place_of = dict(zip(found.tolist(), counted.tolist(), strict=True))
        repeats: list[int] = []
        others: dict[int, list[Any]] = {}
        for place, step in enumerate(steps.tolist()):
            counts = place_of[step] == place
            if counts and ordered[place]:
                continue
            last = int(newest[place])
            mine = rows[place_of[step]]
            if counts:
                words = f"after that of time step {last}", "before it"
                self.problems.append(self.difference(step, k, topic.name, *words))
            elif rows[place].tobytes() != mine.tobytes():
                others.setdefault(step, []).append(rows[place])
                both = f"{mine.tolist()[1:]} and {rows[place].tolist()[1:]}"
                words = f"twice, with {both}", "once"
                self.foreign.append(self.difference(step, k, topic.name, *words))
            elif step < last:
                words = f"again after that of time step {last}", "once"
                self.foreign.append(self.difference(step, k, topic.name, *words))
            else:
                repeats.append(step)
        return Series(found, rows[counted], np.array(repeats, dtype=np.int64), others)

    def _leave_out_foreign_steps(self) -> None:
        """Leave out messages of steps that do not belong to the run.

        Steps are numbered from 1. A step with messages of only one topic may come from a foreign
        node. Near a lost part and at the end of the log, messages may be missing.
        """
        heard = [self.clock, *self.states]
        if self.lossy or not all(len(series.step) for series in heard):
            return
        every = np.concatenate([series.step for series in heard])
        steps, topics = np.unique(every, return_counts=True)
        newest = steps[topics == len(heard)].max(initial=0)
        of_run = (topics > 1) | (steps >= newest)
        of_run &= (steps <= newest + EPISODE_GAP) & (steps > 0)
        mine = steps[of_run]
        self.clock = self._only(mine, self.clock, wire.CLOCK)
        for topic, of_robots in (
            (wire.LOCAL_STATE, self.states),
            (wire.REWARD, self.rewards),
            (wire.ACTION, self.actions),
            (wire.PERCEPT, self.percepts),
        ):
            for k, series in enumerate(of_robots):
                of_robots[k] = self._only(mine, series, topic, k)

    def _only(
        self, steps: np.ndarray, series: Series, topic: wire.Topic, k: int | None = None
    ) -> Series:
        """Return the messages of some time steps; note the others as foreign."""
        mine = np.isin(series.step, steps)
        if mine.all():
            return series
        for step in series.step[~mine].tolist():
            words = "there", "none: no time step of the run"
            self.foreign.append(self.difference(step, k, topic.name, *words))
            self.problems = [
                one
                for one in self.problems
                if (one.step, one.quantity) != (step, topic.name)
            ]
        repeats = series.repeats[np.isin(series.repeats, steps)]
        return series._replace(
            step=series.step[mine], rows=series.rows[mine], repeats=repeats
        )

    # Topics with several messages a time step.

    def _several(
        self, topic: wire.Topic, k: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the time steps and rows of a topic with several messages a time step."""
        steps, rows = self._rows(topic, k)
        for place in np.flatnonzero(np.diff(steps) < 0).tolist():
            words = f"after that of time step {steps[place]}", "before it"
            self.problems.append(
                self.difference(int(steps[place + 1]), k, topic.name, *words)
            )
        return steps, rows

    def _markers(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the time steps and rows of the markers; empty if their stamps are not steps."""
        if self.run.markers_tell_steps:
            return self._several(wire.MARKERS)
        topic = self.topic(wire.MARKERS)
        self.foreign = [one for one in self.foreign if one.quantity != f"topic {topic}"]
        _, form = self.forms[topic]
        return np.empty(0, dtype=np.int64), no_rows(form)

    # The world's status.

    def _own_statuses(self) -> Iterator[RunStatus]:
        """Yield the statuses of the run that no roll-back supersedes; note foreign ones."""
        for place, rows in enumerate(self._of_files(wire.STATUS)):
            for status in rows:
                if self._is_foreign(status):
                    words = f"of run {status.run!r}", self.run.id or "this one"
                    self.foreign.append(_of_status(status, *words))
                    continue
                # A world that has not gone back yet does not know the team's time step.
                knows = status.state != RunState.RESUMING
                if knows and not timeline.superseded(place, status.step, self._backs):
                    yield status

    def _is_foreign(self, status: RunStatus) -> bool:
        if status is OF_NO_RUN:
            return True
        return bool(status.run and self.run.id and status.run != self.run.id)

    def _checked(self, statuses: Sequence[RunStatus]) -> Iterator[RunStatus]:
        """Yield the valid statuses, and note errors in the others."""
        steps = np.array([one.step for one in statuses], dtype=np.int64)
        over = False
        for status, ordered in zip(statuses, in_order(steps).tolist(), strict=True):
            state = status.state
            ends = state == RunState.FINISHED
            if not ordered or (ends and status.transitions < self.run.scenario.steps):
                words = f"{state!r} after {status.transitions} transitions"
                self.foreign.append(_of_status(status, words, "another step or state"))
                continue
            if state not in list(RunState):
                words = repr(state[:40])
                self.problems.append(_of_status(status, words, " or ".join(RunState)))
            if over and not ends:
                words = f"{state!r} after the end"
                self.problems.append(_of_status(status, words, "nothing after it"))
            over = ends
            yield status

    # The dialogue.

    def _read_dialogue(self) -> None:
        """Assemble the dialogue; files before and after a roll-back separately."""
        events = [
            self._of_files(wire.SERVICE_EVENTS, k) for k in range(len(self.names))
        ]
        begins = [0, *(back.file for back in self.rollbacks), len(self._files)]
        for number, (begin, end) in enumerate(pairwise(begins)):
            back = self.rollbacks[number - 1] if number else None
            later = self.rollbacks[number:]
            if begin < end:
                of_files = [np.concatenate(files[begin:end]) for files in events]
                self._add_dialogue(of_files, back, later)
        self.requests.sort(key=lambda one: (one.step, one.asker))

    def _add_dialogue(
        self,
        events: list[np.ndarray],
        back: timeline.Rollback | None,
        later: Sequence[timeline.Rollback],
    ) -> None:
        """Assemble the dialogue between two roll-backs.

        Args:
            events: the events of each asked robot.
            back: the roll-back before, or None.
            later: the roll-backs after; events that they supersede are left out.
        """
        newest = max(
            series.step.max(initial=0) for series in (self.clock, *self.states)
        )
        end = min((one.first for one in later), default=np.inf)
        requests, problems, others = put_together(events, self.names, self._period)
        for request in requests:
            if request.step < end and not asked_before(request, back):
                self.requests.append(request)
        self.foreign += [one for one in others if (one.step or 0) < end]
        for one in problems:
            step = one.step or 0
            unasked = one.logged == NO_REQUEST
            if unasked and step > newest:
                self.foreign.append(one)
            elif step < end and not (unasked and may_be_asked_before(step, back)):
                self.problems.append(one)


def _of_status(status: RunStatus, *words: str) -> Difference:
    return Difference(status.step, None, wire.STATUS.name, *words)


def read_messages(path: Path) -> RunMessages:
    """Read a bag; arguments and errors as of `read_run`."""
    bag = open_bag(path)
    found = find_run(bag)
    read = RunMessages(bag, found)
    read.problems += check_bag_run(bag, found)
    for name in read.forms:
        if name not in bag.topics:
            words = f"topic {name}", MISSING, "a topic of this run"
            read.problems.append(read.difference(None, None, *words))
    read.add_tables()
    return read


def may_be_asked_before(step: int, back: timeline.Rollback | None) -> bool:
    """Return whether an answer of a time step may belong to a question from before a roll-back.

    The answer to a question that was pending then is of its own time step, or of the checkpoint if
    the asked robot has already gone back. Its request is not in the files after the roll-back.
    """
    if back is None:
        return False
    return step >= back.until - 1 or step <= back.first


def asked_before(request: Request, back: timeline.Rollback | None) -> bool:
    """Return whether a robot that had already gone back answered a question from before that.

    A peer that is asked after the roll-back is one time step behind at most.
    """
    if back is None or request.answer is None:
        return False
    answered_at, _ = request.answer
    return bool(answered_at <= back.first < request.step - 1)


def in_order(steps: np.ndarray, *, each_once: bool = False) -> np.ndarray:
    """Return a mask of the time steps in a longest non-decreasing sequence, bool.

    Args:
        steps: in the order of the log, shape (n,).
        each_once: if the steps decrease somewhere, a repeated step does not count in the length.
    """
    count = len(steps)
    if (np.diff(steps) >= 0).all():
        return np.ones(count, dtype=bool)
    descending = (-steps[::-1]).tolist()
    insert = bisect_left if each_once else bisect_right
    # From the end of the log: `lowest[n]` is the last negated step of the best sequence of n + 1
    # steps, `ends[n]` its place, `before` the place that each step follows in its sequence.
    lowest: list[int] = []
    ends: list[int] = []
    before = [-1] * count
    for place, step in enumerate(descending):
        length = insert(lowest, step)
        before[place] = ends[length - 1] if length else -1
        lowest[length : length + 1] = [step]
        ends[length : length + 1] = [place]
    chosen = np.zeros(count, dtype=bool)
    place = ends[-1]
    while place >= 0:
        chosen[place] = True
        place = before[place]
    return chosen[::-1]
