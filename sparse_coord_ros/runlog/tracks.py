# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages sorted by topic and time step, with whatever is odd about them."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.bags.reader import Bag, open_bag
from sparse_coord_ros.bags.topics import find_clock
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.runlog.attached import RecordedTables, read_tables
from sparse_coord_ros.runlog.bag_run import BagRun, check_bag_run, find_run
from sparse_coord_ros.runlog.columns import Columns
from sparse_coord_ros.runlog.decode import Decoder
from sparse_coord_ros.runlog.dialogue import NO_REQUEST, Request, put_together
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.readers import KEEPER, robot_forms, team_forms
from sparse_coord_ros.runlog.timeline import (
    Gap,
    Rollback,
    gaps,
    kept,
    of_last,
    rollbacks,
    steps_of,
)
from sparse_coord_ros.wire.frame import SECOND, Frame
from sparse_coord_ros.wire.messages import Form
from sparse_coord_ros.wire.status import Said

THE_CLOCK = wire.CLOCK.name.lstrip("/")
SPOKEN = (wire.DIAGNOSTICS, wire.ROSOUT)
"""Topics of which `Tracks.spoken` keeps the messages, where they are asked for."""

NOTHING = np.empty(0, dtype=np.int64)


class Track(NamedTuple):
    """The messages of one topic that has one message a time step.

    Attributes:
        step: their time steps, ascending, shape (n,).
        rows: what they say, shape (n,).
        repeats: time steps of those that said the same once more, one entry each.
    """

    step: np.ndarray
    rows: np.ndarray
    repeats: np.ndarray

    def has(self, steps: np.ndarray) -> np.ndarray:
        """Return whether there is a message of each of some steps, a bool each."""
        return np.asarray(np.isin(steps, self.step))


@dataclass
class Tracks:
    """What `read_tracks` reads.

    Attributes:
        bag: the bag.
        run: the run.
        prefix: what the names of its topics begin with.
        clock_topic: the full name of the clock's.
        states, rewards, actions, percepts: of each robot; rows as of `robot_forms`.
        clock: the steps of the clock.
        maps: time steps, in the order of the log.
        markers: the same, with the robots' positions `places`.
        coordination_maps: of each robot, with the grid's `data`.
        statuses: of the world, in the order of the log.
        requests: the dialogue.
        spoken: decoded messages of some of `SPOKEN`, by topic, where they were asked for.
        tables: of each attachment.
        rollbacks: where the run went back to a checkpoint; what they superseded is left out.
        gaps: what was not recorded between two files.
        problems: what is odd.
    """

    bag: Bag
    run: RunConfig
    prefix: str
    clock_topic: str = wire.CLOCK.name
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
    spoken: dict[wire.Topic, list[Any]] = field(default_factory=dict)
    tables: list[RecordedTables] = field(default_factory=list)
    rollbacks: list[Rollback] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    problems: list[Difference] = field(default_factory=list)

    @property
    def names(self) -> tuple[str, ...]:
        """The robots."""
        return tuple(robot.name for robot in self.run.scenario.robots)

    @property
    def broken_off(self) -> bool:
        """Whether the recording ended before the run, or a part of it is lost."""
        bag = self.bag
        return not (bag.finished and bag.whole) or bag.recovered is not None or bool(self.gaps)

    def of(self, k: int) -> tuple[Track, Track, Track, Track]:
        """Return one robot's tracks: states, rewards, actions, percepts."""
        return self.states[k], self.rewards[k], self.actions[k], self.percepts[k]

    def problem(
        self, step: int | None, robot: int | None, quantity: str, logged: str, computed: str
    ) -> None:
        """Note something odd."""
        name = None if robot is None else self.names[robot]
        self.problems.append(Difference(step, name, quantity, logged, computed))

    def topic(self, topic: wire.Topic, robot: int | None = None) -> str:
        """Return a topic's full name."""
        if topic is wire.CLOCK:
            return self.clock_topic
        if topic.name.startswith("/"):
            return topic.name
        return self.prefix + (topic.name if robot is None else topic.of(self.names[robot]))


def read_tracks(path: Path, also: Collection[wire.Topic] = ()) -> Tracks:
    """Read a bag; arguments and errors as of `read_run`, `also`: of `SPOKEN`."""
    bag = open_bag(path)
    found = find_run(bag, Decoder(bag.topics))
    tracks = tracks_of(bag, found, also=also)
    odd = list(check_bag_run(bag, found))
    for name in _channels(tracks, Frame(tracks.run)):
        if name not in bag.topics:
            due = "a topic of this run"
            odd.append(Difference(None, None, f"topic {name}", MISSING, due))
    if tracks.broken_off and not all(len(track.step) for track in tracks.states):
        odd = [one for one in odd if one.logged != MISSING]  # it broke off before the run began
    tracks.problems += odd
    add_tables(tracks)
    return tracks


def add_tables(tracks: Tracks) -> None:
    """Read the attached tables of a bag whose messages are read."""
    tracks.tables, odd = read_tables(tracks.bag, tracks.run, tracks.rollbacks)
    tracks.problems += odd


