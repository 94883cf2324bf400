# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The vocabulary of the wire, without ROS: names, types, labels and states, each said once.

The nodes bind these to message classes and QoS profiles (`nodes/interface.py`); recording and
run log read bags by them. Topic names are relative: a team's to its namespace, a robot's to its
own name; /clock and what ROS shares among all nodes are absolute.
"""

from dataclasses import dataclass

TEAM, ROBOT, NODE = "team", "robot", "node"
"""Whose a topic is: one of the team, one of each robot, one of each world or robot node."""

STEP, EVENT, LATCHED, TABLES_KEPT = "step", "event", "latched", "tables"
"""How a topic is published: at every time step; now and then; its last message is kept for late
subscribers; its last `TABLES_DEPTH` are kept."""

TABLES_DEPTH = 10
"""A recorder that lags further behind misses tables of checkpoints."""


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: relative to the team's namespace, or to the robot's or node's name.
        type_name: the message's type, such as `std_msgs/msg/String`.
        owner: TEAM, ROBOT or NODE.
        delivery: STEP, EVENT, LATCHED or TABLES_KEPT.
        stamped: the message begins with its time (a header or a clock), that of the run.
        tapped: published as packed bytes, and handed to a recorder in the same process: what
            each time step and episode says.
    """

    name: str
    type_name: str
    owner: str
    delivery: str
    stamped: bool = False
    tapped: bool = False

    def of(self, owner: str) -> str:
        """Return the topic's name below a robot's name; `~` is the node's own."""
        return f"{owner}/{self.name}"


RUN = Topic("run", "std_msgs/msg/String", TEAM, LATCHED)
STATUS = Topic("status", "diagnostic_msgs/msg/DiagnosticStatus", TEAM, LATCHED)
CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock", TEAM, STEP, stamped=True, tapped=True)
MAP = Topic("map", "nav_msgs/msg/OccupancyGrid", TEAM, LATCHED, stamped=True, tapped=True)
MARKERS = Topic("markers", "visualization_msgs/msg/MarkerArray", TEAM, LATCHED, tapped=True)
SCENE = Topic("scene", "visualization_msgs/msg/MarkerArray", TEAM, LATCHED)
"""For people only: names of robots, who asks whom, how full doorways are."""

DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", TEAM, EVENT)
"""Absolute, as REP 107 has it, so that an aggregator hears every team; drivers and other teams
publish here too, with stamps of other clocks."""

LOCAL_STATE = Topic(
    "local_state", "geometry_msgs/msg/PoseStamped", ROBOT, STEP, stamped=True, tapped=True
)
REWARD = Topic("reward", "sensor_msgs/msg/JointState", ROBOT, STEP, stamped=True, tapped=True)
ACTION = Topic("action", "sensor_msgs/msg/JointState", ROBOT, STEP, stamped=True, tapped=True)
PERCEPT = Topic("percept", "nav_msgs/msg/Path", ROBOT, STEP, stamped=True)
COORDINATION_MAP = Topic(
    "coordination_map", "nav_msgs/msg/OccupancyGrid", ROBOT, LATCHED, stamped=True, tapped=True
)
PROGRESS = Topic("progress", "diagnostic_msgs/msg/DiagnosticStatus", ROBOT, LATCHED)
"""What a robot says of its checkpoints, and the recorder of the orders that it has seen."""
TABLES = Topic("tables", "std_msgs/msg/UInt8MultiArray", ROBOT, TABLES_KEPT)
"""Of a robot, as the bytes of an .npz file; the recorder attaches them to the bag."""

TABLES_FOLDER = "tables/"
"""What the names of a bag's attached tables begin with."""


def tables_attachment(robot: str, step: int | str) -> str:
    """Return what a robot's tables of a time step are called as an attachment of a bag."""
    return f"{TABLES_FOLDER}{robot}_{step}.npz"


CLAIM = Topic("claim", "std_msgs/msg/Header", NODE, LATCHED)
"""Of the world and of every robot: `frame_id` is what the node is called by nobody else, and how
far it has come: one of `CLAIM_RANKS`. The stamp (wall clock, since when) is for people only."""

CLAIM_RANKS = ("starting", "holding", "joined")
"""How far a node of a name has come: it looks whether the name is taken; it has the name; it
takes part in a run. Whoever has come further keeps the name."""

ACTIVE_PERCEPTION = "active_perception"
ACTIVE_PERCEPTION_TYPE = "nav_msgs/srv/GetPlan"
SERVICE_EVENTS = Topic(
    f"{ACTIVE_PERCEPTION}/_service_event", "nav_msgs/srv/GetPlan_Event", ROBOT, STEP
)
"""What rclpy publishes of the requests to a robot and of its answers."""

BODY_GOALS = Topic("goals", "sensor_msgs/msg/JointState", TEAM, LATCHED, stamped=True)
"""Where bodies are to go, of a world with bodies; see `lockstep.bodies`."""

REACHED = Topic("reached", "sensor_msgs/msg/JointState", ROBOT, EVENT, stamped=True)
"""Of a robot's driver: where the body is when its goal is over."""

