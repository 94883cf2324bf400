# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversions between the core's steps, cells and numbers and ROS messages."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from sparse_coord_ros.core.agent import Tables
from sparse_coord_ros.core.algorithm import COORDINATE
from sparse_coord_ros.core.grid import MOVES, GridMap
from sparse_coord_ros.core.run_config import RunConfig
from sparse_coord_ros.core.scenario import Scenario
from sparse_coord_ros.core.world import Action, Reward
from sparse_coord_ros.nodes.cdr import FixedLayout
from sparse_coord_ros.nodes.interface import ACTION_LABELS, MAP_FRAME, REWARD_LABELS

SECOND = 1_000_000_000
UNKNOWN, EMPTY, OCCUPIED = -1, 0, 100
EAST_NORTH = [(float(column), float(-row)) for row, column in MOVES]
"""The primitive actions as unit vectors (x east, y north: REP-103)."""
MOVE_OF = {vector: move for move, vector in enumerate(EAST_NORTH)}

ROBOT_COLOURS = (
    (0.12, 0.47, 0.71),
    (1.00, 0.50, 0.05),
    (0.17, 0.63, 0.17),
    (0.84, 0.15, 0.16),
    (0.58, 0.40, 0.74),
    (0.55, 0.34, 0.29),
    (0.89, 0.47, 0.76),
    (0.09, 0.75, 0.81),
)
DOORWAY_COLOUR = (0.45, 0.45, 0.45)


def _header(sec: int, nanosec: int) -> Header:
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=MAP_FRAME)


def _pose(sec: int, nanosec: int, x: float, y: float) -> PoseStamped:
    message = PoseStamped(header=_header(sec, nanosec))
    message.pose.position.x, message.pose.position.y = x, y
    return message


def _labelled(labels: Sequence[str]) -> FixedLayout:
    """Return the layout of a JointState whose names label its positions."""

    def build(sec: int, nanosec: int, *numbers: float) -> JointState:
        return JointState(header=_header(sec, nanosec), name=list(labels), position=list(numbers))

    def read(message: JointState) -> tuple:
        said = dict(zip(message.name, message.position, strict=False))
        missing = [label for label in labels if label not in said]
        if missing:
            raise ValueError(f"no number is labelled {', '.join(missing)}")
        stamp = message.header.stamp
        return (stamp.sec, stamp.nanosec, *(said[label] for label in labels))

    return FixedLayout(JointState, build, read, len(labels))


def _read_pose(message: PoseStamped) -> tuple:
    stamp, position = message.header.stamp, message.pose.position
    return (stamp.sec, stamp.nanosec, position.x, position.y)


POSE_LAYOUT = FixedLayout(PoseStamped, _pose, _read_pose, 2)
REWARD_LAYOUT = _labelled(REWARD_LABELS)
ACTION_LAYOUT = _labelled(ACTION_LABELS)
CLOCK_LAYOUT = FixedLayout(
    Clock,
    lambda sec, nanosec: Clock(clock=Time(sec=sec, nanosec=nanosec)),
    lambda message: (message.clock.sec, message.clock.nanosec),
    0,
)