class _Channel(NamedTuple):
    """A topic of the run: what it says, and how its messages become rows."""

    topic: wire.Topic
    form: Form


def _channels(tracks: Tracks, frame: Frame) -> dict[str, _Channel]:
    """Return the topics that the bag of a run has, by their full names."""
    of_team, of_robots = team_forms(tracks.run, frame), robot_forms(tracks.run, frame)
    found = {tracks.topic(topic): _Channel(topic, form) for topic, form in of_team.items()}
    for k in range(len(tracks.names)):
        found |= {tracks.topic(topic, k): _Channel(topic, r) for topic, r in of_robots.items()}
    return found


def tracks_of(
    bag: Bag,
    found: BagRun,
    only: Collection[wire.Topic] | None = None,
    also: Collection[wire.Topic] = (),
) -> Tracks:
    """Return a bag's messages without its attachments.

    Args:
        bag: the bag, or a part of one.
        found: its run.
        only: the topics to read, the others seem to have no messages; None: all.
        also: of `SPOKEN`, to be read too.
    """
    clock = find_clock(bag.topics, bag.counts) or wire.CLOCK.name
    tracks = Tracks(bag, found.run, found.prefix, clock)
    frame = Frame(found.run)
    backs = rollbacks(bag)
    files = _read_rows(tracks, frame, backs, only, also)
    clocks = [steps_of(rows[clock], frame.period) for rows in files]
    statuses = _objects(files, tracks.topic(wire.STATUS))
    said = next((of[-1].step for of in reversed(statuses) if of), 0)
    tracks.gaps, tracks.rollbacks = gaps(bag, clocks, backs, said)
    for gap in tracks.gaps:
        logged = f"nothing of the time steps {gap.first} to {gap.last}: no recorder was there"
        tracks.problem(None, None, "recording", logged, "every time step")
    sort = _Sorter(tracks, files, backs, frame.period)
    sort.team()
    for k in range(len(tracks.names)):
        sort.robot(k)
    sort.statuses(statuses)
    _read_dialogue(tracks, files, frame)
    for topic in also:
        tracks.spoken[topic] = list(chain(*_objects(files, tracks.topic(topic))))
    return tracks


def _read_rows(
    tracks: Tracks,
    frame: Frame,
    backs: Sequence[Rollback],
    only: Collection[wire.Topic] | None,
    also: Collection[wire.Topic],
) -> list[dict[str, np.ndarray]]:
    """Return the rows of each file's topics, by full name; arguments as of `tracks_of`."""
    bag, channels = tracks.bag, _channels(tracks, frame)
    forms = {
        name: channel.form
        for name, channel in channels.items()
        if only is None or channel.topic in only
    }
    forms |= {tracks.topic(topic): KEEPER for topic in also}
    stamped = [name for name, channel in channels.items() if channel.topic.stamped]
    begins: list[int | None] = [None] * len(bag.files)
    for back in backs:
        begins[back.file] = (back.first - 1) * frame.period
    columns = Columns(bag, forms, stamped, frame.period, begins)
    tracks.problems += columns.problems
    nothing = {name: np.empty(0, channel.form.columns) for name, channel in channels.items()}
    return [nothing | rows for rows in columns.rows]


def _objects(files: Sequence[dict[str, np.ndarray]], topic: str) -> list[list[Any]]:
    """Return what the rows of a topic hold that have one field, of each file."""
    return [[one for (one,) in rows[topic].tolist()] for rows in files]


def _under_way(step: int, back: Rollback | None) -> bool:
    """Whether an answer of a time step may be to a question of before a roll-back."""
    return back is not None and (step >= back.until - 1 or step <= back.first)


def _read_dialogue(tracks: Tracks, files: Sequence[dict[str, np.ndarray]], frame: Frame) -> None:
    """Put the dialogue together, of each time line by itself: who comes back counts anew."""
    names = [tracks.topic(wire.SERVICE_EVENTS, k) for k in range(len(tracks.names))]
    firsts = [back.first for back in tracks.rollbacks]
    cuts = [0, *(back.file for back in tracks.rollbacks), len(files)]
    for place, (begin, end) in enumerate(pairwise(cuts)):
        if begin == end:
            continue
        events = [np.concatenate([rows[name] for rows in files[begin:end]]) for name in names]
        requests, problems = put_together(events, tracks.names, frame)
        limit = min(firsts[place:], default=np.inf)
        back = tracks.rollbacks[place - 1] if place else None
        tracks.requests += [request for request in requests if request.step < limit]
        for one in problems:
            if one.step is not None:
                if one.step >= limit:
                    continue
                # Questions that were under way when the run went back are answered from then, or
                # from the checkpoint by who has gone back already, without a request here.
                if one.logged == NO_REQUEST and _under_way(one.step, back):
                    continue
            tracks.problems.append(one)
    tracks.requests.sort(key=lambda one: (one.step, one.asker))


