# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ROS parameters from the typed tables of `core.game.settings`."""

import functools
import math
import time
from array import array
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, TypedDict, Unpack

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher

from sparse_coord_ros.base.errors import (
    RunError,
    SettingError,
    SparseCoordError,
    failure_of,
    message_of,
)
from sparse_coord_ros.core.game.plugins import allow_modules, allow_named
from sparse_coord_ros.core.game.scenario import (
    SETTINGS,
    Scenario,
    load_scenario,
    scenario_names,
)
from sparse_coord_ros.core.game.settings import (
    Setting,
    SettingTable,
    tables_from_yaml,
)
from sparse_coord_ros.core.runs.run_config import (
    LIVE_LEARNER,
    RUN_SETTINGS,
    RunConfig,
    make_run,
)
from sparse_coord_ros.lab.driving.trials import (
    DRIVER_SETTINGS,
    NAV2_SETTINGS,
)
from sparse_coord_ros.protocol.lockstep.timeouts import Reminder
from sparse_coord_ros.protocol.wire import RECORDER, WORLD
from sparse_coord_ros.protocol.wire.messages import SECOND
from sparse_coord_ros.protocol.wire.services import Service
from sparse_coord_ros.ros.nodes.direct_recording import (
    DirectRecording,
    DirectTopic,
    PackedPublisher,
)
from sparse_coord_ros.ros.nodes.ros_messages import status
from sparse_coord_ros.ros.nodes.ros_topics import (
    DIAGNOSTICS,
    RUN,
    RosTopic,
    kept_qos,
    message_class,
)
from sparse_coord_ros.ros.nodes.ros_topics import RECORDING as RECORDING_TOPIC
from sparse_coord_ros.ros.nodes.subscriber import Subscriber
from sparse_coord_ros.show.page.controls import PAGE_SETTINGS

RCLError = rclpy_implementation.RCLError

FROM_TF = "tf"
"""The `pose_type` for poses from transforms instead of pose messages."""

_OWN = tables_from_yaml(Path(__file__).with_name("parameters.yaml"))
_MORE: Mapping[str, Mapping[str, Setting]] = {
    WORLD: {
        **RUN_SETTINGS,
        "learner": replace(RUN_SETTINGS["learner"], kind=LIVE_LEARNER),
    },
    "driver": DRIVER_SETTINGS,
    "nav2_driver": NAV2_SETTINGS,
    "body": {"radius": DRIVER_SETTINGS["radius"]},
    "watch": PAGE_SETTINGS,
}
_TEAM = _OWN.pop("team")

PARAMETERS = {
    node: SettingTable({**settings, **_MORE.get(node, {})}.values())
    for node, settings in _OWN.items()
}
"""The parameters of each node that runs alone, by the name of its executable."""

TEAM_PARAMETERS = SettingTable(
    {**PARAMETERS[WORLD], **PARAMETERS["robot"], **_TEAM}.values()
)

ALL_NAMES = (
    *TEAM_PARAMETERS,
    *(
        name
        for node in (RECORDER, "driver", "nav2_driver", "body")
        for name in PARAMETERS[node]
    ),
    *SETTINGS,
)
"""The parameters of all nodes of a team. One file, or a launch file's group, may give them all to
each node, which uses its own ones."""

ROLES = {WORLD: RUN, RECORDER: RECORDING_TOPIC}
"""The topic that a node of each role publishes; it identifies the role whatever the node's
name."""

DISCOVERY_SECONDS = 1.0
"""How long a starting node looks for other nodes."""

ROS_PARAMETERS = ("use_sim_time", "start_type_description_service")
ROS_PARAMETERS_PREFIX = "qos_overrides."


class NodePlace(TypedDict, total=False):
    """The environment in which a node is made.

    Attributes:
        context: the ROS context.
        namespace: the team's namespace.
        values: parameters given by the program; None: those of the command line count.
        direct: the direct way to a recorder in the same process; None: a recorder subscribes.
        shared_clients: those of the robots of this process, by service.
        shared_states: for each robot of this process, those that are handed its states, by name.
    """

    context: Context
    namespace: str
    values: Mapping[str, Any] | None
    direct: DirectRecording | None
    shared_clients: dict[str, Client]
    shared_states: dict[str, dict[str, Callable[[int, int], None]]]


