# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages sorted by topic and time step, with whatever is odd about them."""

from collections.abc import Callable, Collection, Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.bags.reader import Bag, open_bag
from sparse_coord_ros.bags.topics import find_clock
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.runlog import layouts
from sparse_coord_ros.runlog.attached import RecordedTables, read_tables
from sparse_coord_ros.runlog.bag_run import BagRun, check_bag_run, find_run
from sparse_coord_ros.runlog.columns import Columns, Reader
from sparse_coord_ros.runlog.decode import Decoder, check_frame, nanoseconds_of, place_of
from sparse_coord_ros.runlog.dialogue import EVENT, Request, event_row, put_together
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.layouts import Layout, nanoseconds
from sparse_coord_ros.runlog.pictures import MarkersContent, occupancy
from sparse_coord_ros.runlog.timeline import (
    Gap,
    Rollback,
    gaps,
    kept,
    of_last,
    rollbacks,
    steps_of,
)
from sparse_coord_ros.wire import ACCOUNT_LABELS, ACTION_LABELS, PARTNERS_LABEL, REWARD_LABELS
from sparse_coord_ros.wire.frame import SECOND, Frame
from sparse_coord_ros.wire.occupancy import OccupancyData

NUMBERS = len(ACTION_LABELS) + len(ACCOUNT_LABELS)
STAMP = ("ns", "i8")
Fill = Callable[[np.ndarray, np.ndarray], np.ndarray | None]
"""Puts the fields of messages into rows; see `Reader`."""
THE_CLOCK = wire.CLOCK.name.lstrip("/")
KEEPER = Reader(np.dtype([("message", "O")]), lambda message: (message,), [])
"""Keeps messages as they are decoded."""


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
        """Return whether there is a message of each of some steps."""
        return np.asarray(np.isin(steps, self.step))


class Status(NamedTuple):
    """What the world said of itself; None: it did not, as in bags of format 1.

    Attributes:
        state: one of `wire.STATES`.
        step, transitions, left_out, began: as of `wire.STATUS_VALUES`.
        timeouts: how often it went on without a robot, in bags of format 1.
    """

    state: str
    step: int
    transitions: int
    left_out: int | None
    began: str | None
    timeouts: int | None


