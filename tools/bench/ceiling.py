# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ceiling: bare rclpy nodes that pass a team's messages in lock step and do nothing else.

Same topics, types, QoS and sizes as a run of env1; the bytes are made once and never read; every
robot asks its peer at a tenth of the steps. No learning, no recording, no deadlines.
"""

import select
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack

from nav_msgs.srv import GetPlan
from rclpy.context import Context
from rclpy.node import Node
from rclpy.publisher import Publisher

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.wire import SelfReport, services
from sparse_coord_ros.protocol.wire.messages import CLOCK_FORM
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.environment import one_host
from sparse_coord_ros.ros.nodes.messages import Converter
from sparse_coord_ros.ros.nodes.spin import ros_context, spin_nodes

ROBOTS = ("robot_1", "robot_2")
ASK_EVERY = 10
CONVERT = Converter(make_run(load_scenario("env1"), {}))


def listen(
    node: Node, topic: ros_topics.RosTopic, robot: str, then: Callable[[bytes], None]
) -> None:
    """Subscribe to a robot's topic; messages are handed on as bytes."""
    node.create_subscription(topic.type, topic.of(robot), then, topic.qos, raw=True)


def publisher(node: Node, topic: ros_topics.RosTopic, robot: str = "") -> Publisher:
    """Return a publisher of a robot's topic, or of one that all share."""
    return node.create_publisher(
        topic.type, topic.of(robot) if robot else topic.name, topic.qos
    )


class BareWorld(Node):
    """Publishes clock, rewards and states as soon as every robot has acted, `steps` times."""

    def __init__(self, context: Context, steps: int) -> None:
        super().__init__("bare_world", context=context)
        self._left = steps
        self._acted = 0
        self.started = 0.0
        self.seconds = 0.0
        reward = CONVERT.pack_reward(1, Reward(0, 0, 0, 0))
        state = CONVERT.pack_state(1, 0)
        self._messages = [
            (publisher(self, ros_topics.CLOCK), CLOCK_FORM.layout.pack(1, 0))
        ]
        for robot in ROBOTS:
            self._messages.append((publisher(self, ros_topics.REWARD, robot), reward))
            self._messages.append(
                (publisher(self, ros_topics.LOCAL_STATE, robot), state)
            )
            listen(self, ros_topics.ACTION, robot, self._on_action)
        self.create_timer(0.02, self._start)

    @property
    def done(self) -> bool:
        """Whether all steps are made."""
        return self.seconds > 0

    def _start(self) -> None:
        actions = [
            self.count_publishers(ros_topics.ACTION.of(robot)) for robot in ROBOTS
        ]
        listeners = [one.get_subscription_count() for one, _ in self._messages[1:]]
        if not self.started and all(actions) and all(listeners):
            self.started = time.perf_counter()
            self._publish()

    def _on_action(self, data: bytes) -> None:
        self._acted += 1
        if self._acted == len(ROBOTS):
            self._acted = 0
            self._left -= 1
            if self._left > 0:
                self._publish()
            else:
                self.seconds = time.perf_counter() - self.started

    def _publish(self) -> None:
        for one, data in self._messages:
            one.publish(data)


class BareRobot(Node):
    """Answers every state with an action, every tenth after asking its peer."""

    def __init__(self, context: Context, number: int) -> None:
        name = ROBOTS[number]
        peer = ROBOTS[1 - number]
        super().__init__(name, context=context)
        self._count = 0
        self._action = CONVERT.pack_action(
            1, Action(0, False, -1, False), SelfReport(0, False)
        )
        self._publisher = publisher(self, ros_topics.ACTION, name)
        self._path = CONVERT.path(1, (0,))
        self.create_service(
            GetPlan, services.ACTIVE_PERCEPTION.of(name), self._on_asked
        )
        self._client = self.create_client(GetPlan, services.ACTIVE_PERCEPTION.of(peer))
        self._request = GetPlan.Request()
        self._timer = self.create_timer(0.02, self._start)

    def _start(self) -> None:
        if self._client.service_is_ready() and self._publisher.get_subscription_count():
            self.destroy_timer(self._timer)
            listen(self, ros_topics.REWARD, self.get_name(), lambda data: None)
            listen(self, ros_topics.LOCAL_STATE, self.get_name(), self._on_state)

    def _on_state(self, data: bytes) -> None:
        self._count += 1
        if self._count % ASK_EVERY:
            self._publisher.publish(self._action)
        else:
            future = self._client.call_async(self._request)
            future.add_done_callback(lambda _: self._publisher.publish(self._action))

    def _on_asked(self, request, response):
        response.plan = self._path
        return response


def one_process(steps: int) -> float:
    """Return the bare steps a second with all nodes in this process, on the events executor."""
    with ros_context() as context:
        world = BareWorld(context, steps)
        nodes = [world, *(BareRobot(context, number) for number in range(len(ROBOTS)))]
        try:
            spin_nodes(nodes, context, lambda: world.done)
        finally:
            for node in nodes:
                node.destroy_node()
    return steps / world.seconds


def separate_processes(steps: int) -> float:
    """Return the bare steps a second with every node in its own process."""
    command = [sys.executable, "-m", "tools.bench.ceiling"]
    with ExitStack() as robots:  # at its end closes their standard input, and waits
        for number in range(len(ROBOTS)):
            robot = [*command, "robot", str(number)]
            robots.enter_context(
                subprocess.Popen(robot, stdin=subprocess.PIPE, env=one_host())
            )
        return float(
            subprocess.check_output([*command, "world", str(steps)], env=one_host())
        )


def main() -> int:
    """Run one bare node as a process: `robot NUMBER`, or `world STEPS`, which prints the rate."""
    role = sys.argv[1]
    number = int(sys.argv[2])
    with ros_context() as context:
        node: Node
        if role == "robot":
            node = BareRobot(context, number)
            spin_nodes([node], context, _stdin_closed)
        else:
            node = world = BareWorld(context, number)
            spin_nodes([node], context, lambda: world.done)
            print(number / world.seconds)
        node.destroy_node()
    return 0


def _stdin_closed() -> bool:
    """Return whether the starter has closed standard input: the world is done."""
    return bool(select.select([sys.stdin], [], [], 0)[0])


if __name__ == "__main__":
    sys.exit(main())
