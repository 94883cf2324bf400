# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot of one's own in plain rclpy, which learns nothing: it moves at random.

Written from docs/interface.md: python own_robot.py --ros-args -r __node:=robot_1
"""

import random
import uuid

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetPlan
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState
from sensor_msgs.msg import JointState
from std_msgs.msg import String

STEP = QoSProfile(depth=10_000)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MOVES = [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)]  # (east, north)
LABELS = ["east", "north", "coordinate", "peer", "perceived", "percept", "learned"]


class OwnRobot(Node):
    """Answers each local state with an action, and each peer that asks where it is."""

    def __init__(self, **place):
        super().__init__("robot", **place)
        self.name, self.life = self.get_name(), uuid.uuid4().hex
        self.run, self.map, self.over = None, None, False
        self.step, self.state, self.said = -1, PoseStamped(), None
        self.begun, self.transitions, self.obeyed = 0, 0, ""
        self.action = self.create_publisher(JointState, f"{self.name}/action", STEP)
        self.progress = self.create_publisher(DiagnosticStatus, f"{self.name}/_progress", LATCHED)
        service = self.create_service(GetPlan, f"{self.name}/active_perception", self.on_asked)
        service.configure_introspection(self.get_clock(), STEP, ServiceIntrospectionState.CONTENTS)
        self.create_subscription(String, "run", self.on_run, LATCHED)
        self.create_subscription(OccupancyGrid, "map", self.on_map, LATCHED)
        self.create_subscription(DiagnosticStatus, "status", self.on_status, LATCHED)
        self.joining = self.create_timer(0.02, self.join_when_heard)

    def on_run(self, message):
        """Take part in the first run that is announced."""
        self.run = self.run or yaml.safe_load(message.data)

    def on_map(self, message):
        """Keep how large cells are, and where."""
        self.map = message.info

    def join_when_heard(self):
        """Listen when the world hears this robot, and the recorder if there is to be one."""
        if self.run and self.map and self.action.get_subscription_count() > self.run["recorded"]:
            self.joining.cancel()
            self.listen()
            self.say_progress()

    def listen(self):
        """Hear the world from now on; without this the world does not begin."""
        self.ears = [
            self.create_subscription(JointState, f"{self.name}/reward", self.on_reward, STEP),
            self.create_subscription(PoseStamped, f"{self.name}/local_state", self.on_state, STEP),
        ]

    def step_of(self, message):
        """Return the time step of a message."""
        stamp = message.header.stamp
        return round((stamp.sec + 1e-9 * stamp.nanosec) / self.run["step_period"])

    def cell_of(self, pose):
        """Return (row, column) of a pose, from the top left."""
        corner, side = self.map.origin.position, self.map.resolution
        east, north = pose.pose.position.x - corner.x, pose.pose.position.y - corner.y
        return [self.map.height - 1 - int(north // side), int(east // side)]

    def on_state(self, message):
        """Act where an action is due; say it again where the world says the state again."""
        step = self.step_of(message)
        if step == self.step and self.said is not None:
            self.action.publish(self.said)
        if step > self.step:
            follows = self.step >= 0 and step == self.step + 1
            self.transitions += follows
            self.begun = self.begun if follows else step
            self.step, self.state, self.said = step, message, None
            self.work_off()

    def rests(self):
        """Return whether no action is due: arrived, end of the episode, end of the run."""
        scenario = self.run["scenario"]
        return (
            self.cell_of(self.state) == scenario["robots"][self.name]["goal"]
            or self.step - self.begun >= scenario["max_steps"]
            or self.transitions >= scenario["steps"]
        )

    def work_off(self):
        """Act on a new state, if an action is due."""
        if not self.rests():
            self.act(random.choice(MOVES))

    def act(self, move, *, coordinate=0, peer=0, perceived=0, percept=0, learned=0):
        """Answer the state."""
        numbers = [*move, *map(float, (coordinate, peer, perceived, percept, learned))]
        self.said = JointState(header=self.state.header, name=LABELS, position=numbers)
        self.action.publish(self.said)

    def on_reward(self, message):
        """Learn nothing."""

    def on_asked(self, request, response):
        """Tell a peer of the same time step where this robot is, and a person (stamp 0)."""
        response.plan.header = self.state.header
        stamp = request.start.header.stamp
        if stamp in (self.state.header.stamp, type(stamp)()) and self.state.header.frame_id:
            response.plan.poses = [self.state]
        return response

    def on_status(self, message):
        """Obey an order, and end with the run."""
        values = {one.key: one.value for one in message.values}
        if self.run and values["run"] == self.run["id"]:
            name, *order = values["rollback"].split() or [""]
            if name not in ("", self.obeyed):
                self.obey(name, *map(int, order))
            self.over = message.message in ("finished", "stopped")

    def obey(self, name, step, first):
        """Say where this robot is; it keeps no checkpoints, so it is asked for no more."""
        self.obeyed = name
        self.say_progress()

    def say_progress(self, checkpoints=""):
        """Say where this robot is, and to which time steps it can go back."""
        said = {"life": self.life, "step": max(self.step, 0), "transitions": self.transitions}
        said |= {"checkpoints": checkpoints, "obeyed": self.obeyed, "resumed": 0}
        values = [KeyValue(key=key, value=str(value)) for key, value in said.items()]
        self.progress.publish(DiagnosticStatus(message="progress", values=values))


def main(kind=OwnRobot):
    """Run a robot until its run is over."""
    rclpy.init()
    robot = kind()
    try:
        while not robot.over:
            rclpy.spin_once(robot)
    except (KeyboardInterrupt, ExternalShutdownException):
        return
    robot.action.wait_for_all_acked(Duration(seconds=3))  # also by the recorder
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
