# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages sorted by topic and time step, with whatever is odd about them."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from sparse_coord_ros.core.frame import SECOND, Frame, flat_position
from sparse_coord_ros.core.occupancy import OccupancyData
from sparse_coord_ros.core.run_config import RunConfig
from sparse_coord_ros.core.wire import ACTION_LABELS, REWARD_LABELS
from sparse_coord_ros.recording.reader import Bag, Message, open_bag
from sparse_coord_ros.runlog.attached import RecordedTables, read_tables
from sparse_coord_ros.runlog.decode import Decoder
from sparse_coord_ros.runlog.dialogue import Event, Request, put_together, read_event
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.shown import markers, occupancy
from sparse_coord_ros.runlog.source import check_source, find_run
from sparse_coord_ros.runlog.times import LogTimes

CLOCK = "/clock"
STAMPED = ("local_state", "reward", "action", "percept", "coordination_map")
EVENTS = "active_perception/_service_event"


class Track:
    """The messages of one stamped topic.

    Attributes:
        first: content by time step, in the order of the log.
        place: by time step, which message of the bag it was.
        repeats: by time step, the places of those that said the same once more.
    """

    def __init__(self) -> None:
        self.first: dict[int, Any] = {}
        self.place: dict[int, int] = {}
        self.repeats: dict[int, list[int]] = {}
        self.last = -1

    def take(self, step: int, content: Any, place: int) -> tuple[str, str] | None:
        """Take in a message; return (logged, computed) of what is odd about its place."""
        if step > self.last:
            self.first[step], self.place[step], self.last = content, place, step
            return None
        if step not in self.first:
            self.first[step], self.place[step] = content, place
            return f"after that of step {self.last}", "before it"
        if repr(content) != repr(self.first[step]):
            return f"twice, with {self.first[step]} and {content}", "once"
        if step < self.last:
            return f"again after that of step {self.last}", "once"
        self.repeats.setdefault(step, []).append(place)
        return None


class Status(NamedTuple):
    """What the world said of itself."""

    state: str
    step: int
    transitions: int
    timeouts: int


class Tracks:
    """What `read_tracks` reads.

    Attributes:
        bag: the bag.
        run: the run.
        names: the robots.
        states: (x, y) by robot; rewards: four numbers; actions: five; percepts: positions.
        clock: the steps of /clock.
        maps, markers: (time step, content) in the order of the log; of markers the robots'
            positions. coordination_maps: of each robot.
        statuses: of the world, in the order of the log.
        requests: the dialogue.
        tables: of each attachment.
        problems: what is odd, in the order of the log.
    """

    def __init__(self, bag: Bag, run: RunConfig, prefix: str) -> None:
        self.bag = bag
        self.run = run
        self.prefix = prefix
        self.names = tuple(robot.name for robot in run.scenario.robots)
        self.states = [Track() for _ in self.names]
        self.rewards = [Track() for _ in self.names]
        self.actions = [Track() for _ in self.names]
        self.percepts = [Track() for _ in self.names]
        self.coordination_maps: list[list[tuple[int, bytes]]] = [[] for _ in self.names]
        self.maps: list[tuple[int, bytes]] = []
        self.markers: list[tuple[int, tuple]] = []
        self.clock = Track()
        self.statuses: list[Status] = []
        self.requests: list[Request] = []
        self.tables: list[RecordedTables] = []
        self.problems: list[Difference] = []

    @property
    def broken_off(self) -> bool:
        """Whether the recording ended before the run, or a part of it is lost."""
        return not (self.bag.finished and self.bag.whole) or self.bag.recovered is not None

    def of(self, k: int) -> tuple[Track, ...]:
        """Return one robot's tracks."""
        return self.states[k], self.rewards[k], self.actions[k], self.percepts[k]

    def problem(self, step, robot: int | None, quantity: str, logged: str, computed: str):
        """Note something odd."""
        name = None if robot is None else self.names[robot]
        self.problems.append(Difference(step, name, quantity, logged, computed))

    def topic(self, kind: str, robot: int | None = None) -> str:
        """Return a topic's full name."""
        return self.prefix + (kind if robot is None else f"{self.names[robot]}/{kind}")