class Converter:
    """Conversions of one run: its time step, its map and its metres.

    Args:
        run: the run; time step t is stamped t * step_period seconds, the map's lower left corner
            is the origin of the frame `map`, x points east, y north.
    """

    def __init__(self, run: RunConfig) -> None:
        self.grid: GridMap = run.scenario.map
        self.resolution = run.resolution
        self.period = round(run.step_period * SECOND)
        rows = self.grid.shape[0]
        self._centres = [
            ((column + 0.5) * self.resolution, (rows - row - 0.5) * self.resolution)
            for row, column in self.grid.cells
        ]
        self._cells = {centre: cell for cell, centre in enumerate(self._centres)}

    def stamp(self, step: int) -> tuple[int, int]:
        """Return (sec, nanosec) of a time step."""
        return divmod(step * self.period, SECOND)

    def step(self, sec: int, nanosec: int) -> int:
        """Return the time step of a stamp (the nearest one)."""
        return (sec * SECOND + nanosec + self.period // 2) // self.period

    def header(self, step: int) -> Header:
        """Return a header in the frame `map`."""
        return _header(*self.stamp(step))

    def cell(self, x: float, y: float) -> int | None:
        """Return the free cell at a position in metres, or None where there is none."""
        cell = self._cells.get((x, y))
        if cell is None and np.isfinite(x) and np.isfinite(y):
            rows = self.grid.shape[0]
            position = (rows - 1 - int(y // self.resolution), int(x // self.resolution))
            cell = self.grid.number.get(position)
        return cell

    def pack_state(self, step: int, cell: int) -> bytes:
        """Return X_k(t) as CDR of geometry_msgs/PoseStamped."""
        return POSE_LAYOUT.pack(*self.stamp(step), *self._centres[cell])

    def unpack_state(self, data: bytes) -> tuple[int, int]:
        """Return (step, cell) of a local state.

        Raises:
            ValueError: the pose lies in no free cell.
        """
        sec, nanosec, x, y = POSE_LAYOUT.unpack(data)
        cell = self.cell(x, y)
        if cell is None:
            raise ValueError(f"position ({x:g}, {y:g}) is no free cell of map {self.grid.name}")
        return self.step(sec, nanosec), cell

    def pack_reward(self, step: int, reward: Reward) -> bytes:
        """Return R_k(t) and its parts as CDR of sensor_msgs/JointState."""
        return REWARD_LAYOUT.pack(*self.stamp(step), *reward)

    def unpack_reward(self, data: bytes) -> tuple[int, float]:
        """Return (step, total) of a reward."""
        sec, nanosec, *parts = REWARD_LAYOUT.unpack(data)
        return self.step(sec, nanosec), parts[-1]

    def pack_action(self, step: int, action: Action) -> bytes:
        """Return an action as CDR of sensor_msgs/JointState; peers count from 1, 0 is none."""
        return ACTION_LAYOUT.pack(
            *self.stamp(step),
            *EAST_NORTH[action.move],
            float(action.asked),
            float(action.peer + 1),
            float(action.perceived),
        )

    def unpack_action(self, data: bytes) -> tuple[int, Action]:
        """Return (step, action).

        Raises:
            ValueError: labels are missing, (east, north) is no primitive action, or peer is no
                number.
        """
        sec, nanosec, east, north, asked, peer, perceived = ACTION_LAYOUT.unpack(data)
        move = MOVE_OF.get((east, north))
        if move is None:
            raise ValueError(f"(east, north) is ({east:g}, {north:g}), no primitive action")
        if not np.isfinite(peer):
            raise ValueError(f"peer is {peer:g}, no robot's number")
        action = Action(move, bool(asked), int(peer) - 1, bool(perceived))
        return self.step(sec, nanosec), action

    def pose(self, step: int, cell: int) -> PoseStamped:
        """Return a cell's centre at a time step."""
        return _pose(*self.stamp(step), *self._centres[cell])

    def path(self, step: int, cells: Iterable[int | None]) -> Path:
        """Return the cells' centres as a path, leaving out None."""
        poses = [self.pose(step, cell) for cell in cells if cell is not None]
        return Path(header=self.header(step), poses=poses)

    def occupancy(self, step: int, values: np.ndarray) -> OccupancyGrid:
        """Return values of the free cells (shape (cells,), -1 to 100) as a grid; walls unknown."""
        rows, columns = self.grid.shape
        data = np.full((rows, columns), UNKNOWN, dtype=np.int8)
        data[tuple(np.array(self.grid.cells).T)] = values
        return self._occupancy(step, data)

    def map(self) -> OccupancyGrid:
        """Return the map: walls occupied, all else free."""
        data = np.array([[OCCUPIED * (s == "#") for s in row] for row in self.grid.rows], np.int8)
        return self._occupancy(0, data)

    def coordination_map(self, step: int, tables: Tables) -> OccupancyGrid:
        """Return where a robot would choose COORDINATE: 100 there, 0 elsewhere, -1 on walls."""
        values = np.nan_to_num(tables.q_star, nan=-np.inf)
        return self.occupancy(step, OCCUPIED * (values.argmax(axis=1) == COORDINATE))

    def _occupancy(self, step: int, data: np.ndarray) -> OccupancyGrid:
        message = OccupancyGrid(header=self.header(step))
        message.info.resolution = self.resolution
        message.info.height, message.info.width = data.shape
        message.info.origin.orientation.w = 1.0
        message.data = np.flipud(data).flatten().tolist()  # row 0 of the message is the south
        return message

    def markers(self, step: int, scenario: Scenario, cells: Sequence[int]) -> MarkerArray:
        """Return doorways, goals and robots."""
        array = MarkerArray()
        for number, cell in enumerate(sorted(self.grid.doorways)):
            array.markers.append(
                self._marker(step, "doorways", number, cell, DOORWAY_COLOUR, Marker.CUBE, 0.05)
            )
        for k, robot in enumerate(scenario.robots):
            colour = ROBOT_COLOURS[k % len(ROBOT_COLOURS)]
            goal = self._marker(step, "goals", k, robot.goal, colour, Marker.CYLINDER, 0.04)
            here = self._marker(step, "robots", k, cells[k], colour, Marker.SPHERE, 0.5)
            array.markers += [goal, here]
        return array

    def _marker(self, step, namespace, number, cell, colour, shape, height) -> Marker:
        marker = Marker(header=self.header(step), ns=namespace, id=number, type=shape)
        marker.pose = self.pose(step, cell).pose
        marker.scale.x = marker.scale.y = (
            0.5 if shape == Marker.SPHERE else 0.9
        ) * self.resolution
        marker.scale.z = height * self.resolution
        marker.color = ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=0.8)
        return marker


def status(name: str, message: str, values: Mapping[str, object], *, warn: bool = False):
    """Return a diagnostic status with its values as texts."""
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if warn else DiagnosticStatus.OK,
        name=name,
        message=message,
        hardware_id="sparse_coord_ros",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


def status_values(message: DiagnosticStatus) -> dict[str, str]:
    """Return the values of a diagnostic status."""
    return {value.key: value.value for value in message.values}
