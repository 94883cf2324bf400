# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Your own robot in plain rclpy, without learning: it moves at random.

docs/interface.md says what each message means: python own_robot.py --ros-args -r __node:=robot_1
"""

import math
import random
from contextlib import suppress

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
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import String

HEARD = QoSProfile(depth=10)
SAID = QoSProfile(depth=4_000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MOVES = [{"east": 1}, {"east": -1}, {"north": 1}, {"north": -1}]
STEP_SECONDS = 0.1
LABELS = ["east", "north", "coordinate", "peer", "perceived", "percept", "learned"]


class OwnRobot(Node):
    """Answers each local state with an action, and each peer that asks where it is."""

    def __init__(self, **place):
        super().__init__("robot", **place)
        self.run = None
        self.map = None
        self.attempt = None
        self.ears = []
        self.over = False
        self.forget()
        self.name = self.get_name()
        self.action = self.create_publisher(JointState, "~/action", SAID)
        self.progress = self.create_publisher(DiagnosticStatus, "~/_progress", LATCHED)
        self.create_service(GetPlan, "~/active_perception", self.on_asked)
        self.create_subscription(String, "run", self.on_run, LATCHED)
        floor = "world_simulator/map"
        self.create_subscription(OccupancyGrid, floor, self.on_map, LATCHED)
        self.create_subscription(DiagnosticStatus, "status", self.on_status, LATCHED)

    def on_run(self, message):
        """Take part in the first run that is announced."""
        self.run = self.run or yaml.safe_load(message.data)

    def on_map(self, message):
        """Keep how large cells are, and where."""
        self.map = message.info

    def on_status(self, message):
        """Begin when the world orders it, and end with the run."""
        values = {entry.key: entry.value for entry in message.values}
        if not self.run or not self.map or values["run"] != self.run["id"]:
            return
        if self.attempt is None:  # an attempt that is under way is for the others
            self.attempt = values["attempt"]
            self.report("")
        heard_by = self.action.get_subscription_count()
        if values["attempt"] != self.attempt and heard_by > self.run["recorded"]:
            self.attempt = values["attempt"]
            self.forget()
            self.transitions = int(values["transitions"])
            self.listen()
            self.report(self.attempt)
        self.over = message.message in ("finished", "stopped")

    def report(self, attempt):
        """Tell the world that this robot can begin anywhere, and which attempt it has begun."""
        values = [KeyValue(key="checkpoints"), KeyValue(key="attempt", value=attempt)]
        self.progress.publish(DiagnosticStatus(values=values))

    def forget(self):
        """Begin where the world begins: nothing has been seen."""
        self.state = PoseStamped()
        self.said = None
        self.step = -1
        self.begun = 0
        self.transitions = 0

    def listen(self):
        """Hear the world from now on: no message from before counts."""
        for ear in self.ears:
            self.destroy_subscription(ear)
        self.ears = [
            self.create_subscription(JointState, "~/reward", self.on_reward, HEARD),
            self.create_subscription(
                PoseStamped, "~/local_state", self.on_state, HEARD
            ),
        ]

    def on_state(self, message):
        """Act in a new state; say the same again where the world says the state again."""
        step = self.step_of(message)
        if step == self.step and self.said:
            self.action.publish(self.said)
        if step > self.step:
            follows = step == self.step + 1
            self.begun = self.begun if follows else step
            self.transitions += follows
            self.step = step
            self.state = message
            self.said = None
        if not self.said and not self.rests():
            self.act(**random.choice(MOVES))

    def step_of(self, message):
        """Return the time step of a message."""
        seconds = 1e-9 * Time.from_msg(message.header.stamp).nanoseconds
        return round(seconds / STEP_SECONDS)

    def cell_of(self, message):
        """Return (row, column) of a pose, from the top left."""
        here = message.pose.position
        corner = self.map.origin.position
        turn = self.map.origin.orientation
        yaw = 2 * math.atan2(turn.z, turn.w)
        x, y = here.x - corner.x, here.y - corner.y
        column = (math.cos(yaw) * x + math.sin(yaw) * y) // self.map.resolution
        row = (math.cos(yaw) * y - math.sin(yaw) * x) // self.map.resolution
        return self.map.height - 1 - int(row), int(column)

    def rests(self):
        """Return whether no action is due: arrived, end of the episode, end of the run."""
        game = self.run["scenario"]
        age = self.step - self.begun
        home = self.cell_of(self.state) == tuple(game["robots"][self.name]["goal"])
        return home or age >= game["max_steps"] or self.transitions >= game["steps"]

    def act(self, **said):
        """Answer the state; omitted values are 0."""
        numbers = [float(said.get(label, 0)) for label in LABELS]
        self.said = JointState(header=self.state.header, name=LABELS, position=numbers)
        self.action.publish(self.said)

    def on_reward(self, message):
        """Learn nothing; a learning robot begins here."""

    def on_asked(self, request, response):
        """Tell a peer of the same time step where this robot is, and a person (stamp 0)."""
        response.plan.header = self.state.header
        if self.step > 0 and self.step_of(request.start) in (self.step, 0):
            response.plan.poses = [self.state]
        return response


def main():
    """Run a robot until its run is over."""
    rclpy.init()
    robot = OwnRobot()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        while not robot.over:
            rclpy.spin_once(robot)
        robot.action.wait_for_all_acked(Duration(seconds=3))  # also by the recorder


if __name__ == "__main__":
    main()
