# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages sorted by topic and time step, with whatever is odd about them."""

from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.bags.reader import Bag, open_bag
from sparse_coord_ros.bags.topics import find_clock
from sparse_coord_ros.game.world import EPISODE_GAP
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.runlog.attached import RecordedTables, read_tables
from sparse_coord_ros.runlog.bag_run import BagRun, check_bag_run, find_run
from sparse_coord_ros.runlog.columns import COMPLETE, READABLE, Columns, Reading, no_rows
from sparse_coord_ros.runlog.decode import Decoder
from sparse_coord_ros.runlog.dialogue import NO_REQUEST, Request, put_together
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.timeline import (
    Gap,
    Rollback,
    gaps,
    holds,
    kept,
    lost,
    rollbacks,
    steps_of,
)
from sparse_coord_ros.wire import RunState, messages
from sparse_coord_ros.wire.events import event_form
from sparse_coord_ros.wire.frame import Frame
from sparse_coord_ros.wire.occupancy import OccupancyData
from sparse_coord_ros.wire.status import Said, read_status, values_of

THE_CLOCK = wire.CLOCK.name
NOTHING = np.empty(0, dtype=np.int64)
OF_STEPS = (wire.LOCAL_STATE, wire.REWARD, wire.ACTION, wire.PERCEPT, wire.SERVICE_EVENTS)
"""Topics of each robot that may say something at every time step."""


class Track(NamedTuple):
    """The messages of one topic that has one message a time step.

    Attributes:
        step: their time steps, ascending, shape (n,).
        rows: what they say, shape (n,).
        repeats: time steps of those that said the same once more, one entry each.
        others: rows of those that said something else, by time step.
    """

    step: np.ndarray
    rows: np.ndarray
    repeats: np.ndarray
    others: Mapping[int, list[Any]] = MappingProxyType({})

    def without(self, steps: np.ndarray) -> "Track":
        """Return it without the messages of some time steps."""
        rest = ~np.isin(self.step, steps)
        repeats = self.repeats[~np.isin(self.repeats, steps)]
        return self._replace(step=self.step[rest], rows=self.rows[rest], repeats=repeats)


@dataclass
class Tracks:
    """What `read_tracks` reads.

    Attributes:
        bag: the bag.
        run: the run.
        prefix: what the names of its topics begin with.
        clock_topic: the full name of the clock's.
        states, rewards, actions, percepts: of each robot. Rows of states have `xy`; of rewards and
            actions `numbers`, in the order of their labels; of percepts `count` positions
            `places`, the own one first.
        clock: the steps of the clock.
        maps: time steps, in the order of the log.
        markers: the same, with the robots' positions `places`.
        coordination_maps: of each robot, with the grid's `data`.
        statuses: of the world, in the order of the log.
        requests: the dialogue.
        rosout: what nodes logged, decoded, where it was asked for.
        tables: of each attachment.
        rollbacks: where the run went back to a checkpoint; what they superseded is left out.
        gaps: what is not in the log, but for its end; in no order.
        problems: what is odd.
        suspects: messages beside those of the run, each of which may be a stranger's.
    """

    bag: Bag
    run: RunConfig
    prefix: str
    clock_topic: str = f"/{wire.CLOCK.name}"
    states: list[Track] = field(default_factory=list)
    rewards: list[Track] = field(default_factory=list)
    actions: list[Track] = field(default_factory=list)
    percepts: list[Track] = field(default_factory=list)
    clock: Track = Track(NOTHING, NOTHING, NOTHING)
    maps: np.ndarray = field(default_factory=lambda: NOTHING)
    markers: tuple[np.ndarray, np.ndarray] = (NOTHING, NOTHING)
    coordination_maps: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)
    statuses: list[Said] = field(default_factory=list)
    requests: list[Request] = field(default_factory=list)
    rosout: list[Any] = field(default_factory=list)
    tables: list[RecordedTables] = field(default_factory=list)
    rollbacks: list[Rollback] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    problems: list[Difference] = field(default_factory=list)
    suspects: list[Difference] = field(default_factory=list)

    @property
    def names(self) -> tuple[str, ...]:
        """The robots."""
        return tuple(robot.name for robot in self.run.scenario.robots)

    @property
    def lossy(self) -> bool:
        """Whether a part of the bag may be lost."""
        return self.broken_off or bool(self.bag.gaps or self.gaps)

    @property
    def broken_off(self) -> bool:
        """Whether the end of the run is not in the bag."""
        bag, steps = self.bag, [track.step[-1] for track in self.states if len(track.step)]
        newest = int(max(steps, default=0)) * Frame(self.run).period
        cut = any(gap.last_ns is None or gap.last_ns > newest for gap in bag.gaps)
        return cut or not bag.finished or bag.recovered is not None

    def of(self, k: int) -> tuple[Track, Track, Track, Track]:
        """Return one robot's tracks: states, rewards, actions, percepts."""
        return self.states[k], self.rewards[k], self.actions[k], self.percepts[k]

    def problem(
        self, step: int | None, robot: int | None, quantity: str, logged: str, computed: str
    ) -> None:
        """Note something odd."""
        self.problems.append(self._odd(step, robot, quantity, logged, computed))

    def suspect(self, step: int | None, robot: int | None, *words: str) -> None:
        """Note a message that may be a stranger's; arguments as of `problem`."""
        self.suspects.append(self._odd(step, robot, *words))

    def _odd(self, step: int | None, robot: int | None, *words: str) -> Difference:
        return Difference(step, None if robot is None else self.names[robot], *words)

    def topic(self, topic: wire.Topic, robot: int | None = None) -> str:
        """Return a topic's full name."""
        if topic is wire.CLOCK:
            return self.clock_topic
        if topic.name.startswith("/"):
            return topic.name
        return self.prefix + (topic.name if robot is None else topic.of(self.names[robot]))


