# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder node: every topic of the team and the service events, as CDR, into a bag."""

import functools
import struct
import sys
import time
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.context import Context
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from sparse_coord_ros.core.run_config import RunConfig, run_from_yaml
from sparse_coord_ros.errors import RunError
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.messages import Converter, status
from sparse_coord_ros.nodes.parameters import (
    RECORDER,
    RECORDER_PARAMETERS,
    WORLD,
    ParameterNode,
    stops_on_bad_input,
)
from sparse_coord_ros.nodes.spin import run_node
from sparse_coord_ros.recording import BagWriter, QoS

TICK_SECONDS = 0.02
REPORT_SECONDS = 1.0
STAMP, ENCAPSULATION = struct.Struct("<iI"), 4
"""Seconds and nanoseconds, which follow the four bytes that begin every CDR message."""
STATUS = interface.STATUS
ROS_TOPICS = (
    interface.Topic("/rosout", Log, interface.EVENT_QOS),
    interface.Topic("/parameter_events", ParameterEvent, interface.EVENT_QOS),
)
SERVICE_EVENTS = interface.Topic(
    f"{interface.ACTIVE_PERCEPTION}/_service_event",
    interface.ACTIVE_PERCEPTION_TYPE.Event,
    interface.STEP_QOS,
)
QUIET_SECONDS = 0.3
"""After the run's end, the bag is closed when nothing has come for so long."""


class Recorder(ParameterNode):
    """Writes raw messages at the simulated time.

    A message that begins with a stamp is logged at that time, any other at the newest stamp seen:
    the bag's time line is the world's, however fast the run went. (When something happened by the
    wall clock, the service events say.)

    Args:
        context: the ROS context.
        namespace: the team's namespace.
        values: parameters given by the program; None: by the command line.

    Raises:
        SparseCoordError: a bad parameter, an existing directory, no world simulator, a full disk.
    """

    def __init__(
        self,
        *,
        context: Context,
        namespace: str = "",
        values: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(
            RECORDER, RECORDER_PARAMETERS, context=context, namespace=namespace, values=values
        )
        out = self.values["out"] or datetime.now().strftime("bag_%Y%m%d_%H%M%S")
        self.directory = Path(out)
        if self.directory.exists():
            raise RunError(
                f"output directory {self.directory}: exists already, nothing is overwritten; "
                "choose another one for parameter 'out'"
            )
        self.bag: BagWriter | None = None
        self.done = False
        self._run: RunConfig | None = None
        self._ended = False
        self._now_ns = 0
        self._last = self._reported = time.monotonic()
        self._count = 0
        self._diagnostics_publisher = self.create_publisher(
            interface.DIAGNOSTICS.type, interface.DIAGNOSTICS.name, interface.DIAGNOSTICS.qos
        )
        self._subscribe(interface.RUN.type, interface.RUN.name, interface.RUN.qos, self._on_run)
        self.create_timer(TICK_SECONDS, self._tick)

    @stops_on_bad_input
    def _on_run(self, data: bytes) -> None:
        """Open the bag with the first run that is announced, and listen to its team."""
        if self._run is not None:
            return
        text = deserialize_message(data, String).data
        run = run_from_yaml(text, where="topic run")
        self.bag = BagWriter(self.directory)
        self.bag.add_metadata(
            "sparse_coord_ros",
            {
                "scenario": run.scenario.name,
                "seed": str(run.seed),
                "learner": run.learner,
                **{f"version_{name}": value for name, value in run.versions.items()},
            },
        )
        self.bag.attach("run.yaml", text.encode(), "application/yaml")
        self.bag.write(self._channel(String, interface.RUN.name, interface.RUN.qos), data, 0, 0)
        self._run = run
        for topic in (*interface.TEAM_TOPICS, *ROS_TOPICS):
            if topic is not interface.RUN:
                self._record(topic, topic.name, self._on_status if topic is STATUS else None)
        self._record(interface.CLAIM, interface.CLAIM.of(WORLD))
        for robot in run.scenario.robots:
            for topic in (*interface.ROBOT_TOPICS, interface.CLAIM, SERVICE_EVENTS):
                self._record(topic, topic.of(robot.name))

    def _channel(self, message_type: type, name: str, qos: QoSProfile) -> int:
        """Register a topic and return its channel in the bag."""
        return self.bag.add_topic(
            self.resolve_topic_name(name), _type_name(message_type), _bag_qos(qos)
        )

    def _record(self, topic: interface.Topic, name: str, then=None) -> None:
        """Write down a topic; `then` sees each message's bytes too."""
        channel = self._channel(topic.type, name, topic.qos)
        write, unpack_stamp = self.bag.write, STAMP.unpack_from

        @stops_on_bad_input
        def stamped_message(self, data: bytes) -> None:
            self._count += 1
            sec, nanosec = unpack_stamp(data, ENCAPSULATION)
            at = sec * 1_000_000_000 + nanosec
            if at > self._now_ns:
                self._now_ns = at
            write(channel, data, at, at)

        @stops_on_bad_input
        def other_message(self, data: bytes) -> None:
            self._count += 1
            write(channel, data, self._now_ns, self._now_ns)
            if then is not None:
                then(data)

        callback = functools.partial(stamped_message if topic.stamped else other_message, self)
        self._subscribe(topic.type, name, topic.qos, callback)

    def _subscribe(self, message_type: type, name: str, qos: QoSProfile, callback) -> None:
        """Listen to the bytes of a topic, with a queue that nothing is pushed out of."""
        latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        own = interface.RECORDER_LATCHED_QOS if latched else interface.RECORDER_QOS
        self.create_subscription(message_type, name, callback, own, raw=True)

    def _on_status(self, data: bytes) -> None:
        message = deserialize_message(data, DiagnosticStatus)
        if message.message in (interface.FINISHED, interface.STOPPED):
            self._ended = True

    @stops_on_bad_input
    def _tick(self) -> None:
        now = time.monotonic()
        if self._count:
            self._count, self._last = 0, now
        if self._run is None:
            self.check_startup_time()
        elif self._ended and now - self._last >= QUIET_SECONDS:
            self.done = True
        elif now - self._reported >= REPORT_SECONDS and not self._ended:
            self._report(now)
            if self.world_is_gone():
                self.get_logger().warning("the world simulator is gone: the recorder ends too")
                self.done = True

    def _report(self, now: float) -> None:
        self._reported = now
        values = {"messages": self.bag.message_count, "bytes": self.bag.bytes_written}
        convert = Converter(self._run)
        message = DiagnosticArray(header=convert.header(self._now_ns // convert.period))
        message.status = [status(self.get_name(), "recording", values)]
        self._diagnostics_publisher.publish(message)

    def finish(self, *, interrupted: bool) -> None:
        """Close the bag and say what is in it."""
        if self.bag is not None:
            self.close()
            self.get_logger().info(
                f"closed {self.directory}: {self.bag.message_count} messages, "
                f"{self.bag.bytes_written} bytes"
            )

    def close(self) -> None:
        """Close the bag, if there is one: its index and `metadata.yaml` are written."""
        if self.bag is not None:
            self.bag.close()


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
