# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder node: the topics of the team, as CDR, into a bag."""

import contextlib
import math
import shutil
import struct
import time
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import NamedTuple, Unpack

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String

from sparse_coord_ros.base.errors import BagError, RunError, SparseCoordError
from sparse_coord_ros.core.runs.run_config import OWN_CLOCK, RUN_RECORD, RunConfig
from sparse_coord_ros.log.bags import BagWriter, QoS
from sparse_coord_ros.log.bags.process import BagProcess
from sparse_coord_ros.log.bags.reader import Bag, continued
from sparse_coord_ros.log.runlog.reading import read_run
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import RECORDER, ROBOT, TEAM
from sparse_coord_ros.protocol.wire.messages import SECOND, STAMPED
from sparse_coord_ros.protocol.wire.published_tables import PublishedTables, read_tables
from sparse_coord_ros.protocol.wire.status import (
    LEFT,
    NO_ATTEMPT,
    Order,
    Progress,
    RunStatus,
    read_progress,
)
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.follower import Follower
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, NodePlace
from sparse_coord_ros.ros.nodes.ros_messages import messages_of, status
from sparse_coord_ros.ros.nodes.spin import run_node

QUIET_SECONDS = 0.3
"""After the run's end, the bag is closed when no message has come for so long."""
LAST_MESSAGES_SECONDS = 6.0
"""After the run's end, how long the bag is kept open for expected last messages."""
TALK_SECONDS = 20.0
"""After the run's end, how long a node that continues to publish keeps the bag open."""
KEPT_FREE = 32
"""MiB of the disk that a recording leaves free, so that tables can still be saved."""
LAG_STEPS = ros_topics.RECORDED_DEPTH
"""How far one topic may be ahead of all others: they arrive in bursts."""


class RobotTables(NamedTuple):
    """A message on a robot's tables, and its bytes."""

    robot: str
    published: PublishedTables
    data: bytes


