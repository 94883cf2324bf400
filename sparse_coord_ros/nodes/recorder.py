# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder node: every topic of the team and the service events, as CDR, into a bag."""

import contextlib
import functools
import shutil
import struct
import sys
import time
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from sparse_coord_ros import wire
from sparse_coord_ros.bags import BagWriter, QoS
from sparse_coord_ros.bags.metadata import RESTARTED, ROLLED_BACK
from sparse_coord_ros.bags.process import BagProcess
from sparse_coord_ros.bags.recover import continued
from sparse_coord_ros.bags.writer import Earlier
from sparse_coord_ros.errors import BagError, RunError, SparseCoordError
from sparse_coord_ros.learn.run_config import (
    MAP_FILE,
    RUN_FILE,
    RUN_RECORD,
    SCENARIO_FILE,
    RunConfig,
)
from sparse_coord_ros.lockstep.rollback import NO_ORDER, ROLL_CALL, Order, Progress
from sparse_coord_ros.lockstep.waiting import WorldPresence
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.intake import Intake
from sparse_coord_ros.nodes.messages import (
    Announced,
    Converter,
    Said,
    progress_message,
    read_run,
    read_status,
    read_tables_message,
    status,
    typed,
)
from sparse_coord_ros.nodes.parameters import RECORDER_PARAMETERS, ParameterNode
from sparse_coord_ros.nodes.spin import run_node
from sparse_coord_ros.nodes.tap import Tap
from sparse_coord_ros.wire import RECORDER, WORLD
from sparse_coord_ros.wire.frame import SECOND, STAMPED

TICK_SECONDS = 0.02
REPORT_SECONDS = 1.0
STATUS = interface.STATUS
ROS_TOPICS = (interface.ROSOUT, interface.PARAMETER_EVENTS)
QUIET_SECONDS = 0.3
"""After the run's end, the bag is closed when nothing has come for so long."""
LAST_WORDS_SECONDS = 6.0
"""After the run's end, how long the bag is kept open for last words that may be to come."""
KEPT_FREE = 32 << 20
"""Bytes of the disk that a recording leaves free, so that tables can still be saved."""
LAG_STEPS = 1000
"""How far one topic may be ahead of all others: on a busy machine they arrive in bursts."""
STOP_SECONDS = 1.0
"""How long a recorder that gets a signal waits for the world's last status: both may get it."""


Bag: TypeAlias = BagWriter | BagProcess


class Recording(NamedTuple):
    """What exists once a run is announced: the run, its bag, and what is known of its world."""

    run: RunConfig
    bag: Bag
    watch: WorldPresence