POSE = Topic("pose", "geometry_msgs/msg/PoseStamped", ROBOT, STEP, stamped=True)
ODOMETRY = Topic("odom", "nav_msgs/msg/Odometry", ROBOT, STEP, stamped=True)
CMD_VEL = Topic("cmd_vel", "geometry_msgs/msg/Twist", ROBOT, EVENT)
"""Of bodies: where they are, by their localisation and by their wheels; what they are to do."""

ROSOUT = Topic("/rosout", "rcl_interfaces/msg/Log", TEAM, EVENT)
PARAMETER_EVENTS = Topic("/parameter_events", "rcl_interfaces/msg/ParameterEvent", TEAM, EVENT)

TEAM_TOPICS = (RUN, STATUS, CLOCK, MAP, MARKERS, SCENE, DIAGNOSTICS)
ROBOT_TOPICS = (LOCAL_STATE, REWARD, ACTION, PERCEPT, COORDINATION_MAP, PROGRESS)

SAVE, PAUSE, RESET = "~/save", "~/pause", "~/reset"
"""Services of a robot and of the world."""

WORLD, RECORDER = "world_simulator", "recorder"
"""Roles, and what their nodes are called unless they are renamed: the world is who announces
`run`, a recorder who publishes `recording`; a robot's node has the robot's name."""

RECORDING = Topic("recording", "std_msgs/msg/String", TEAM, LATCHED)
"""Where a recorder writes: the bag's directory."""

MAP_FRAME = "map"

DOORWAYS, GOALS, ROBOTS = "doorways", "goals", "robots"
"""The namespaces of the markers."""

ROBOT_NAMES, QUESTIONS, WORDS, OCCUPANCY = "names", "questions", "words", "occupancy"
"""The namespaces of the scene's markers: texts over the robots, lines from who asks to whom, what
came of it in words, boxes over the doorways."""

REWARD_LABELS = ("individual", "common", "ask_cost", "total")
"""What the numbers of a reward are called in its message."""

PARTNERS_LABEL = "partners"
"""What follows them where the world has a `referee`: the sum of 2^(j-1) of the robots j (from 1)
with which the robot was in the miscoordination."""

ACTION_LABELS = ("east", "north", "coordinate", "peer", "perceived")
"""What the numbers of an action are called in its message."""

BODY_GOALS_LABELS = ("number", "place", "since")
GOAL_LABELS = ("from", "to")
"""What the numbers of goals are called in its message: first of all, then for each robot that
it tells something the cells, below the robot's name: `robot_1/from`, `robot_1/to`."""

REACHED_LABELS = ("number", "cell", "there", "seconds", "stamp")
"""What the numbers of a driver's report are called in its message; cell -1: in none."""

ACCOUNT_LABELS = ("percept", "learned")
"""What the robot says of itself in the same message, after the action: how the percept ended, one
of the five below; and 1 if it has learned from its action before this one, else 0. In bags of
format 1 actions lack them."""

NOT_ASKED, ANSWERED, REFUSED, LATE, NOBODY_TO_ASK = range(5)
PERCEPT_ENDS = ("did not ask", "answered", "refused", "late", "nobody to ask")
"""How the percept of an action ended: the action is no COORDINATE; every peer answered where it
is; a peer refused, or was further; no answer came by the deadline; there is no peer."""

STATUS_VALUES = ("step", "transitions", "left_out", "began")
"""What `status` says beside its state: the time step; transitions made; for how many (robot, step)
the world made a transition without the robot, though it had not arrived; why the episode began."""

RUN_ID = "run"
"""What `status` calls the identity of the world's run, which `run.yaml` gives as `id`."""

ROLLBACK = "rollback"
"""What `status` calls the order to go back that stands: its name, the checkpoint's step and the
step of the first local state after it; empty where there is none."""

START, ARRIVED, STEPS, RESET, NOBODY_LEFT = "start", "arrived", "steps", "reset", "nobody"
"""Why an episode began: the run's first; all had arrived; `max_steps` were used up; somebody asked
for it; nobody was left to wait for."""

COUNTS = ("answered", "refused", "late", "repeated", "dropped", "learned", "step")
"""The numbers stored beside a robot's tables: how percepts ended; requests repeated as the peer
was behind; transitions given up as no reward came; updates made; the time step of the tables."""

BAG_FORMAT = 2
"""Number of what a bag holds, in its metadata record; 1: version 0.1.0, which wrote no number."""

FORMAT_KEY = "format"
"""What that number is called there."""

INITIAL, CHECKPOINT, FINAL = "initial", "checkpoint", "final"
"""Occasions on which a robot publishes its tables."""

WAITING, RESUMING, LEARNING, GREEDY, PAUSED, FINISHED, STOPPED = (
    "waiting",
    "resuming",
    "learning",
    "acting greedily",
    "paused",
    "finished",
    "stopped",
)
STATES = (WAITING, RESUMING, LEARNING, GREEDY, PAUSED, FINISHED, STOPPED)
"""The states that `status` can name."""