class Tracks:
    """What `read_tracks` reads.

    Attributes:
        bag: the bag.
        run: the run.
        format: number of the bag's format.
        prefix: what the names of its topics begin with.
        names: the robots.
        states, rewards, actions, percepts: of each robot. Rows of states: `xy`; of rewards and
            actions: `numbers`, in the order of their labels (NaN for what actions of format 1
            lack); of percepts: `count` positions `places`, the own one first.
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

    def __init__(self, bag: Bag, run: RunConfig, number: int, prefix: str) -> None:
        self.bag = bag
        self.run = run
        self.format = number
        self.prefix = prefix
        self.names = tuple(robot.name for robot in run.scenario.robots)
        self.states: list[Track] = []
        self.rewards: list[Track] = []
        self.actions: list[Track] = []
        self.percepts: list[Track] = []
        nothing = np.empty(0, dtype=np.int64)
        self.clock = Track(nothing, nothing, nothing)
        self.maps: np.ndarray = nothing
        self.markers: tuple[np.ndarray, np.ndarray] = (nothing, nothing)
        self.coordination_maps: list[tuple[np.ndarray, np.ndarray]] = []
        self.statuses: list[Status] = []
        self.requests: list[Request] = []
        self.spoken: dict[wire.Topic, list[Any]] = {}
        self.tables: list[RecordedTables] = []
        self.rollbacks: list[Rollback] = []
        self.gaps: list[Gap] = []
        self.problems: list[Difference] = []

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
        return self.prefix + (topic.name if robot is None else topic.of(self.names[robot]))


SPOKEN = (wire.DIAGNOSTICS, wire.ROSOUT)
"""Topics of which `Tracks.spoken` keeps the messages, where they are asked for."""


def read_tracks(path: Path, also: Collection[wire.Topic] = ()) -> Tracks:
    """Read a bag; arguments and errors as of `read_run`, `also`: of `SPOKEN`."""
    bag = open_bag(path)
    found = find_run(bag, Decoder(bag.topics))
    tracks, topics = tracks_of(bag, found, also=also)
    _check_bag_run(tracks, found, topics)
    add_tables(tracks)
    return tracks


def add_tables(tracks: Tracks) -> None:
    """Read the attached tables of a bag whose messages are read."""
    for odd, entry in read_tables(tracks.bag, tracks.run, tracks.rollbacks):
        tracks.problems += [] if odd is None else [odd]
        tracks.tables += [] if entry is None else [entry]


def tracks_of(
    bag: Bag,
    found: BagRun,
    only: Collection[wire.Topic] | None = None,
    also: Collection[wire.Topic] = (),
) -> tuple[Tracks, list[str]]:
    """Return a bag's messages without its attachments, and the topics on which they should be.

    Args:
        bag: the bag, or a part of one.
        found: its run.
        only: the topics to read, the others seem to have no messages; None: all.
        also: of `SPOKEN`, to be read too.
    """
    run = found.run
    tracks = Tracks(bag, run, max(found.number, found.of_text), found.prefix)
    frame = Frame(run)
    readers = _Readers(tracks, frame)
    clock = find_clock(bag.topics, bag.counts) or wire.CLOCK.name
    of_team = {wire.MAP: readers.map(), wire.MARKERS: readers.markers, wire.STATUS: readers.status}
    partners = (PARTNERS_LABEL,) if run.scenario.referee else ()
    of_robots = {
        wire.LOCAL_STATE: readers.state,
        wire.REWARD: readers.numbers((*REWARD_LABELS, *partners)),
        wire.ACTION: readers.numbers(ACTION_LABELS, ACCOUNT_LABELS),
        wire.PERCEPT: readers.percept,
        wire.COORDINATION_MAP: readers.grid,
        wire.SERVICE_EVENTS: readers.event,
    }
    by_name = {clock: readers.clock} | {tracks.topic(t): r for t, r in of_team.items()}
    stamped = [clock, *(tracks.topic(topic) for topic in of_team if topic.stamped)]
    for k in range(len(tracks.names)):
        by_name |= {tracks.topic(topic, k): reader for topic, reader in of_robots.items()}
        stamped += [tracks.topic(topic, k) for topic in of_robots if topic.stamped]
    wanted = set(by_name)
    if only is not None:
        wanted = {tracks.topic(topic) for topic in only if topic in of_team}
        for k in range(len(tracks.names)):
            wanted |= {tracks.topic(topic, k) for topic in only if topic in of_robots}
    readers_of = {name: reader for name, reader in by_name.items() if name in wanted}
    spoken = {topic: spoken_on(tracks, topic) for topic in also}
    readers_of |= dict.fromkeys(spoken.values(), KEEPER)
    backs = rollbacks(bag)
    begins: list[int | None] = [None] * len(bag.files)
    for back in backs:
        begins[back.file] = (back.first - 1) * frame.period
    columns = Columns(bag, readers_of, stamped, frame.period, begins)
    for found_rows in columns.rows:
        found_rows |= {n: np.empty(0, r.kind) for n, r in by_name.items() if n not in readers_of}
    tracks.problems += columns.problems
    clocks = [steps_of(rows[clock], frame.period) for rows in columns.rows]
    said = readers.statuses[-1].step if readers.statuses else 0
    tracks.gaps, tracks.rollbacks = gaps(bag, clocks, backs, said)
    for gap in tracks.gaps:
        logged = f"nothing of the time steps {gap.first} to {gap.last}: no recorder was there"
        tracks.problems.append(Difference(None, None, "recording", logged, "every time step"))

    def rows_of(name: str, *, checkpoints: bool = False) -> np.ndarray:
        files = [rows[name] for rows in columns.rows]
        return kept(files, backs, frame.period, checkpoints=checkpoints)

    for k in range(len(tracks.names)):
        accounts = rows_of(tracks.topic(wire.ACTION, k))["numbers"][:, len(ACTION_LABELS) :]
        if not np.isnan(accounts).all():  # only format 2 has them, whatever the record says
            tracks.format = max(tracks.format, 2)
    sort = _Sorter(tracks, frame)
    tracks.clock = sort.track(rows_of(clock), None, THE_CLOCK)
    tracks.problems += [
        Difference(step, None, THE_CLOCK, "twice", "once")
        for step in tracks.clock.repeats.tolist()
    ]
    tracks.maps = sort.several(rows_of(tracks.topic(wire.MAP)), None, wire.MAP.name)[0]
    rows = rows_of(tracks.topic(wire.MARKERS))
    tracks.markers = sort.several(rows, None, wire.MARKERS.name)
    kinds = (
        (wire.LOCAL_STATE, tracks.states),
        (wire.REWARD, tracks.rewards),
        (wire.ACTION, tracks.actions),
        (wire.PERCEPT, tracks.percepts),
    )
    for k in range(len(tracks.names)):
        for topic, of in kinds:
            of.append(sort.track(rows_of(tracks.topic(topic, k)), k, topic.name))
        topic = wire.COORDINATION_MAP
        rows = rows_of(tracks.topic(topic, k), checkpoints=True)
        tracks.coordination_maps.append(sort.several(rows, k, topic.name))
    status = tracks.topic(wire.STATUS)
    places = np.repeat(np.arange(len(columns.rows)), [len(rows[status]) for rows in columns.rows])
    steps = [one.step for one in readers.statuses]
    valid = of_last(places.tolist(), steps, backs)
    # A world that is yet to go back does not know where the team is.
    counts = [
        ok and one.state != wire.RESUMING for one, ok in zip(readers.statuses, valid, strict=True)
    ]
    sort.statuses([one for one, ok in zip(readers.statuses, counts, strict=True) if ok])
    _read_dialogue(tracks, columns, frame)
    for topic, name in spoken.items():
        tracks.spoken[topic] = [one for rows in columns.rows for (one,) in rows[name].tolist()]
    return tracks, list(by_name)


def spoken_on(tracks: Tracks, topic: wire.Topic) -> str:
    """Return a topic's full name; before it was absolute it lay in the team's namespace."""
    earlier = tracks.prefix + topic.name.removeprefix("/")
    return earlier if earlier in tracks.bag.topics else topic.name


def _under_way(step: int, back: Rollback | None) -> bool:
    """Whether an answer of a time step may be to a question of before a roll-back."""
    return back is not None and (step >= back.until - 1 or step <= back.first)


def _read_dialogue(tracks: Tracks, columns: Columns, frame: Frame) -> None:
    """Put the dialogue together, of each time line by itself: who comes back counts anew."""
    names = [tracks.topic(wire.SERVICE_EVENTS, k) for k in range(len(tracks.names))]
    firsts = [back.first for back in tracks.rollbacks]
    cuts = [0, *(back.file for back in tracks.rollbacks), len(columns.rows)]
    for place, (begin, end) in enumerate(pairwise(cuts)):
        files = columns.rows[begin:end]
        if not files:
            continue
        events = [np.concatenate([rows[name] for rows in files]) for name in names]
        requests, problems = put_together(events, list(tracks.names), frame)
        limit = min(firsts[place:], default=np.inf)
        back = tracks.rollbacks[place - 1] if place else None
        tracks.requests += [request for request in requests if request.step < limit]
        # Questions that were under way when the run went back are answered from then, or from the
        # checkpoint by who has gone back already, without a request here.
        tracks.problems += [
            one
            for one in problems
            if one.step is None
            or (one.step < limit and not ("without" in one.logged and _under_way(one.step, back)))
        ]
    tracks.requests.sort(key=lambda one: (one.step, one.asker))


def _check_bag_run(tracks: Tracks, source: BagRun, topics: Iterable[str]) -> None:
    """Note what is odd about the bag as a whole.

    Of one that broke off before the run began, not what is missing.
    """
    found = list(check_bag_run(tracks.bag, source, tracks.format))
    for topic in topics:
        if topic not in tracks.bag.topics:
            due = "a topic of this run"
            found.append(Difference(None, None, f"topic {topic}", MISSING, due))
    if tracks.broken_off and not all(len(track.step) for track in tracks.states):
        found = [one for one in found if one.logged != MISSING]
    tracks.problems += found


class _Sorter:
    """Puts rows in the order of time steps, and notes which are out of it."""

    def __init__(self, tracks: Tracks, frame: Frame) -> None:
        self._tracks, self._frame = tracks, frame

    def _steps(self, rows: np.ndarray, k: int | None, kind: str) -> tuple[np.ndarray, np.ndarray]:
        """Return rows and their time steps; a message is stamped with one, from 0."""
        period = self._frame.period
        before = rows["ns"] < 0
        for ns in rows["ns"][before].tolist():
            self._tracks.problem(None, k, f"{kind} stamp", f"{ns} ns", "0 or later")
        rows = rows[~before]
        steps = steps_of(rows, period)
        for place in np.flatnonzero(rows["ns"] != steps * period).tolist():
            step = int(steps[place])
            said, due = (
                f"{n // SECOND}.{n % SECOND:09d} s"
                for n in (int(rows["ns"][place]), step * period)
            )
            self._tracks.problem(step, k, f"{kind} stamp", said, due)
        return rows, steps

    def track(self, rows: np.ndarray, k: int | None, kind: str) -> Track:
        """Return rows of which there should be one a time step."""
        rows, steps = self._steps(rows, k, kind)
        newest = np.maximum.accumulate(np.concatenate([[-1], steps]))[:-1]
        first = steps > newest
        odd = np.flatnonzero(~first)
        if not len(odd):
            return Track(steps, rows, np.empty(0, dtype=np.int64))
        known = {int(steps[place]): place for place in np.flatnonzero(first).tolist()}
        repeats = []
        for place in odd.tolist():
            step, last = int(steps[place]), int(newest[place])
            if step not in known:
                known[step] = place
                first[place] = True
                self._tracks.problem(step, k, kind, f"after that of step {last}", "before it")
            elif rows[place].tobytes() != rows[known[step]].tobytes():
                two = (rows[known[step]].tolist()[1:], rows[place].tolist()[1:])
                self._tracks.problem(step, k, kind, f"twice, with {two[0]} and {two[1]}", "once")
            elif step < last:
                logged = f"again after that of step {last}"
                self._tracks.problem(step, k, kind, logged, "once")
            else:
                repeats.append(step)
        order = np.flatnonzero(first)
        order = order[np.argsort(steps[order], kind="stable")]
        return Track(steps[order], rows[order], np.array(repeats, dtype=np.int64))

    def several(self, rows: np.ndarray, k: int | None, kind: str) -> tuple[np.ndarray, np.ndarray]:
        """Return time steps and rows, of which there may be several a time step."""
        rows, steps = self._steps(rows, k, kind)
        for place in np.flatnonzero(np.diff(steps) < 0).tolist():
            logged = f"after that of step {steps[place]}"
            self._tracks.problem(int(steps[place + 1]), k, kind, logged, "before it")
        return steps, rows

    def statuses(self, found: Sequence[Status]) -> None:
        """Note the world's statuses, and what is odd about them."""
        known = wire.STATES
        for before, status in zip([None, *found], found, strict=False):
            if before is not None and status.step < before.step:
                later = f"after that of step {before.step}"
                self._tracks.problem(status.step, None, wire.STATUS.name, later, "before it")
            odd = [(f"step {status.step}", "0 or later")] if status.step < 0 else []
            if status.state not in known:
                odd.append((repr(status.state[:40]), " or ".join(known)))
            if before is not None and before.state == wire.FINISHED != status.state:
                odd.append((f"{status.state!r} after {before.state!r}", "nothing after it"))
            for name in wire.STATUS_VALUES[2:] if self._tracks.format > 1 else ():
                if getattr(status, name) is None:
                    odd.append((f"no {name!r}", "one"))
            for logged, due in odd:
                self._tracks.problem(status.step, None, wire.STATUS.name, logged, due)
        self._tracks.statuses = list(found)