def read_tracks(path: Path) -> Tracks:
    """Read a bag; arguments and errors as of `read_run`."""
    bag = open_bag(path)
    found = find_run(bag, Decoder(bag.topics))
    tracks = tracks_of(bag, found)
    odd = list(check_bag_run(bag, found))
    due = [tracks.topic(*of) for of in _forms(tracks)]
    missing = [f"topic {name}" for name in due if name not in bag.topics]
    odd += [Difference(None, None, name, MISSING, "a topic of this run") for name in missing]
    tracks.problems += odd
    add_tables(tracks)
    return tracks


def add_tables(tracks: Tracks) -> None:
    """Read the attached tables of a bag whose messages are read."""
    tracks.tables, odd = read_tables(tracks.bag, tracks.run, tracks.rollbacks)
    tracks.problems += odd


OF_NO_RUN = Said("none", "", 0, 0)
"""In place of a status that names no run: every world's does."""


def _said(message: Any) -> Said:
    """Return what a status says; ValueError where it names a run and lacks another value."""
    return read_status(message) if "run" in values_of(message) else OF_NO_RUN


def _forms(tracks: Tracks) -> dict[tuple[wire.Topic, int | None], Reading]:
    """Return how the messages of the run's topics are read, of the team and of each robot."""
    run, frame = tracks.run, Frame(tracks.run)
    of_team: dict[wire.Topic, Reading] = {
        wire.CLOCK: messages.CLOCK_FORM,
        wire.MAP: messages.grid_form(frame, OccupancyData(frame).map),
        wire.MARKERS: messages.markers_form(frame, run.scenario),
        wire.STATUS: _said,
    }
    of_robot: dict[wire.Topic, Reading] = {
        wire.LOCAL_STATE: messages.POSE_FORM,
        wire.REWARD: messages.REFEREED_FORM if run.scenario.referee else messages.REWARD_FORM,
        wire.ACTION: messages.ACTION_FORM,
        wire.PERCEPT: messages.percept_form(len(tracks.names)),
        wire.COORDINATION_MAP: messages.grid_form(frame),
        wire.SERVICE_EVENTS: event_form(tracks.names),
    }
    found: dict[tuple[wire.Topic, int | None], Reading]
    found = {(topic, None): form for topic, form in of_team.items()}
    robots = range(len(tracks.names))
    return found | {(topic, k): form for k in robots for topic, form in of_robot.items()}


