# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS interface in one place: names, types and QoS of every topic and service.

Names are relative (except /clock and what ROS itself makes absolute), so a whole team moves into
a namespace together. A robot's topics lie under its name.
"""

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from nav_msgs.srv import GetPlan
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String, UInt8MultiArray
from visualization_msgs.msg import MarkerArray

MAP_FRAME = "map"
STEP_DEPTH = 10_000
RECORDER_DEPTH = 10_000


def _qos(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE) -> QoSProfile:
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=durability,
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
    )


STEP_QOS = _qos(STEP_DEPTH)
"""Reliable, volatile. The lock step needs a depth of 2; the rest is for a recorder that lags."""

EVENT_QOS = _qos(10)
"""Reliable, volatile, for what comes seldom."""

LATCHED_QOS = _qos(1, DurabilityPolicy.TRANSIENT_LOCAL)
"""Reliable, transient local: a late subscriber gets the last message."""

TABLES_QOS = _qos(10, DurabilityPolicy.TRANSIENT_LOCAL)
"""As `LATCHED_QOS`, with those before, for a recorder that is to get all of them."""

RECORDER_QOS = _qos(RECORDER_DEPTH)
RECORDER_LATCHED_QOS = _qos(RECORDER_DEPTH, DurabilityPolicy.TRANSIENT_LOCAL)
"""What the recorder asks for: on its side nothing is overwritten before it is written down."""


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: relative to the team's namespace, or to the robot's name.
        type: message class.
        qos: the publisher's profile.
        stamped: the message begins with its time (a header or a clock), that of the run.
    """

    name: str
    type: type
    qos: QoSProfile
    stamped: bool = False

    def of(self, robot: str) -> str:
        """Return the topic's name below a robot's name; `~` is the node's own."""
        return f"{robot}/{self.name}"


RUN = Topic("run", String, LATCHED_QOS)
STATUS = Topic("status", DiagnosticStatus, LATCHED_QOS)
CLOCK = Topic("/clock", Clock, STEP_QOS, stamped=True)
MAP = Topic("map", OccupancyGrid, LATCHED_QOS, stamped=True)
MARKERS = Topic("markers", MarkerArray, LATCHED_QOS)
DIAGNOSTICS = Topic("diagnostics", DiagnosticArray, EVENT_QOS)
"""Drivers and aggregators publish here too, with stamps of other clocks."""

LOCAL_STATE = Topic("local_state", PoseStamped, STEP_QOS, stamped=True)
REWARD = Topic("reward", JointState, STEP_QOS, stamped=True)
ACTION = Topic("action", JointState, STEP_QOS, stamped=True)
PERCEPT = Topic("percept", Path, STEP_QOS, stamped=True)
COORDINATION_MAP = Topic("coordination_map", OccupancyGrid, LATCHED_QOS, stamped=True)

TABLES = Topic("tables", UInt8MultiArray, TABLES_QOS)
"""Of a robot, as the bytes of an .npz file; the recorder attaches them to the bag."""

TEAM_TOPICS = (RUN, STATUS, CLOCK, MAP, MARKERS, DIAGNOSTICS)
ROBOT_TOPICS = (LOCAL_STATE, REWARD, ACTION, PERCEPT, COORDINATION_MAP)

TAPPED_TOPICS = (CLOCK, LOCAL_STATE, REWARD, ACTION, MAP, MARKERS, COORDINATION_MAP)
"""What nodes hand to a recorder in their own process: what each time step and episode says."""

CLAIM = Topic("claim", Header, LATCHED_QOS)
"""Of the world and of every robot, below its name: since when (wall clock) the node has it."""

CLAIMS_QOS = _qos(100, DurabilityPolicy.TRANSIENT_LOCAL)
"""For reading claims: with a depth of 1, one's own would push out that of another node."""

ACTIVE_PERCEPTION = "active_perception"
ACTIVE_PERCEPTION_TYPE = GetPlan
SERVICE_EVENTS = Topic(f"{ACTIVE_PERCEPTION}/_service_event", GetPlan.Event, STEP_QOS)
"""What rclpy publishes of the requests to a robot and of its answers."""

INITIAL, CHECKPOINT, FINAL = "initial", "checkpoint", "final"
"""Occasions on which a robot publishes its tables."""

WAITING, LEARNING, PAUSED, FINISHED, STOPPED = (
    "waiting",
    "learning",
    "paused",
    "finished",
    "stopped",
)
"""The states that `status` can name."""