class _Readers:
    """The readers of the team's topics."""

    def __init__(self, tracks: Tracks, frame: Frame) -> None:
        self._frame, self._tracks = frame, tracks
        self._robots = len(tracks.names)
        self.statuses: list[Status] = []
        self.clock = Reader(
            np.dtype([STAMP]),
            lambda message: (nanoseconds_of(message.clock),),
            [(Layout(layouts.stamp()), _stamps)],
        )
        self.state = Reader(
            np.dtype([STAMP, ("xy", "2f8")]),
            lambda message: (_stamp(message), place_of(message)),
            [(Layout(layouts.pose_stamped()), _fields("xy"))],
        )
        self.percept = self._percept()
        self.grid = self._grid(None)
        self.markers = self._markers()
        self.status = Reader(np.dtype([STAMP]), self._take_status, [])
        self.event = Reader(
            EVENT,
            lambda message: event_row(message, list(tracks.names)),
            [
                *(
                    (layouts.request(name), _event(asker))
                    for asker, name in enumerate(tracks.names)
                ),
                (layouts.response(0), _event(None)),
                (layouts.response(1), _event(None)),
            ],
        )

    def numbers(self, required: tuple[str, ...], optional: tuple[str, ...] = ()) -> Reader:
        """Return the reader of a JointState; what optional labels lack reads as NaN."""
        labels = (*required, *optional)

        def slow(message: Any) -> tuple[Any, ...]:
            found = [str(label) for label in message.name]
            missing = [label for label in required if label not in found]
            if missing:
                raise ValueError(f"labels no number {', '.join(missing)}")
            if sorted(found) not in (sorted(required), sorted(labels)):
                raise ValueError(f"labels its numbers {', '.join(found)[:200]}")
            if len(found) != len(message.position):
                raise ValueError(f"has {len(found)} labels and {len(message.position)} numbers")
            said = dict.fromkeys(optional, np.nan)
            said |= dict(zip(found, message.position, strict=True))
            return _stamp(message), [said[label] for label in labels]

        def short(rows: np.ndarray, fields: np.ndarray) -> None:
            _stamps(rows, fields)
            rows["numbers"][:, : len(required)] = fields["numbers"]
            rows["numbers"][:, len(required) :] = np.nan

        fast: list[tuple[Layout, Fill]] = [(layouts.labelled(labels), _fields("numbers"))]
        fast += [(layouts.labelled(required), short)] if optional else []
        return Reader(np.dtype([STAMP, ("numbers", f"{len(labels)}f8")]), slow, fast)

    def map(self) -> Reader:
        """Return the reader of the map, which must be the scenario's."""
        return self._grid(OccupancyData(self._frame).map)

    def _percept(self) -> Reader:
        robots = self._robots

        def slow(message: Any) -> tuple[Any, ...]:
            places = [place_of(pose) for pose in message.poses]
            padded = [*places, *[(np.nan, np.nan)] * robots][:robots]
            return _stamp(message), len(places), padded

        def fill(count: int) -> Fill:
            def fields_of(rows: np.ndarray, fields: np.ndarray) -> None:
                _stamps(rows, fields)
                rows["count"], rows["places"] = count, np.nan
                for number in range(count):
                    rows["places"][:, number] = fields[f"{number}_xy"]

            return fields_of

        kind = np.dtype([STAMP, ("count", "i4"), ("places", "f8", (robots, 2))])
        fast = [(Layout(layouts.path(n)), fill(n)) for n in range(1, robots + 1)]
        return Reader(kind, slow, fast)

    def _grid(self, due: bytes | None) -> Reader:
        """Return the reader of an occupancy grid; `due`: what its data must be."""
        content = occupancy(self._frame)
        rows_, columns = self._frame.grid.shape
        size = rows_ * columns
        expected = None if due is None else np.frombuffer(due, dtype=np.int8)

        def slow(message: Any) -> tuple[Any, ...]:
            data = np.frombuffer(content(message), dtype=np.int8)
            if expected is not None and not np.array_equal(data, expected):
                raise ValueError("is not the scenario's map")
            return _stamp(message), data

        frame = self._frame
        items = layouts.occupancy(frame.resolution, rows_, columns, frame.origin)
        if expected is None:
            items.append(layouts.Free("data", f"({size},)i1"))
        else:
            items += [layouts.Fixed("i1", value) for value in expected.tolist()]
        kind = np.dtype([STAMP, ("data", "i1", (size,))])
        fill = _fields("data") if expected is None else _stamps
        return Reader(kind, slow, [(Layout(items), fill)])

    def _markers(self) -> Reader:
        content = MarkersContent(self._frame, self._tracks.run.scenario)
        robots = content.robots
        fast: list[tuple[Layout, Fill]] = []

        def fill(rows: np.ndarray, fields: np.ndarray) -> np.ndarray:
            rows["ns"] = nanoseconds(fields, "0_")
            for number, place in enumerate(robots):
                rows["places"][:, number] = fields[f"{place}_xy"]
            stamps = [nanoseconds(fields, f"{place}_") for place in range(len(content.due))]
            return np.asarray(np.all([one == stamps[0] for one in stamps], axis=0))

        def learn() -> None:
            if not fast and content.looks is not None:
                fast.append((layouts.markers(content.looks, content.due), fill))

        kind = np.dtype([STAMP, ("places", "f8", (len(robots), 2))])
        return Reader(kind, content, fast, learn)

    def _take_status(self, message: Any) -> tuple[Any, ...]:
        said = {pair.key: pair.value for pair in message.values}
        step, transitions = (int(said[name]) for name in wire.STATUS_VALUES[:2])
        left_out, timeouts = (
            int(said[name]) if name in said else None
            for name in (wire.STATUS_VALUES[2], "timeouts")
        )
        began = said.get(wire.STATUS_VALUES[3])
        self.statuses.append(
            Status(str(message.message), step, transitions, left_out, began, timeouts)
        )
        return (0,)


def _stamps(rows: np.ndarray, fields: np.ndarray) -> None:
    rows["ns"] = nanoseconds(fields)


def _fields(name: str) -> Fill:
    def fill(rows: np.ndarray, fields: np.ndarray) -> None:
        rows["ns"] = nanoseconds(fields)
        rows[name] = fields[name]

    return fill


def _event(asker: int | None) -> Fill:
    def fill(rows: np.ndarray, fields: np.ndarray) -> None:
        rows["kind"], rows["client"] = fields["kind"], fields["client"]
        rows["number"], rows["wall_ns"] = fields["number"], nanoseconds(fields, "wall_")
        rows["ns"], rows["xy"] = nanoseconds(fields), np.nan
        rows["asker"] = -1 if asker is None else asker
        rows["request"] = asker is not None
        if asker is not None:
            rows["xy"] = fields["xy"]
        elif "0_xy" in (fields.dtype.names or ()):
            rows["xy"], rows["seen"] = fields["0_xy"], True

    return fill


def _stamp(message: Any) -> int:
    check_frame(message.header)
    return nanoseconds_of(message.header.stamp)