class _Sorter:
    """Puts rows in the order of time steps, and notes which are out of it."""

    def __init__(
        self,
        tracks: Tracks,
        files: Sequence[dict[str, np.ndarray]],
        backs: Sequence[Rollback],
        period: int,
    ) -> None:
        self._tracks, self._files, self._backs, self._period = tracks, files, backs, period

    def team(self) -> None:
        """Sort clock, maps and markers."""
        tracks = self._tracks
        tracks.clock = self._track(wire.CLOCK)
        for step in tracks.clock.repeats.tolist():
            tracks.problem(step, None, THE_CLOCK, "twice", "once")
        tracks.maps = self._several(wire.MAP)[0]
        tracks.markers = self._several(wire.MARKERS)

    def robot(self, k: int) -> None:
        """Sort what one robot says or is told."""
        tracks = self._tracks
        tracks.states.append(self._track(wire.LOCAL_STATE, k))
        tracks.rewards.append(self._track(wire.REWARD, k))
        tracks.actions.append(self._track(wire.ACTION, k))
        tracks.percepts.append(self._track(wire.PERCEPT, k))
        tracks.coordination_maps.append(self._several(wire.COORDINATION_MAP, k, checkpoints=True))

    def _rows(
        self, topic: wire.Topic, k: int | None, *, checkpoints: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return rows and their time steps; a message is stamped with one, from 0."""
        name, period = topic.name.lstrip("/"), self._period
        files = [rows[self._tracks.topic(topic, k)] for rows in self._files]
        rows = kept(files, self._backs, period, checkpoints=checkpoints)
        before = rows["ns"] < 0
        for ns in rows["ns"][before].tolist():
            self._tracks.problem(None, k, f"{name} stamp", f"{ns} ns", "0 or later")
        rows = rows[~before]
        steps = steps_of(rows, period)
        for place in np.flatnonzero(rows["ns"] != steps * period).tolist():
            step, ns = int(steps[place]), int(rows["ns"][place])
            said, due = (f"{n // SECOND}.{n % SECOND:09d} s" for n in (ns, step * period))
            self._tracks.problem(step, k, f"{name} stamp", said, due)
        return rows, steps

    def _track(self, topic: wire.Topic, k: int | None = None) -> Track:
        """Return rows of which there should be one a time step."""
        name, note = topic.name.lstrip("/"), self._tracks.problem
        rows, steps = self._rows(topic, k, checkpoints=False)
        newest = np.maximum.accumulate(np.concatenate([[-1], steps]))[:-1]
        first = steps > newest
        odd = np.flatnonzero(~first)
        if not len(odd):
            return Track(steps, rows, NOTHING)
        known = {int(steps[place]): place for place in np.flatnonzero(first).tolist()}
        repeats = []
        for place in odd.tolist():
            step, last = int(steps[place]), int(newest[place])
            if step not in known:
                known[step] = place
                first[place] = True
                note(step, k, name, f"after that of step {last}", "before it")
            elif rows[place].tobytes() != rows[known[step]].tobytes():
                two = (rows[known[step]].tolist()[1:], rows[place].tolist()[1:])
                note(step, k, name, f"twice, with {two[0]} and {two[1]}", "once")
            elif step < last:
                note(step, k, name, f"again after that of step {last}", "once")
            else:
                repeats.append(step)
        order = np.flatnonzero(first)
        order = order[np.argsort(steps[order], kind="stable")]
        return Track(steps[order], rows[order], np.array(repeats, dtype=np.int64))

    def _several(
        self, topic: wire.Topic, k: int | None = None, *, checkpoints: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return time steps and rows, of which there may be several a time step."""
        rows, steps = self._rows(topic, k, checkpoints=checkpoints)
        for place in np.flatnonzero(np.diff(steps) < 0).tolist():
            logged = f"after that of step {steps[place]}"
            self._tracks.problem(int(steps[place + 1]), k, topic.name, logged, "before it")
        return steps, rows

    def statuses(self, of_files: Sequence[Sequence[Said]]) -> None:
        """Note the world's statuses, of each file, and what is odd about them."""
        places = [place for place, of in enumerate(of_files) for _ in of]
        said = list(chain(*of_files))
        valid = of_last(places, [one.step for one in said], self._backs)
        # A world that is yet to go back does not know where the team is.
        found = [
            one
            for one, ok in zip(said, valid, strict=True)
            if ok and one.state != wire.RunState.RESUMING
        ]
        for before, status in zip([None, *found], found, strict=False):
            odd: list[tuple[str, str]] = []
            if before is not None and status.step < before.step:
                odd.append((f"after that of step {before.step}", "before it"))
            if status.state not in list(wire.RunState):
                odd.append((repr(status.state[:40]), " or ".join(wire.RunState)))
            if before is not None and before.state == wire.RunState.FINISHED != status.state:
                odd.append((f"{status.state!r} after {before.state!r}", "nothing after it"))
            for logged, due in odd:
                self._tracks.problem(status.step, None, wire.STATUS.name, logged, due)
        self._tracks.statuses = found