class Recorder(ParameterNode):
    """Writes raw messages at the simulated time.

    A message that begins with a stamp is logged at that time, any other at the newest stamp seen:
    the bag's time line is the world's, however fast the run went. (When something happened by the
    wall clock, the service events say.)

    Args:
        context: the ROS context.
        namespace: the team's namespace.
        values: parameters given by the program; None: by the command line.
        tap: the way from the other nodes where they are in this process. The recorder then writes
            by another process, and an error of the recording does not stop the others.

    Attributes:
        error: why the recording ended too early, or None.

    Raises:
        SparseCoordError: a bad parameter, an existing directory, no world simulator, a full disk.
    """

    def __init__(
        self,
        *,
        context: Context,
        namespace: str = "",
        values: Mapping[str, Any] | None = None,
        tap: Tap | None = None,
    ) -> None:
        super().__init__(
            RECORDER,
            RECORDER_PARAMETERS,
            context=context,
            namespace=namespace,
            values=values,
            tap=tap,
        )
        out = self.values["out"] or datetime.now().strftime("bag_%Y%m%d_%H%M%S")
        self.directory = Path(out)
        if self.directory.exists() and not self.values["resume"]:
            raise RunError(
                f"output directory {self.directory}: exists already, nothing is overwritten; "
                "choose another one for parameter 'out'"
            )
        self.recording: Recording | None = None
        self.error: BagError | None = None
        self.done = False
        self._intake = Intake(self)
        self._stopping: float | None = None
        self._now_ns = self._said_ns = self._near_ns = 0
        self._steps = 0
        self._count = 0
        self._last = self._reported = self._flushed = time.monotonic()
        self._tables: dict[str, tuple[int, bytes]] = {}
        self._final: set[str] = set()
        self._diagnostics_publisher = self.announce(interface.DIAGNOSTICS)
        self._recording_publisher = self.announce(interface.RECORDING)
        read = typed(interface.RUN, read_run)
        self._status: Said | None = None
        self._announced: tuple[bytes, Announced] | None = None
        self._obeyed = NO_ORDER
        self._progress_publisher = self.announce(interface.PROGRESS, RECORDER)
        self._subscribe(interface.RUN, self._on_run, read=lambda data: (data, read(data)))
        self._subscribe(STATUS, self._on_status, read=typed(STATUS, read_status))
        self.create_timer(TICK_SECONDS, self._tick)

    def fail(self, error: SparseCoordError) -> None:
        """Stop; beside nodes in the same process, let them go on where only the bag is broken."""
        if self._tap is None or self.recording is None or not isinstance(error, BagError):
            super().fail(error)
        elif self.error is None:
            self.error, self.done = error, True
            self._tap.close()
            self.get_logger().error(f"{error}; the run goes on unrecorded")

    def _on_run(self, said: tuple[bytes, Announced]) -> None:
        """Open the bag with the first run that is announced, and listen to its team."""
        data, (run, text) = said
        if self.recording is not None:
            if run.id != self.recording.run.id:
                self.recording.watch.another_run()
                self.get_logger().warning(
                    "another world simulator has begun a run; this recorder stays with its own"
                )
            return
        self._announced = said
        self._begin_when_told()

    def _begin_when_told(self) -> None:
        """Open the bag; where it is continued, once the world has said from where."""
        status = self._status
        if self._announced is None or self.recording is not None:
            return
        earlier = None
        if self.values["resume"]:
            if status is None or (status.state == wire.RESUMING and not status.order.name):
                return
            earlier = continued(self.directory)
        data, (run, text) = self._announced
        bag, go_on = self._open(run, earlier, Order() if status is None else status.order)
        self._listen(run, text, data, bag, go_on=go_on)

    def _open(self, run: RunConfig, earlier: Earlier | None, order: Order) -> tuple[Bag, bool]:
        """Return a new bag, or one that is continued, and whether it is that."""
        options: dict[str, Any] = {
            "compression": self.values["compression"],
            "max_bytes": self.values["max_bagfile_size"],
            "max_ns": round(self.values["max_bagfile_duration"] * SECOND),
        }
        if earlier is not None:
            options |= {"earlier": earlier, "why": self._why(order)}
            self._now_ns = earlier.end_ns
            if order.name and order.step != ROLL_CALL:
                self._now_ns = (order.first - 1) * Converter(run).period
            if earlier.run_id not in ("", run.id):
                raise RunError(
                    f"{self.directory}: holds the recording of another run; choose another one "
                    "for parameter 'out'"
                )
        make = BagWriter if self._tap is None else BagProcess
        return make(self.directory, **options), earlier is not None

    def _why(self, order: Order) -> dict[str, str]:
        """Return what a file says that begins with an order, or without one."""
        self._obeyed = order.name
        if not order.name or order.step == ROLL_CALL:
            return {"why": RESTARTED}
        return {"why": ROLLED_BACK, "step": str(order.step), "first": str(order.first)}

    def _obey(self, order: Order) -> None:
        """Begin another file of the bag where the run goes back, and tell the world."""
        recording = self.recording
        if recording is None or not order.name:
            return
        if order.name != self._obeyed:
            why = self._why(order)
            if order.step != ROLL_CALL:
                recording.bag.begin_file(why)
                self._now_ns = self._said_ns = (order.first - 1) * Converter(recording.run).period
                self._tables.clear()
        said = Progress("", 0, 0, (), self._obeyed)
        self._progress_publisher.publish(progress_message(RECORDER, said))

    def _listen(self, run: RunConfig, text: str, data: bytes, bag: Bag, *, go_on: bool) -> None:
        """Begin to record a run; where its bag is continued, what it is stands in it already."""
        patience = self.values["world_timeout"]
        watch = WorldPresence(run.id, run.scenario.steps, patience, time.monotonic())
        self.recording = Recording(run, bag, watch)
        self._near_ns = LAG_STEPS * Converter(run).period
        channel = self._channel(bag, String, interface.RUN.name, interface.RUN.qos)
        if not go_on:
            record = {**run.record(), wire.FORMAT_KEY: str(wire.BAG_FORMAT)}
            bag.add_metadata(RUN_RECORD, record)
            scenario = yaml.safe_dump(run.scenario.to_dict(), sort_keys=False, allow_unicode=True)
            bag.attach(RUN_FILE, text.encode(), "application/yaml")
            bag.attach(SCENARIO_FILE, scenario.encode(), "application/yaml")
            bag.attach(MAP_FILE, run.scenario.map.to_text().encode(), "text/plain")
            bag.write(channel, data, 0, 0)
        for topic in (*interface.TEAM_TOPICS, *ROS_TOPICS):
            if topic is not interface.RUN:
                self._record(bag, topic, topic.name)
        for name in self.names_of(WORLD) or {WORLD}:
            self._record(bag, interface.CLAIM, interface.CLAIM.of(name))
        for robot in run.scenario.robots:
            for topic in (*interface.ROBOT_TOPICS, interface.CLAIM, interface.SERVICE_EVENTS):
                self._record(bag, topic, topic.of(robot.name))
            then = functools.partial(self._on_tables, bag, robot.name)
            read = typed(interface.TABLES, read_tables_message)
            self._subscribe(interface.TABLES, then, robot.name, read=read)
        bag.flush()
        self._recording_publisher.publish(String(data=str(self.directory)))
        if self._status is not None:
            self._on_status(self._status)

    def _channel(self, bag: Bag, message_type: type, name: str, qos: QoSProfile) -> int:
        """Register a topic and return its channel in the bag."""
        return bag.add_topic(
            self.resolve_topic_name(name), _type_name(message_type), _bag_qos(qos)
        )

    def _record(self, bag: Bag, topic: interface.RosTopic, name: str) -> None:
        """Write down a topic, at the time that its messages say, or at the world's."""
        channel = self._channel(bag, topic.type, name, topic.qos)
        write, unpack_stamp = bag.write, STAMPED.unpack_from

        def stamped_message(data: bytes) -> None:
            if self.error is not None:
                return
            self._count += 1
            try:
                sec, nanosec = unpack_stamp(data)
            except struct.error as error:
                self._intake.drop(name, error)
                return
            at, now = sec * SECOND + nanosec, self._now_ns
            if at > now:
                if at > max(now, self._said_ns) + self._near_ns:
                    self._odd(name, sec, nanosec)
                    at = now
                else:
                    self._now_ns = at
                    self._steps += 1
                    if self._steps >= self.values["flush_steps"]:
                        self._flush(bag)
            elif at < 0:
                self._odd(name, sec, nanosec)
                at = now
            write(channel, data, at, at)

        def other_message(data: bytes) -> None:
            if self.error is not None:
                return
            self._count += 1
            write(channel, data, self._now_ns, self._now_ns)

        callback = stamped_message if topic.stamped else other_message
        if self._tap is not None and topic.tapped:
            self._tap.line(self.resolve_topic_name(name)).write = self.guarded(callback)
        else:
            self._subscribe(topic, callback, name=name)

    def _odd(self, name: str, sec: int, nanosec: int) -> None:
        self._intake.drop(
            name,
            f"stamp {sec} s {nanosec} ns is not of the run's time {self._now_ns / SECOND:g} s",
            "message recorded at the run's time",
        )

    def _flush(self, bag: Bag) -> None:
        """Let all that was recorded survive this process."""
        self._steps, self._flushed = 0, time.monotonic()
        bag.flush()
        with contextlib.suppress(OSError):  # the directory is gone: the bag's own error says so
            free = shutil.disk_usage(self.directory).free
            if free < KEPT_FREE:
                raise BagError(
                    f"recording to {self.directory} ends: its disk has {free >> 20} MiB left, "
                    f"{KEPT_FREE >> 20} are kept for what the team saves; make room"
                )

    def _subscribe(
        self,
        topic: interface.RosTopic,
        then: Callable[[Any], None],
        owner: str = "",
        *,
        name: str = "",
        read: Callable[[bytes], Any] = bytes,
    ) -> None:
        """Listen to a topic with a queue that nothing is pushed out of; as `Intake.listen`."""
        latched = topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        own = interface.RECORDER_LATCHED_QOS if latched else interface.RECORDER_QOS
        self._intake.listen(topic, then, owner, name=name, read=read, qos=own)

    def _on_status(self, said: Said) -> None:
        if self.recording is None:
            self._status = said  # perhaps the world's last word, before its run has come
            self._begin_when_told()
            return
        if self.error is not None:
            return
        run, _, watch = self.recording
        try:
            watch.hear(*said[:4], time.monotonic())
        except ValueError as error:
            self._intake.drop(STATUS.name, error)
            return
        self._obey(said.order)
        sec, nanosec = Converter(run).stamp(said.step)
        self._said_ns = max(self._said_ns, sec * SECOND + nanosec)

    def _on_tables(self, bag: Bag, robot: str, said: tuple[bytes, int, str]) -> None:
        """Attach a robot's tables to the bag, each but once."""
        if self.error is not None:
            return
        packed, step, occasion = said
        self._last = time.monotonic()
        if self._tables.get(robot) != (step, packed):
            self._tables[robot] = (step, packed)
            name = wire.tables_attachment(robot, step)
            bag.attach(name, packed, "application/x-npz", self._now_ns)
            self._flush(bag)  # the robot saves now, and may go on from there
        if occasion == wire.FINAL:
            self._final.add(robot)

    def _tick(self) -> None:
        now = time.monotonic()
        if self.error is not None:
            return
        if self._count:
            self._count, self._last = 0, now
        if self.recording is None:
            self.check_startup_time()
            return
        if self._last > self._flushed and now - self._flushed >= self.values["flush_seconds"]:
            self._flush(self.recording.bag)
        watch = self.recording.watch
        if watch.end is not None:
            quiet = now - self._last >= QUIET_SECONDS
            waited = now - watch.ended > LAST_WORDS_SECONDS
            self.done = quiet and (waited or self._heard_all(self.recording.run))
        elif now - self._reported >= REPORT_SECONDS:
            self._reported = now
            self._report(self.recording)
            missed, gone = watch.to_say(now), watch.given_up(now)
            if missed:
                self.get_logger().warning(missed)
            if gone:
                self.get_logger().warning(f"{gone}: the recorder closes the bag and ends")
                self.done = True

    def _heard_all(self, run: RunConfig) -> bool:
        """Whether nobody is left whose last words are still to come.

        Nodes leave when all that they said has arrived. Those in this process stay until the
        recorder has ended; their last words are the robots' tables.
        """
        speakers = [
            interface.TABLES.of(robot.name)
            for robot in run.scenario.robots
            if self._tap is None or robot.name not in self._final
        ]
        if self._tap is None:
            speakers.append(interface.STATUS.name)
        names = [self.resolve_topic_name(topic) for topic in speakers]
        return not any(self.count_publishers(name) for name in names)

    def may_stop(self) -> bool:
        """Whether there is nothing to record any more, or waiting for it has taken too long."""
        now = time.monotonic()
        self._stopping = self._stopping or now
        if self.recording is None or self.done or self.error is not None:
            return True
        over = self.recording.watch.end is not None
        return now - self._stopping > (LAST_WORDS_SECONDS if over else STOP_SECONDS)

    def _report(self, recording: Recording) -> None:
        bag = recording.bag
        values = {
            "messages": bag.message_count,
            "bytes": bag.bytes_written,
            "messages_dropped": self._intake.total,
        }
        convert = Converter(recording.run)
        message = DiagnosticArray(header=convert.header(self._now_ns // convert.period))
        message.status = [status(f"{self.full_name}: bag", "recording", values)]
        self._diagnostics_publisher.publish(message)

    def finish(self, *, interrupted: bool) -> None:
        """Close the bag and say what is in it."""
        if self.recording is None or self.error is not None or self.failure is not None:
            return
        bag = self.recording.bag
        try:
            bag.close()
        except BagError as error:
            self.fail(error)
            if self.failure is not None:
                raise
            return
        self.get_logger().info(
            f"closed {self.directory}: {bag.message_count} messages, {bag.bytes_written} bytes"
        )

    def close(self) -> None:
        """Close the bag, if there is one and it was not closed; a broken one stays unfinished."""
        if self.recording is not None:
            with contextlib.suppress(BagError):
                self.recording.bag.close()


def _type_name(message_type: type) -> str:
    """Return `package/msg/Type`, or `package/srv/Service_Event`."""
    package, kind = message_type.__module__.split(".")[:2]
    return f"{package}/{kind}/{message_type.__name__}"


def _bag_qos(qos: QoSProfile) -> QoS:
    return QoS(
        reliability="reliable",
        durability=qos.durability.name.lower(),
        history="keep_last",
        depth=qos.depth,
    )


def main(args: list[str] | None = None) -> int:
    """Run the node `recorder`."""
    return run_node(lambda context: Recorder(context=context), args)


if __name__ == "__main__":
    sys.exit(main())
