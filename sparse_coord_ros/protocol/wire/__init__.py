# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The vocabulary of the messages, without ROS: topics, services, labels and states, each once.

`TOPICS` is the table of all messages: the owner, the type, the labels of the numbers, the delivery
and the recording. `messages.py` packs and reads by it, `ros/nodes/ros_topics.py` binds it to
message classes and QoS profiles; the recorder and the log follow it. Topic names are relative: a
team's to its namespace, a robot's to its own name; topics that ROS shares are absolute.
Names of internal topics begin with an underscore: `ros2 topic list` hides them.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import NamedTuple

from sparse_coord_ros.base import palette


class Owner(StrEnum):
    """The owner of a topic: the team, or each robot."""

    TEAM = "team"
    ROBOT = "robot"


class Delivery(StrEnum):
    """The quality of service of a topic.

    At every time step; now and then; the last message is kept for late subscribers; the last
    `TABLES_DEPTH` are kept.
    """

    STEP = "step"
    EVENT = "event"
    LATCHED = "latched"
    TABLES = "tables"


TABLES_DEPTH = 10
"""The world waits for a recorder before it is further behind: it misses no tables."""


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: relative to the team's namespace, or to the robot's name.
        type_name: the message's type, such as `std_msgs/msg/String`.
        owner: its owner.
        delivery: its quality of service.
        packed: published as packed bytes, and handed to a recorder in the same process: the
            messages of each time step and episode.
        recorded: whether bags contain it unchanged.
        labels: the names of the numbers of a sensor_msgs/JointState, in this order; the log reads
            no others.
    """

    name: str
    type_name: str
    owner: Owner
    delivery: Delivery
    packed: bool = False
    recorded: bool = True
    labels: tuple[str, ...] = ()

    def of(self, owner: str) -> str:
        """Return the topic's name below a robot's name; "": the team's."""
        return f"{owner}/{self.name}" if owner else self.name

    @property
    def stamped(self) -> bool:
        """True if the message begins with its time (a header or a clock), in the run's time."""
        return self.type_name in (_CLOCK, _POSE, _NUMBERS, _GRID, _PATH, _ODOMETRY)

    def column(self, label: str) -> int:
        """Return the index of a label among the numbers."""
        return self.labels.index(label)


class PerceptEnd(IntEnum):
    """The end of an action's percept.

    The action is not COORDINATE; every asked peer answered; a peer refused, or was at a later
    step; no answer came by the deadline; there is no peer.
    """

    DID_NOT_ASK = 0
    ANSWERED = 1
    REFUSED = 2
    LATE = 3
    NOBODY_TO_ASK = 4

    @property
    def words(self) -> str:
        """The same in words."""
        return self.name.lower().replace("_", " ")

    @property
    def outcome(self) -> str:
        """Its display on pictures and pages: `palette.ANSWERED`, `REFUSED` or `FAILED`."""
        shown = {
            PerceptEnd.ANSWERED: palette.ANSWERED,
            PerceptEnd.REFUSED: palette.REFUSED,
        }
        return shown.get(self, palette.FAILED)

    @classmethod
    def from_number(cls, number: float) -> "PerceptEnd | None":
        """Return the end for a number in a message; None: an unknown number."""
        return next((end for end in cls if end == number), None)

    @classmethod
    def untold(cls, *, perceived: bool, peers: int) -> "PerceptEnd":
        """Return the outcome of a percept without a deadline: in one process no answer is late."""
        return (
            cls.ANSWERED if perceived else cls.REFUSED if peers else cls.NOBODY_TO_ASK
        )


class SelfReport(NamedTuple):
    """A robot's report on itself in its `action`, beside the action; the fields are labels.

    Attributes:
        percept: the end of its percept, a `PerceptEnd`.
        learned: whether it has learned from its action before this one.
    """

    percept: int
    learned: bool


ACTION_LABELS = ("east", "north", "coordinate", "peer", "perceived")
"""Labels of the numbers of an action in `action`; the fields of `SelfReport` follow them."""

TEAM, ROBOT = Owner
_STEP, _EVENT, _LATCHED, _TABLES = Delivery
_STRING = "std_msgs/msg/String"
_STATUS = "diagnostic_msgs/msg/DiagnosticStatus"
_POSE = "geometry_msgs/msg/PoseStamped"
_NUMBERS = "sensor_msgs/msg/JointState"
_GRID = "nav_msgs/msg/OccupancyGrid"
_MARKERS = "visualization_msgs/msg/MarkerArray"
_CLOCK = "rosgraph_msgs/msg/Clock"
_PATH = "nav_msgs/msg/Path"
_ODOMETRY = "nav_msgs/msg/Odometry"
_REPORT = "diagnostic_msgs/msg/DiagnosticArray"
_BYTES = "std_msgs/msg/UInt8MultiArray"
_ROSOUT = "rcl_interfaces/msg/Log"
_PARAMETERS = "rcl_interfaces/msg/ParameterEvent"

RUN = Topic("run", _STRING, TEAM, _LATCHED)
STATUS = Topic("status", _STATUS, TEAM, _LATCHED)
CLOCK = Topic("clock", _CLOCK, TEAM, _STEP, packed=True)
"""Of a run whose `clock` is own. Outside any namespace this is /clock, which nodes with
`use_sim_time` follow."""