class Recording:
    """A recorder's part in one run: its bag, and the time at which messages are logged.

    A message that begins with a stamp is logged at that time, any other at the newest stamp seen:
    the bag's time line is the world's, however fast the run went.

    Args:
        node: the recorder, which follows the run.
        run: the run.
        bag: its bag.

    Attributes:
        run, bag: as above.
        messages: the run's messages.
        now_ns: the newest stamp seen.
        status_ns: the newest time in the world's status.
        heard: the time of the last message, by `time.monotonic`.
        attempt: the attempt whose segment of the bag is open.
        final: the robots whose last tables have come.
    """

    def __init__(
        self, node: "Recorder", run: RunConfig, bag: BagWriter | BagProcess
    ) -> None:
        assert node.presence is not None
        self._node = node
        self._presence = node.presence
        self.run = run
        self.bag = bag
        self._report = node.reporter("bag")
        self.messages = messages_of(run)
        self.now_ns = self.status_ns = 0
        self.heard = self._flushed = time.monotonic()
        self.attempt = NO_ATTEMPT
        self.final: set[str] = set()
        self._near_ns = LAG_STEPS * self.messages.period
        self._count = self._steps = 0
        self._order = Order()
        self._state = wire.RunState.WAITING.value
        self._begun: dict[str, str] = {}  # the attempts that the robots have begun
        # Messages count: the segment has begun, and no new order has come.
        self._open = False
        self._late = False  # a message of the attempt before has come
        self._quiet_since = -math.inf
        self._newest_ns: dict[int, int] = {}  # by channel
        self._state_ns: dict[str, int] = {}  # of each robot's newest local state
        self._tables: list[RobotTables] = []  # they wait
        # The robots whose tables are in the segment, by the tables' time step.
        self._written: dict[int, set[str]] = {}

    # Segments.

    def _ready(self, now: float) -> bool:
        """Return whether the ordered attempt's segment may begin: nothing older comes any more.

        All robots have begun the attempt, and no messages are under way; or the world has gone on
        without some of them.
        """
        if self._state not in (wire.RunState.WAITING, wire.RunState.RESUMING):
            return True
        if self._late:
            self._late = False
            self._quiet_since = now
        attempt = self._order.attempt
        begun = [self._begun.get(name) == attempt for name in self.run.scenario.names]
        quiet = now - self._quiet_since >= QUIET_SECONDS
        return all(begun) and quiet and self._finds_robots()

    def _begin(self) -> None:
        """Begin a segment: the run at the time of the checkpoint, then the robots' tables."""
        bag = self.bag
        if self.attempt != NO_ATTEMPT:
            bag.begin_file()
        self.attempt = self._order.attempt
        step = self._order.checkpoint
        self.now_ns = self.status_ns = step * self.messages.period
        bag.add_metadata(RUN_RECORD, self.run.record())
        channel = self._channel(ros_topics.RUN, ros_topics.RUN.name)
        message = serialize_message(String(data=self.run.to_yaml()))
        bag.write(channel, message, self.now_ns, self.now_ns)
        self._open = True
        self._newest_ns.clear()
        self._state_ns.clear()
        self._written.clear()
        earlier = [before for before in self._node.checkpoints if before < step]
        self._node.checkpoints = [*earlier, step]
        attempt = self.attempt
        self._tables = [
            tables for tables in self._tables if tables.published.attempt == attempt
        ]
        self._write_tables()
        self.flush()

    def hear_tables(self, robot: str, heard: tuple[PublishedTables, bytes]) -> None:
        """Keep a robot's tables until they are due."""
        self.heard = time.monotonic()
        tables = RobotTables(robot, *heard)
        self._tables.append(tables)
        if tables.published.occasion == wire.Occasion.FINAL:
            self.final.add(robot)

    def _write_tables(self, *, ending: bool = False) -> None:
        """Write the tables that are due: the bag then holds everything before their time step.

        With the tables of all robots a time step is a checkpoint of this recorder.

        Args:
            ending: no further messages come.
        """
        if not self._tables or not self._open:
            return
        heard_ns = self._heard_ns
        due: list[RobotTables] = []
        waiting: list[RobotTables] = []
        for tables in self._tables:
            published = tables.published
            complete = published.step * self.messages.period <= heard_ns
            begins = published.occasion == wire.Occasion.BEGIN
            # those of another attempt belong to an order that has not come yet
            there = published.attempt == self.attempt and (complete or begins or ending)
            (due if there else waiting).append(tables)
        self._tables = waiting
        for tables in due:
            self._write_down(tables)
        if due:
            self.flush()

    def end(self) -> None:
        """Write the last tables, and tell the world that this recorder records no more."""
        try:
            self._write_tables(ending=True)
        finally:
            self._node.say_progress(self.attempt, LEFT)

    def _write_down(self, tables: RobotTables) -> None:
        """Write a robot's tables, those of a time step only once."""
        step = tables.published.step
        robots = self._written.setdefault(step, set())
        if tables.robot in robots:
            return
        robots.add(tables.robot)
        topic = ros_topics.TABLES
        channel = self._channel(topic, topic.of(tables.robot))
        at = step * self.messages.period
        self.bag.write(channel, tables.data, at, at)

    def _note_checkpoints(self) -> None:
        """Note the time steps with the tables of all robots that have any."""
        known = self._node.checkpoints
        everyone = self._written.get(self._order.checkpoint)
        steps = [step for step, robots in self._written.items() if robots == everyone]
        known += sorted(step for step in steps if step > known[-1])

    def _later(self, at: int, name: str) -> int:
        """Advance to a message's time and return it; outside the run's time, the newest stamp."""
        now = self.now_ns
        if at < 0 or at > max(now, self.status_ns) + self._near_ns:
            stamp = f"stamp {at // SECOND} s {at % SECOND} ns"
            why = f"{stamp} is not of the run's time {now / SECOND:g} s"
            self._node.subscriber.drop(name, why, "message recorded at the run's time")
            return now
        self.now_ns = at
        self._steps += 1
        if self._steps >= self._node.flush_steps:
            self.flush()
        return at

    def flush(self) -> None:
        """Write all recorded messages out, so that they survive this process; tell the world."""
        self._steps = 0
        self._flushed = time.monotonic()
        self.bag.flush()
        if self._open:
            self._note_checkpoints()
            self._node.say_progress(self.attempt)
        # the directory is gone: the bag's own error says so
        with contextlib.suppress(OSError):
            free = shutil.disk_usage(self._node.directory).free >> 20
            if free < KEPT_FREE:
                raise BagError(
                    f"recording to {self._node.directory} ends: its disk has {free} MiB left, "
                    f"{KEPT_FREE} are kept for what the team saves; make room"
                )

    @property
    def _heard_ns(self) -> int:
        """The time up to which the local states of all robots have come."""
        return min(self._state_ns.get(name, 0) for name in self.run.scenario.names)

    @property
    def written(self) -> int:
        """The time step up to which the bag holds everything, as of the last flush."""
        return max(self._order.checkpoint, self._heard_ns // self.messages.period)

    # Its sources.

    def listen(self) -> None:
        """Subscribe to the topics of the run's team."""
        node = self._node
        of_team, of_robot = map(ros_topics.recorded, (TEAM, ROBOT))
        for topic in of_team:
            clock = topic is ros_topics.CLOCK and self.run.clock != OWN_CLOCK
            if topic is not ros_topics.RUN and not clock:
                self._record(topic, "")
        for robot in self.run.scenario.robots:
            for topic in of_robot:
                if topic is not ros_topics.TABLES:
                    self._record(topic, robot.name)
            hear = partial(self.hear_tables, robot.name)
            tables = ros_topics.TABLES
            qos = ros_topics.recorder_qos(tables)
            node.subscriber.listen_packed(
                tables, lambda data: (read_bytes(data),), hear, robot.name, qos=qos
            )
            begun = partial(self._on_progress, robot.name)
            node.subscriber.listen(
                ros_topics.PROGRESS, begun, robot.name, read=read_progress
            )

    def _on_progress(self, robot: str, progress: Progress) -> None:
        self._begun[robot] = progress.attempt

    def _channel(self, topic: ros_topics.RosTopic, name: str) -> int:
        """Register a topic and return its channel in the bag."""
        full_name = self._node.resolve_topic_name(name)
        qos = QoS(durability=topic.qos.durability.name.lower(), depth=topic.qos.depth)
        return self.bag.add_topic(full_name, topic.type_name, qos)

    def _record(self, topic: ros_topics.RosTopic, owner: str) -> None:
        """Record a topic, at the time in its messages, or at the world's."""
        node = self._node
        name = topic.of(owner)
        channel = self._channel(topic, name)
        write_down = self.bag.write
        unpack_stamp = STAMPED.unpack_from
        each_step = topic.delivery == wire.Delivery.STEP
        is_state = topic is ros_topics.LOCAL_STATE
        newest_ns = self._newest_ns
        state_ns = self._state_ns

        def stamped(data: bytes) -> None:
            self._count += 1
            if not self._open:
                self._late = self._late or each_step
                return
            try:
                sec, nanosec = unpack_stamp(data)
            except struct.error as error:
                node.subscriber.drop(name, error)
                return
            at = sec * SECOND + nanosec
            if each_step and at < newest_ns.get(channel, 0):
                return  # a publisher that lost sight of this recorder sends what it keeps
            if not 0 <= at <= self.now_ns:
                at = self._later(at, name)
            newest_ns[channel] = at
            if is_state:
                state_ns[owner] = at
            write_down(channel, data, at, at)

        def other(data: bytes) -> None:
            self._count += 1
            if self._open:
                write_down(channel, data, self.now_ns, self.now_ns)

        write = stamped if topic.stamped else other
        if node.direct is not None and topic.packed:
            node.direct.topic(node.resolve_topic_name(name)).write = node.guarded(write)
        else:
            qos = ros_topics.recorder_qos(topic)
            if node.direct is None and each_step:
                qos = ros_topics.kept_qos(topic)
            listen = partial(node.subscriber.listen_packed, topic, owner=owner, qos=qos)
            if topic is ros_topics.DIAGNOSTICS:
                listen(
                    lambda data: (data, self._of_this_namespace(data)),
                    lambda data, ours: write(data) if ours else None,
                )
            else:
                listen(lambda data: (data,), write)

    def _of_this_namespace(self, data: bytes) -> bool:
        """Return whether diagnostics are of nodes in this node's namespace."""
        space = self._node.get_namespace().strip("/")
        names = (
            status.name for status in deserialize_message(data, DiagnosticArray).status
        )
        spaces = {
            name.partition(":")[0].strip("/").rpartition("/")[0] for name in names
        }
        return space in spaces

    # The methods of a follower of a run.

    def world_said(self, status: RunStatus) -> None:
        """Note the world's order, its state and its time."""
        self._state = status.state
        if status.order != self._order:
            self._order = status.order
            self._open = False
            if self.attempt != NO_ATTEMPT:
                self._quiet_since = time.monotonic()
        sec, nanosec = self.messages.stamp(status.step)
        self.status_ns = max(self.status_ns, sec * SECOND + nanosec)

    def go_on(self, now: float) -> None:
        """Begin a segment where it is due; note new messages, flush waiting ones."""
        if self._order.attempt != self.attempt and self._ready(now):
            self._begin()
        self._write_tables()
        if self._count:
            self._count = 0
            self.heard = now
        waited = now - self._flushed
        if self.heard > self._flushed and waited >= self._node.flush_seconds:
            self.flush()

    def _finds_robots(self) -> bool:
        """Return whether all robots are in the graph: they then know that this recorder listens.

        A robot cannot tell by itself as long as a killed recorder is in its graph.
        """
        names = map(ros_topics.ACTION.of, self.run.scenario.names)
        return self._node.direct is not None or all(
            map(self._node.count_publishers, names)
        )

    def all_done(self, now: float) -> bool:
        """Return whether the bag can be closed: no messages come, and none are due."""
        waited = now - self._presence.ended
        quiet = now - self.heard >= QUIET_SECONDS or waited > TALK_SECONDS
        return quiet and (waited > LAST_MESSAGES_SECONDS or self._heard_all())

    def _heard_all(self) -> bool:
        """Return whether the last messages of all nodes have come.

        Nodes leave when all their messages have arrived. Nodes in this process stay until the
        recorder has ended; their last messages are the robots' tables.
        """
        node = self._node
        names = self.run.scenario.names
        tables = ros_topics.TABLES.of
        if node.direct is None:
            speakers = [*map(tables, names), ros_topics.STATUS.name]
        else:
            speakers = [tables(name) for name in names if name not in self.final]
        return not any(
            map(node.count_publishers, map(node.resolve_topic_name, speakers))
        )

    def report(self) -> None:
        """Publish the amount of recorded data on `/diagnostics`."""
        values = {
            "messages": self.bag.message_count,
            "bytes": self.bag.bytes_written,
            "messages_dropped": self._node.subscriber.total,
        }
        self._report("recording", values)


def read_bytes(data: bytes) -> tuple[PublishedTables, bytes]:
    """Return a message on a robot's tables, and its bytes; an invalid one raises."""
    message = deserialize_message(data, ros_topics.TABLES.type)
    return read_tables(message), bytes(data)


class Recorder(Follower):
    """Records the topics of the team, unchanged.

    A killed recorder loses what it heard since it last flushed.

    Args:
        place: where the node is made, and with what: see `NodePlace`. With `direct` another
            process writes the bag.

    Attributes:
        flush_seconds, flush_steps: it flushes after so many seconds, and so many time steps.
        directory: the bag's directory.
        recording: its part in the run; None before the run has begun.
        checkpoints: the time steps before which the bag holds everything.
        error: the error that ended the recording too early, or None.

    Raises:
        SparseCoordError: a bad parameter, an existing directory, no world simulator, a full disk.
    """

    flush_seconds = 1.0
    flush_steps = 1000
    recording: Recording | None = None
    _earlier: Bag | None = None

    def __init__(self, **place: Unpack[NodePlace]) -> None:
        super().__init__(RECORDER, PARAMETERS[RECORDER], **place)
        self.directory = Path(
            self.values["out"] or f"bag_{datetime.now():%Y%m%d_%H%M%S}"
        )
        if self.directory.exists() and not any(self.directory.glob("*.mcap*")):
            what = f"output directory {self.directory}: exists already, and is no bag"
            raise RunError(f"{what}; choose another one for parameter 'out'")
        self.error: BagError | None = None
        self.checkpoints: list[int] = []
        self._recording_publisher = self.announce(ros_topics.RECORDING)
        topic = self.resolve_topic_name(ros_topics.RUN.name)
        where = self.directory.absolute()
        self.get_logger().info(
            f"will record to {where}; waiting for a world simulator on {topic}"
        )

    def fail(self, error: SparseCoordError) -> None:
        """Stop; or, if only the bag is broken, record no more: the run continues without."""
        if self.recording is None or not isinstance(error, BagError):
            super().fail(error)
        elif self.error is None and not self.done:
            self.error = error
            self.part = self
            if self.direct is not None:
                self.direct.close()
            with contextlib.suppress(BagError):
                self.recording.bag.close()
            self.say_progress(self.order_before.attempt, LEFT)  # nobody waits for it
            self.get_logger().error(f"{error}; the run continues without a recording")

    def may_begin(self, now: float) -> bool:
        """Return whether the world has said how it stands."""
        return self.knows_the_world

    def begin(self, run: RunConfig) -> None:
        """Read the bag so far, if it is continued, and report to the world.

        A recorder that the world awaits begins with the answer, the next order; any other one
        with the order that stands.
        """
        self._progress = self.announce(ros_topics.PROGRESS, RECORDER)
        self._known = self.order_before.attempt if run.recorded else NO_ATTEMPT
        self._earlier = continued(self.directory)
        if self._earlier is not None:
            log = read_run(self.directory)
            if log.run.id != run.id:
                remedy = "choose another one for parameter 'out'"
                raise RunError(
                    f"{self.directory}: holds the recording of another run; {remedy}"
                )
            # before these the bag holds everything
            known = [set(steps) for steps in log.table_steps() if steps]
            self.checkpoints = sorted(set.intersection(*known)) if known else []
        self.say_progress(NO_ATTEMPT)

    def go_on(self, now: float) -> None:
        """Say that the recorder waits for the world's order."""
        if self.error is None:
            self.remind(self.reminder, "the world to say where the run begins")

    def say_progress(self, attempt: str, written: int | None = None) -> None:
        """Tell the world the checkpoints in the bag, the attempt, and how far it is written."""
        if written is None:
            written = 0 if self.recording is None else self.recording.written
        progress = Progress(tuple(self.checkpoints), attempt, written)
        self._progress.publish(status(RECORDER, "progress", progress.values()))

    def world_said(self, status: RunStatus) -> None:
        """Open the bag with the world's order to begin."""
        if self.error is not None:
            self.say_progress(status.order.attempt, LEFT)
            return
        if status.order.attempt in (NO_ATTEMPT, self._known):
            return
        assert self.run is not None
        bag = (BagWriter if self.direct is None else BagProcess)(
            self.directory, earlier=self._earlier
        )
        # a broken one stays unfinished
        self.at_end.enter_context(contextlib.suppress(BagError))
        self.at_end.callback(bag.close)
        self.reminder.over()
        self.part = self.recording = Recording(self, self.run, bag)
        self.recording.listen()
        self.recording.world_said(status)
        self._recording_publisher.publish(String(data=str(self.directory)))
        again = "" if self._earlier is None else ", in a further file of this bag"
        self.get_logger().info(f"records {self.run.scenario.name} from now on{again}")

    def may_stop(self) -> bool:
        """Return whether the last messages have come; other nodes may publish without end."""
        now = time.monotonic()
        return (
            super().may_stop() or now - (self._stopping or now) > LAST_MESSAGES_SECONDS
        )

    def finish(self, *, interrupted: bool) -> None:
        """Close the bag and report its content.

        Raises:
            BagError: the bag is broken, and the recorder is a process of its own.
        """
        if self.error is not None and self.direct is None:
            raise self.error
        if self.recording is None or self.error is not None or self.failure is not None:
            return
        bag = self.recording.bag
        try:
            self.recording.end()
            bag.close()
        except BagError as error:
            self.error = error
            if self.direct is None:
                raise
            self.get_logger().error(str(error))
            return
        where = self.directory.absolute()
        self.get_logger().info(
            f"closed {where}: {bag.message_count} messages, {bag.bytes_written} bytes"
        )


def main() -> int:
    """Run the node `recorder`."""
    return run_node(lambda context: Recorder(context=context))