def read_tracks(path: Path) -> Tracks:
    """Read a bag; arguments and errors as of `read_run`."""
    bag = open_bag(path)
    decode = Decoder(bag.topics)
    run, prefix, said = find_run(bag, decode)
    tracks = Tracks(bag, run, prefix)
    frame = Frame(run)
    readers: dict[str, Callable[[Any, Message, int], None]] = {CLOCK: _clock_reader(tracks, frame)}
    kinds = (
        ("local_state", tracks.states, _position),
        ("reward", tracks.rewards, _numbers(REWARD_LABELS)),
        ("action", tracks.actions, _numbers(ACTION_LABELS)),
        ("percept", tracks.percepts, _positions),
    )
    events: list[Event] = []
    for k in range(len(tracks.names)):
        for kind, of, content in kinds:
            reader = _stamped_reader(tracks, frame, kind, k, of[k], content)
            readers[tracks.topic(kind, k)] = reader
        kind, of = "coordination_map", tracks.coordination_maps[k]
        reader = _latched_reader(tracks, frame, kind, k, of, occupancy(frame))
        readers[tracks.topic(kind, k)] = reader
        readers[tracks.topic(EVENTS, k)] = _event_reader(tracks, frame, k, events)
    readers[tracks.topic("map")] = _latched_reader(
        tracks, frame, "map", None, tracks.maps, _map_content(frame)
    )
    readers[tracks.topic("status")] = _status_reader(tracks)
    readers[tracks.topic("markers")] = _markers_reader(tracks, frame)
    times = LogTimes(frame, _stamped(tracks))
    next_number = dict.fromkeys(bag.topics, 0)
    for place, message in enumerate(bag.messages()):
        topic = message.topic
        if message.sequence != next_number[topic]:
            logged = f"number {message.sequence} after {next_number[topic] - 1}"
            tracks.problem(
                message.log_time_ns // frame.period, None, f"topic {topic}", logged, "the next one"
            )
        next_number[topic] = message.sequence + 1
        tracks.problems += times.check(message)
        reader = readers.get(topic)
        if reader is not None:
            try:
                reader(decode(topic, message.data), message, place)
            except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
                step = message.log_time_ns // frame.period
                tracks.problem(step, None, f"topic {topic}", f"a message that {error}", "readable")
    _check_source(tracks, said, readers)
    tracks.requests, problems = put_together(events, list(tracks.names))
    tracks.problems += problems
    for odd, entry in read_tables(bag, run):
        tracks.problems += [] if odd is None else [odd]
        tracks.tables += [] if entry is None else [entry]
    return tracks


def _check_source(tracks: Tracks, said: str | None, topics: Iterable[str]) -> None:
    """Note what is odd about the bag as a whole.

    Of one that broke off before the run began, not what is missing.
    """
    found = list(check_source(tracks.bag, tracks.run, said))
    for topic in topics:
        if topic not in tracks.bag.topics:
            due = "a topic of this run"
            found.append(Difference(None, None, f"topic {topic}", MISSING, due))
    if tracks.broken_off and not all(track.first for track in tracks.states):
        found = [one for one in found if one.logged != MISSING]
    tracks.problems += found


def _stamped(tracks: Tracks) -> set[str]:
    """Return the topics whose messages begin with a stamp, at which they are logged."""
    of_robots = {tracks.topic(kind, k) for kind in STAMPED for k in range(len(tracks.names))}
    return of_robots | {CLOCK, tracks.topic("map")}