def tracks_of(bag: Bag, found: BagRun, only: Collection[wire.Topic] | None = None) -> Tracks:
    """Return a bag's messages without its attachments.

    Args:
        bag: the bag, or a part of one.
        found: its run.
        only: the topics to read, the others seem to have no messages; None: all but `ROSOUT`.
    """
    clock = find_clock(bag.topics, bag.counts) or f"/{wire.CLOCK.name}"
    tracks = Tracks(bag, found.run, found.prefix, clock)
    _Sorter(tracks, only).sort()
    return tracks


def _under_way(step: int, back: Rollback | None) -> bool:
    """Whether an answer of a time step may be to a question of before a roll-back."""
    return back is not None and (step >= back.until - 1 or step <= back.first)


class _Sorter:
    """Reads a bag, puts its rows in the order of time steps, and notes which are out of it."""

    def __init__(self, tracks: Tracks, only: Collection[wire.Topic] | None) -> None:
        bag, forms = tracks.bag, _forms(tracks)
        self._tracks = tracks
        self._period = Frame(tracks.run).period
        self._backs = rollbacks(bag)
        begins: list[int | None] = [None] * len(bag.files)
        for back in self._backs:
            begins[back.file] = (back.first - 1) * self._period
        read = {
            tracks.topic(*of): form for of, form in forms.items() if only is None or of[0] in only
        }
        if wire.ROSOUT in (only or ()):
            read[wire.ROSOUT.name] = lambda message: message
        stamped = [tracks.topic(*of) for of in forms if of[0].stamped]
        columns = Columns(bag, read, stamped, self._period, begins)
        tracks.problems += columns.problems
        self._jumps = columns.jumps
        robots = range(len(tracks.names))
        self._often = {tracks.topic(one, k) for one in OF_STEPS for k in robots}
        self._often.add(tracks.clock_topic)
        nothing = {tracks.topic(*of): no_rows(form) for of, form in forms.items()}
        self._files = [nothing | rows for rows in columns.rows]

    def sort(self) -> None:
        """Fill in the tracks."""
        tracks, robots = self._tracks, range(len(self._tracks.names))
        self._find_gaps()
        tracks.clock = self._track(wire.CLOCK)
        tracks.maps = self._several(wire.MAP)[0]
        tracks.markers = self._several(wire.MARKERS)
        tracks.states = [self._track(wire.LOCAL_STATE, k) for k in robots]
        tracks.rewards = [self._track(wire.REWARD, k) for k in robots]
        tracks.actions = [self._track(wire.ACTION, k) for k in robots]
        tracks.percepts = [self._track(wire.PERCEPT, k) for k in robots]
        self._strays()
        for step in tracks.clock.repeats.tolist():
            tracks.problem(step, None, THE_CLOCK, "twice", "once")
        tracks.coordination_maps = [
            self._several(wire.COORDINATION_MAP, k, checkpoints=True) for k in robots
        ]
        self._statuses()
        self._dialogue()
        self._sort_out()
        logged = [rows[wire.ROSOUT.name] for rows in self._files if wire.ROSOUT.name in rows]
        tracks.rosout = [message for rows in logged for message in rows.tolist()]

    def _sort_out(self) -> None:
        """No node says what cannot be read; a message of every step would be missed."""
        tracks, often = self._tracks, {f"topic {name}" for name in self._often}
        problems, tracks.problems = tracks.problems, []
        for one in problems:
            foreign = (READABLE, COMPLETE) if one.quantity in often else (READABLE,)
            (tracks.suspects if one.computed in foreign else tracks.problems).append(one)

    def _of(self, topic: wire.Topic, k: int | None = None) -> list[np.ndarray]:
        """Return the rows of a topic, of each file."""
        return [rows[self._tracks.topic(topic, k)] for rows in self._files]

    def _find_gaps(self) -> None:
        tracks = self._tracks
        clocks = [steps_of(rows, self._period) for rows in self._of(wire.CLOCK)]
        said = [one.step for rows in self._of(wire.STATUS) for one in rows if one is not OF_NO_RUN]
        found, tracks.rollbacks = gaps(tracks.bag, clocks, self._backs, (said or [0])[-1])
        jumps = [jump for jump in self._jumps if jump.topic in self._often]
        if tracks.lossy:
            found = lost(jumps, self._period, found)
        else:
            tracks.problems += [jump.odd for jump in self._jumps]
        tracks.gaps = found

    def _dialogue(self) -> None:
        """Put the dialogue together, of each time line by itself: who comes back counts anew."""
        tracks = self._tracks
        of_robots = [self._of(wire.SERVICE_EVENTS, k) for k in range(len(tracks.names))]
        backs = tracks.rollbacks
        cuts = [0, *(back.file for back in backs), len(self._files)]
        for place, (begin, end) in enumerate(pairwise(cuts)):
            if begin < end:
                events = [np.concatenate(files[begin:end]) for files in of_robots]
                limit = min([back.first for back in backs[place:]], default=np.inf)
                self._time_line(events, limit, backs[place - 1] if place else None)
        tracks.requests.sort(key=lambda one: (one.step, one.asker))

    def _time_line(self, events: list[np.ndarray], limit: float, back: Rollback | None) -> None:
        """Put the dialogue of a time line together, up to where the run went back to."""
        tracks = self._tracks
        newest = max(track.step.max(initial=0) for track in (tracks.clock, *tracks.states))
        requests, problems, others = put_together(events, tracks.names, self._period)
        tracks.requests += [request for request in requests if request.step < limit]
        tracks.suspects += [one for one in others if (one.step or 0) < limit]
        # Questions that were under way when the run went back are answered from then, or from
        # the checkpoint by who has gone back already, without a request here.
        for one in problems:
            step, unasked = one.step or 0, one.logged == NO_REQUEST
            if unasked and step > newest:
                tracks.suspects.append(one)
            elif step < limit and not (unasked and _under_way(step, back)):
                tracks.problems.append(one)

    def _rows(
        self, topic: wire.Topic, k: int | None, *, checkpoints: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of a topic that hold, with their time steps."""
        rows = kept(self._of(topic, k), self._backs, self._period, checkpoints=checkpoints)
        steps = steps_of(rows, self._period)
        due = steps * self._period
        right = (rows["ns"] == due) & (rows["ns"] >= 0)
        for place in np.flatnonzero(~right).tolist():
            ns, step = int(rows["ns"][place]), int(steps[place])
            of = (step, f"{due[place]} ns") if ns >= 0 else (None, "0 or later")
            self._tracks.suspect(of[0], k, f"{topic.name.lstrip('/')} stamp", f"{ns} ns", of[1])
        return rows[right], steps[right]

    def _track(self, topic: wire.Topic, k: int | None = None) -> Track:
        """Return rows of which there should be one a time step."""
        rows, steps = self._rows(topic, k, checkpoints=False)
        ordered = in_order(steps, each_once=True)
        newest = np.maximum.accumulate(np.concatenate([[-1], np.where(ordered, steps, -1)]))[:-1]
        found, first = np.unique(steps, return_index=True)
        known, places = np.unique(steps[ordered], return_index=True)
        first[np.searchsorted(found, known)] = np.flatnonzero(ordered)[places]
        due = np.zeros(len(steps), dtype=bool)
        due[first] = True
        repeats: list[int] = []
        others: dict[int, list[Any]] = {}
        for place in np.flatnonzero(~(ordered & due)).tolist():
            step, last = int(steps[place]), int(newest[place])
            known_at = int(first[np.searchsorted(found, step)])
            name = topic.name.lstrip("/")
            if known_at == place:
                odd = f"after that of step {last}", "before it"
                self._tracks.problem(step, k, name, *odd)
            elif rows[place].tobytes() != rows[known_at].tobytes():
                two = (rows[known_at].tolist()[1:], rows[place].tolist()[1:])
                others.setdefault(step, []).append(rows[place])
                self._tracks.suspect(step, k, name, f"twice, with {two[0]} and {two[1]}", "once")
            elif step < last:
                self._tracks.suspect(step, k, name, f"again after that of step {last}", "once")
            else:
                repeats.append(step)
        return Track(found, rows[first], np.array(repeats, dtype=np.int64), others)

    def _strays(self) -> None:
        """Leave out messages of a time step of which nobody else says anything, or that is none.

        Steps begin with 1, and go on. In the last ones of a log, and where a part is lost, it is
        no wonder that something is missing.
        """
        tracks = self._tracks
        heard = [tracks.clock, *tracks.states]
        steps, votes = np.unique(np.concatenate([t.step for t in heard]), return_counts=True)
        newest = steps[votes == len(heard)].max(initial=0)
        lone = steps[
            ((votes == 1) & (steps < newest)) | (steps > newest + EPISODE_GAP) | (steps == 0)
        ]
        if tracks.lossy or not all(len(track.step) for track in heard) or not len(lone):
            return
        for k, track in enumerate(heard, start=-1):
            for step in track.step[np.isin(track.step, lone)].tolist():
                topic = wire.CLOCK if k < 0 else wire.LOCAL_STATE
                name, none = topic.name.lstrip("/"), "none: no time step of the run"
                tracks.suspect(step, None if k < 0 else k, name, "there", none)
                tracks.problems = [o for o in tracks.problems if o[:3:2] != (step, name)]
        tracks.clock, *tracks.states = [track.without(lone) for track in heard]

    def _several(
        self, topic: wire.Topic, k: int | None = None, *, checkpoints: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return time steps and rows, of which there may be several a time step."""
        rows, steps = self._rows(topic, k, checkpoints=checkpoints)
        for place in np.flatnonzero(np.diff(steps) < 0).tolist():
            logged = f"after that of step {steps[place]}"
            self._tracks.problem(int(steps[place + 1]), k, topic.name, logged, "before it")
        return steps, rows

    def _own_statuses(self) -> Iterator[Said]:
        """Yield the statuses of the run that hold; note those of others."""
        run = self._tracks.run
        for place, rows in enumerate(self._of(wire.STATUS)):
            for said in rows:
                if said is OF_NO_RUN or (said.run and run.id and said.run != run.id):
                    words = f"of run {said.run!r}", run.id or "this one"
                    self._tracks.suspect(said.step, None, wire.STATUS.name, *words)
                # A world that is yet to go back does not know where the team is.
                elif holds(place, said.step, self._backs) and said.state != RunState.RESUMING:
                    yield said

    def _statuses(self) -> None:
        """Note the world's statuses, and what is odd about them."""
        tracks, found = self._tracks, list(self._own_statuses())
        ordered = in_order(np.array([one.step for one in found], dtype=np.int64)).tolist()
        for one, right in zip(found, ordered, strict=True):
            early = one.transitions < tracks.run.scenario.steps
            if right and not (early and one.state == RunState.FINISHED):
                tracks.statuses.append(one)
            else:
                said = f"{one.state!r} after {one.transitions} transitions"
                tracks.suspect(one.step, None, wire.STATUS.name, said, "another step or state")
        over = False
        for one in tracks.statuses:
            if one.state not in list(RunState):
                states = " or ".join(RunState)
                tracks.problem(one.step, None, wire.STATUS.name, repr(one.state[:40]), states)
            if over and one.state != RunState.FINISHED:
                said = f"{one.state!r} after the end"
                tracks.problem(one.step, None, wire.STATUS.name, said, "nothing after it")
            over = one.state == RunState.FINISHED


def in_order(steps: np.ndarray, *, each_once: bool = False) -> np.ndarray:
    """Return which of some time steps make up a longest sequence that never falls, bool.

    Args:
        steps: in the order of the log, shape (n,).
        each_once: where any falls, a step that comes again does not make the sequence longer.
    """
    if (np.diff(steps) >= 0).all():
        return np.ones(len(steps), dtype=bool)
    before = np.full(len(steps), -1, dtype=np.int64)
    ends: list[int] = []
    places: list[int] = []
    bisect = bisect_left if each_once else bisect_right
    for place in range(len(steps) - 1, -1, -1):
        at = bisect(ends, -int(steps[place]))
        before[place] = places[at - 1] if at else -1
        ends[at : at + 1] = [-int(steps[place])]
        places[at : at + 1] = [place]
    right = np.zeros(len(steps), dtype=bool)
    place = places[-1]
    while place >= 0:
        right[place] = True
        place = int(before[place])
    return right