class ParameterNode(Node):
    """A node with parameters from one table, which are checked at once.

    Args:
        name: the node's name unless it is remapped.
        table: its parameters.
        place: where the node is made, and with what.

    Attributes:
        changeable: parameters that can be set while the node runs; all others are read once.
        values: every parameter, typed.
        subscriber: its subscriptions.
        full_name: its name with its namespace, as in diagnostics: `team_a/robot_1`.
        born: the time of the node's beginning, by the monotonic clock.
        direct: the connection to a recorder in the same process, or None.
        shared_clients, shared_states: as of `NodePlace`.
        reminder: times of reminders while the node waits.
        failure: the error that stops the node, or None.
        done: whether the node's work is finished.
        at_end: closes its contents when the node is destroyed, for any reason.

    Raises:
        SettingError: an unknown parameter or a bad value.
    """

    changeable: ClassVar[Collection[str]] = (
        "rate",
        "lost_robot",
        "body_timeout",
        "pose_timeout",
    )

    def __init__(
        self, name: str, table: SettingTable, **place: Unpack[NodePlace]
    ) -> None:
        values = place.get("values")
        given = [Parameter(key, value=value) for key, value in (values or {}).items()]
        try:
            super().__init__(
                name,
                context=place.get("context"),
                namespace=place.get("namespace", ""),
                use_global_arguments=values is None,
                parameter_overrides=given,
            )
        except (RCLError, RuntimeError) as error:
            why = message_of(error)
            raise RunError(f"node {name}: ROS cannot make it: {why}") from None
        self.full_name = self.get_fully_qualified_name().lstrip("/")
        self.born = time.monotonic()
        self.reminder = Reminder()
        self.failure: SparseCoordError | None = None
        self.done = False
        self.at_end = ExitStack()
        self._table = table
        self.direct = place.get("direct")
        self.shared_clients = place.get("shared_clients", {})
        self.shared_states = place.get("shared_states", {})
        self.subscriber = Subscriber(self, self.fail)
        try:
            self.values = self._declare()
            self.set_up()
        except BaseException:
            self.destroy_node()
            raise
        self.add_on_set_parameters_callback(self._check_change)

    def destroy_node(self) -> None:
        """Close `at_end` and destroy the node; its executor may still call it once."""
        self.done = True
        self.at_end.close()
        super().destroy_node()

    def set_up(self) -> None:
        """Check the values, and open the node's resources; on failure, destroy the node."""

    def fail(self, error: SparseCoordError) -> None:
        """Stop the node because of bad input; the loop that spins it raises the error."""
        self.failure = self.failure or error

    def guarded(
        self, callback: Callable[..., Any], drops: str = ""
    ) -> Callable[..., Any]:
        """Return a callback whose exceptions stop this node, which then saves its state.

        On an exception it returns its last argument: for a service, the response. If `drops` is
        given, an exception does not stop the node: it refuses the request, and counts it under
        this name.
        """

        @functools.wraps(callback)
        def wrapped(*args: Any) -> Any:
            try:
                return callback(*args)
            except Exception as error:
                if drops:
                    self.subscriber.drop(drops, error, "request refused")
                else:
                    self.fail(failure_of(error))
                return args[-1] if args else None

        return wrapped

    def create_service(self, srv_type, srv_name, callback, **more):
        """Offer a service, its callback guarded; rclpy's own ones refuse unreadable requests."""
        rclpys = ""
        if srv_type.__module__.startswith("rcl_interfaces."):
            rclpys = srv_name
        return super().create_service(
            srv_type, srv_name, self.guarded(callback, rclpys), **more
        )

    def create_timer(self, timer_period_sec, callback, *args, **more):
        """Make a timer with a guarded callback, on a steady clock: a /clock may stop."""
        more.setdefault("clock", Clock(clock_type=ClockType.STEADY_TIME))
        return super().create_timer(
            timer_period_sec, self.guarded(callback), *args, **more
        )

    def offer(self, service: Service, do: Callable[..., tuple[bool, str]]) -> None:
        """Offer a service of this node's own, of the type std_srvs/Trigger or SetBool.

        Args:
            service: the service.
            do: receives the value of a SetBool; returns whether it succeeded, and a text.
        """

        def answer(request: Any, response: Any) -> Any:
            value = [request.data] if hasattr(request, "data") else []
            response.success, response.message = do(*value)
            return response

        self.create_service(message_class(service.type_name), service.of("~"), answer)

    def looked_around(self, now: float) -> bool:
        """Return whether the node has been there for long enough to have found the others."""
        return now - self.born >= DISCOVERY_SECONDS

    def remind(self, reminder: Reminder, for_whom: str, remedy: str = "") -> None:
        """Log the awaited nodes, and what to do, at growing intervals."""
        waited = reminder.due(time.monotonic())
        if waited:
            advice = f"; {remedy}" if remedy else ""
            self.get_logger().info(f"waiting for {for_whom} ({waited:.0f} s){advice}")

    def finish(self, *, interrupted: bool) -> None:
        """Save, and send the last messages, while ROS still works.

        Args:
            interrupted: whether the node is stopped before it was `done`.
        """

    def may_stop(self) -> bool:
        """Return whether the node can end after a signal; called until it can."""
        return True

    def announce(self, topic: RosTopic, owner: str = "") -> Publisher:
        """Return a new publisher of a topic of the team, or of a robot's or node's own."""
        how: Any = {"publisher_class": PackedPublisher} if topic.packed else {}
        qos = kept_qos(topic) if self.direct is None else topic.qos
        publisher = self.create_publisher(topic.type, topic.of(owner), qos, **how)
        if isinstance(publisher, PackedPublisher):
            publisher.send = publisher.handle.publish_raw
            publisher.direct = (
                DirectTopic()
                if self.direct is None
                else self.direct.topic(publisher.topic_name)
            )
        return publisher

    def reporter(self, part: str) -> Callable[..., None]:
        """Return a function that publishes a part's diagnostics, called as `messages.status`.

        They are stamped with the wall clock, not with /clock, and have no frame.
        """
        publish = self.announce(DIAGNOSTICS).publish
        name = f"{self.full_name}: {part}"

        def report(
            doing: str, values: Mapping[str, object], *, warn: bool = False
        ) -> None:
            sec, nanosec = divmod(time.time_ns(), SECOND)
            message = DiagnosticArray(status=[status(name, doing, values, warn=warn)])
            message.header.stamp = Time(sec=sec, nanosec=nanosec)
            publish(message)

        return report

    def names_of(self, role: str) -> Counter[str]:
        """Return the names of the nodes of a role, each with its number of nodes.

        A robot's role is its name.
        """
        if role not in ROLES:
            return Counter((role,))
        topic = self.resolve_topic_name(ROLES[role].name)
        return Counter(
            info.node_name for info in self.get_publishers_info_by_topic(topic)
        )

    def heard_by(self, publisher: Publisher, role: str) -> bool:
        """Return whether a node of a role subscribes to a topic of this node.

        Bystanders (`ros2 topic echo`, RViz) do not count.
        """
        if role == RECORDER and self.direct is not None:
            if self.direct.closed:
                return True
            if isinstance(publisher, PackedPublisher):
                return publisher.direct.write is not None
        return publisher.get_subscription_count() > 0 and self.is_heard(
            publisher.topic_name, role
        )

    def is_heard(self, topic: str, role: str) -> bool:
        """Return whether a node of a role subscribes; True for a failed recorder of this process.

        All nodes of one name must subscribe: a killed node stays in the graph for 5 s.
        """
        if role == RECORDER and self.direct is not None and self.direct.closed:
            return True
        infos = self.get_subscriptions_info_by_topic(self.resolve_topic_name(topic))
        ears = Counter(info.node_name for info in infos)
        return any(count <= ears[name] for name, count in self.names_of(role).items())

    def _declare(self) -> dict[str, Any]:
        """Declare the parameters, and return their values; all that are given are checked."""
        given = {
            name: parameter.value
            for name, parameter in self._parameter_overrides.items()
            if name not in ROS_PARAMETERS and not name.startswith(ROS_PARAMETERS_PREFIX)
        }
        takes = {**self._table, **(SETTINGS if "scenario" in self._table else {})}
        for name in set(ALL_NAMES) - set(takes):
            given.pop(name, None)  # of other nodes
        parsed = self.parse(SettingTable(takes.values()), given)
        values = {**self._table.defaults(), **parsed}
        allow_modules(values.get("allow", ()))
        rows: list[Any] = [
            (name, values[name], self._descriptor(setting))
            for name, setting in self._table.items()
        ]
        self.declare_parameters("", rows, ignore_override=True)
        return values

    def _descriptor(self, setting: Setting) -> ParameterDescriptor:
        return _descriptor(setting, read_only=setting.name not in self.changeable)

    def parse(
        self, table: SettingTable, values: Mapping[str, object]
    ) -> dict[str, Any]:
        """Return values of parameters, parsed by a table; SettingError: as of `parse`."""
        try:
            return table.parse(values)
        except SettingError as error:
            text = str(error).replace("setting", "parameter", 1)
            raise SettingError(f"node {self.get_name()}: {text}") from None

    def _check_change(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            changed = {p.name: _plain(p) for p in parameters if p.name in self._table}
            self.values.update(self.parse(self._table, changed))
        except SettingError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def show_settings(self, scenario: Scenario) -> None:
        """Declare the settings of a scenario as parameters, for display."""
        for name, setting in SETTINGS.items():
            shown = _as_parameter(getattr(scenario, name))
            descriptor = _descriptor(setting, read_only=True)
            self.declare_parameter(name, shown, descriptor, ignore_override=True)


def _plain(parameter: Parameter) -> Any:
    """Return a parameter's value; rclpy makes arrays of lists of numbers."""
    value = parameter.value
    return list(value) if isinstance(value, array) else value


def of_node(node: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a node's own parameters; of the world, also the scenario's."""
    parameters = {name: values[name] for name in PARAMETERS[node]}
    return {**parameters, **_settings_in(values)} if node == WORLD else parameters


def team_values(values: Mapping[str, object]) -> dict[str, Any]:
    """Return the values of all `TEAM_PARAMETERS`, and the given settings of the scenario.

    Args:
        values: some of both, as texts or typed.

    Raises:
        SettingError: an unknown name or a bad value.
    """
    known = SettingTable([*TEAM_PARAMETERS.values(), *SETTINGS.values()])
    return {**TEAM_PARAMETERS.defaults(), **known.parse(values)}


def _settings_in(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of the scenario among some parameters, as ROS takes them."""
    return {name: _as_parameter(values[name]) for name in SETTINGS if name in values}


def _as_parameter(value: object) -> bool | int | float | str:
    """Return a setting's value as ROS takes it."""
    return value if isinstance(value, bool | int | float) else str(value)


def _descriptor(setting: Setting, *, read_only: bool) -> ParameterDescriptor:
    """Return the description of a parameter; a number's has its range."""
    descriptor = ParameterDescriptor(
        name=setting.name,
        description=setting.help,
        additional_constraints=f"allowed: {setting.allowed}",
        read_only=read_only,
    )
    bounds = (setting.low, setting.high)
    if setting.kind is float:
        # a whole number is a number: `param set rate 20`
        descriptor.dynamic_typing = True
        if all(map(math.isfinite, bounds)):
            low, high = map(float, bounds)
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=low, to_value=high)
            ]
    elif setting.kind is int and all(map(math.isfinite, bounds)):
        low, high = map(int, bounds)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high)]
    return descriptor


def run_from_parameters(values: Mapping[str, Any]) -> RunConfig:
    """Build the run that a world simulator's parameters describe.

    Raises:
        SparseCoordError: of the kind that fits the bad parameter.
    """
    if not values["scenario"]:
        raise SettingError(
            "parameter scenario: none is given; start the node with --ros-args -p "
            f"scenario:=NAME, NAME a scenario file or one of: {', '.join(scenario_names())}"
        )
    scenario = load_scenario(values["scenario"]).with_settings(_settings_in(values))
    allow_named(values["learner"])
    run = make_run(scenario, {name: values[name] for name in RUN_SETTINGS})
    if not run.rule.runs_live:
        raise SettingError(
            f"parameter learner: value is {run.learner!r}, which learns with one robot at a time; "
            f"allowed here: {LIVE_LEARNER.usage}; use "
            f"'sparse_coord train --learner {run.learner}'"
        )
    return run