def _stamped_reader(tracks: Tracks, frame: Frame, kind: str, k: int, track: Track, content):
    def read(decoded: Any, message: Message, place: int) -> None:
        _check_frame(decoded.header)
        stamp = decoded.header.stamp
        step = frame.step(stamp.sec, stamp.nanosec)
        _check_stamp(tracks, frame, stamp, step, k, kind)
        odd = track.take(step, content(decoded), place)
        if odd is not None:
            tracks.problem(step, k, kind, *odd)

    return read


def _clock_reader(tracks: Tracks, frame: Frame):
    def read(decoded: Any, message: Message, place: int) -> None:
        step = frame.step(decoded.clock.sec, decoded.clock.nanosec)
        _check_stamp(tracks, frame, decoded.clock, step, None, "clock")
        odd = tracks.clock.take(step, None, place)
        if odd is None and step in tracks.clock.repeats:
            odd = ("twice", "once")
        if odd is not None:
            tracks.problem(step, None, "clock", *odd)

    return read


def _check_stamp(tracks, frame: Frame, stamp, step: int, k, kind: str) -> None:
    """A message is stamped with a time step."""
    if (stamp.sec, stamp.nanosec) != frame.stamp(step):
        logged = f"{stamp.sec}.{stamp.nanosec:09d} s"
        tracks.problem(step, k, f"{kind} stamp", logged, f"{step * frame.period / SECOND:.9f} s")


def _latched_reader(tracks: Tracks, frame: Frame, kind: str, k, of: list, content):
    def read(decoded: Any, message: Message, place: int) -> None:
        _check_frame(decoded.header)
        stamp = decoded.header.stamp
        step = frame.step(stamp.sec, stamp.nanosec)
        _check_stamp(tracks, frame, stamp, step, k, kind)
        _append(tracks, of, step, k, kind, content(decoded))

    return read


def _append(tracks: Tracks, of: list, step: int, k, kind: str, content: Any) -> None:
    """Note a message of which several may be of a time step."""
    if of and step < of[-1][0]:
        tracks.problem(step, k, kind, f"after that of step {of[-1][0]}", "before it")
    of.append((step, content))


def _map_content(frame: Frame):
    content, due = occupancy(frame), OccupancyData(frame).map

    def read(decoded: Any) -> bytes:
        data = content(decoded)
        if data != due:
            raise ValueError("is not the scenario's map")
        return data

    return read


def _markers_reader(tracks: Tracks, frame: Frame):
    content = markers(frame, tracks.run.scenario)

    def read(decoded: Any, message: Message, place: int) -> None:
        step, places = content(decoded)
        _append(tracks, tracks.markers, step, None, "markers", places)

    return read


def _status_reader(tracks: Tracks):
    def read(decoded: Any, message: Message, place: int) -> None:
        said = {pair.key: pair.value for pair in decoded.values}
        numbers = (int(said[name]) for name in ("step", "transitions", "timeouts"))
        status = Status(str(decoded.message), *numbers)
        if tracks.statuses and status.step < tracks.statuses[-1].step:
            later = f"after that of step {tracks.statuses[-1].step}"
            tracks.problem(status.step, None, "status", later, "before it")
        tracks.statuses.append(status)

    return read


def _event_reader(tracks: Tracks, frame: Frame, peer: int, events: list[Event]):
    def read(decoded: Any, message: Message, place: int) -> None:
        events.append(read_event(decoded, peer, frame))

    return read


def _position(message: Any) -> tuple[float, float]:
    _check_frame(message.header)
    return flat_position(message.pose)


def _check_frame(header: Any) -> None:
    if header.frame_id != "map":
        raise ValueError(f"is in the frame {header.frame_id!r}")


def _positions(message: Any) -> tuple[tuple[float, float], ...]:
    return tuple(_position(pose) for pose in message.poses)


def _numbers(labels: tuple[str, ...]):
    def content(message: Any) -> tuple[float, ...]:
        said = dict(zip(message.name, message.position, strict=False))
        missing = [label for label in labels if label not in said]
        if missing:
            raise ValueError(f"labels no number {', '.join(missing)}")
        return tuple(said[label] for label in labels)

    return content