WORLD = "world_simulator"
RECORDER = "recorder"
"""Roles, and the names of their nodes unless they are renamed. The world is the node that
announces `run`, a recorder a node that publishes `_recording`; a robot's node has the robot's
name."""

MAP = Topic(f"{WORLD}/map", _GRID, TEAM, _LATCHED, packed=True)
MARKERS = Topic(f"{WORLD}/markers", _MARKERS, TEAM, _LATCHED)
SCENE = Topic(f"{WORLD}/scene", _MARKERS, TEAM, _LATCHED, recorded=False)
"""For people only: doorways and goals; robots with their names, questions, robots in doorways.
They lie below the world's name, as the robots' network may have a /map and a /markers."""

DIAGNOSTICS = Topic("/diagnostics", _REPORT, TEAM, _EVENT)
"""Absolute, by REP 107, so that an aggregator receives every team; drivers and other teams publish
here too. The stamps are of the wall clock, without a frame."""

LOCAL_STATE = Topic("local_state", _POSE, ROBOT, _STEP, packed=True)
REWARD_LABELS = ("individual", "common", "ask_cost", "total", "partners")
"""The parts of R_k(t) and their sum; and the sum of 2^(j-1) over the robots j (from 1) with which
the robot interacted."""

REWARD = Topic("reward", _NUMBERS, ROBOT, _STEP, packed=True, labels=REWARD_LABELS)
ACTION = Topic(
    *("action", _NUMBERS, ROBOT, _STEP),
    packed=True,
    labels=(*ACTION_LABELS, *SelfReport._fields),
)
PERCEPT = Topic("percept", _PATH, ROBOT, _STEP, packed=True)
COORDINATION_MAP = Topic(*("coordination_map", _GRID, ROBOT, _LATCHED), packed=True)
PROGRESS = Topic("_progress", _STATUS, ROBOT, _LATCHED, recorded=False)
"""A report of a robot or the recorder on its checkpoints, and on the attempt that it has begun."""

TABLES = Topic("tables", _BYTES, ROBOT, _TABLES)
"""A robot's tables, as the bytes of an .npz file."""

RECORDING = Topic("_recording", _STRING, TEAM, _LATCHED, recorded=False)
"""The directory of a recorder's bag."""

BODY_GOALS = Topic(
    *("goals", _NUMBERS, TEAM, _LATCHED),
    recorded=False,
    labels=("number", "place", "since"),
)
"""The goals of bodies; see `protocol.lockstep.bodies`. After its own numbers come, for each robot
with a goal, `GOAL_LABELS` below the robot's name: `robot_1/from`, `robot_1/to`, cells."""

GOAL_LABELS = ("from", "to")

REACHED_LABELS = ("number", "cell", "there", "seconds", "stamp")
REACHED = Topic(
    "reached", _NUMBERS, ROBOT, _EVENT, recorded=False, labels=REACHED_LABELS
)
"""A driver's report of the body's cell at the end of its goal; cell -1: in none."""

POSE = Topic("pose", _POSE, ROBOT, _STEP, recorded=False)
ODOMETRY = Topic("odom", _ODOMETRY, ROBOT, _STEP, recorded=False)
CMD_VEL = Topic("cmd_vel", "geometry_msgs/msg/Twist", ROBOT, _EVENT, recorded=False)
"""Topics of bodies: their poses by their localisation and by their wheels; their commands."""

ROSOUT = Topic("/rosout", _ROSOUT, TEAM, _EVENT)
PARAMETER_EVENTS = Topic("/parameter_events", _PARAMETERS, TEAM, _EVENT)

TOPICS = tuple(item for item in list(globals().values()) if isinstance(item, Topic))
"""All topics, in the order above."""

MAP_FRAME = "map"

DOORWAYS = "doorways"
GOALS = "goals"
ROBOTS = "robots"
"""The namespaces of the markers."""

ROBOT_NAMES = "names"
QUESTIONS = "questions"
WORDS = "words"
OCCUPANCY = "occupancy"
"""The namespaces of the scene's markers: texts over the robots, lines from an asking robot to the
asked one, the outcome in words, boxes over the doorways."""

COUNTS = ("answered", "refused", "late", "repeated", "dropped", "learned", "step")
"""The numbers stored beside a robot's tables: percepts by their ends; requests repeated as the
peer was behind; transitions without learning as no reward came; updates; the time step of the
tables."""


class RunState(StrEnum):
    """The states of a run that `status` can name."""

    WAITING = "waiting"
    RESUMING = "resuming"
    LEARNING = "learning"
    GREEDY = "acting greedily"
    PAUSED = "paused"
    FINISHED = "finished"
    STOPPED = "stopped"


OVER = (RunState.FINISHED, RunState.STOPPED)
"""The states after which a world publishes no other."""


class StartReason(StrEnum):
    """Why an episode began, in `status`.

    It is the run's first; all robots had arrived; `max_steps` were used up; a user requested it;
    the world had no robot left to wait for.
    """

    START = "start"
    ARRIVED = "arrived"
    STEPS = "steps"
    RESET = "reset"
    NOBODY_LEFT = "nobody"


class Occasion(StrEnum):
    """The occasion on which a robot publishes its tables."""

    BEGIN = "begin"
    CHECKPOINT = "checkpoint"
    FINAL = "final"
