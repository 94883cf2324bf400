# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fast CDR for what is published at each start of an episode: map, markers, coordination maps.

Such a message, as rclpy's object, costs more than half a time step; episodes may be short.
"""

import struct
from collections.abc import Sequence

import numpy as np

from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.nodes.cdr import PROBE_NUMBER, Template, probe_stamp
from sparse_coord_ros.nodes.messages import Converter
from sparse_coord_ros.wire import ROBOTS
from sparse_coord_ros.wire.occupancy import OccupancyData

_PLACE = struct.Struct("=dd")


class MapLayout:
    """The map, as CDR of nav_msgs/OccupancyGrid."""

    def __init__(self, convert: Converter) -> None:
        self._convert = convert
        message = convert.map()
        message.header.stamp = probe_stamp()
        self._template = Template(message)

    def pack(self, step: int) -> bytes:
        """Return the map at a time step."""
        return self._template.pack(*self._convert.stamp(step))


class CoordinationMapLayout:
    """Where a robot would choose COORDINATE, as CDR of nav_msgs/OccupancyGrid."""

    def __init__(self, convert: Converter) -> None:
        self._convert = convert
        rows, columns = convert.grid.shape
        message = convert.occupancy(0, np.zeros(len(convert.grid.cells)))
        message.header.stamp = probe_stamp()
        self._grids = OccupancyData(convert)
        probe = (np.arange(rows * columns) % 100).astype(np.int8)
        message.data = probe.tolist()
        # With the length before it, even the data of a tiny map are found.
        self._length = struct.pack("=I", len(probe))
        self._template = Template(message, [self._length + probe.tobytes()])

    def pack(self, step: int, tables: Tables) -> bytes:
        """Return the map at a time step: 100 where COORDINATE is chosen, 0 elsewhere, -1 walls."""
        data = self._grids.coordination(tables)
        return self._template.pack(*self._convert.stamp(step), self._length + data)


class MarkersLayout:
    """Doorways, goals and robots, as CDR of visualization_msgs/MarkerArray."""

    def __init__(self, convert: Converter, scenario: Scenario) -> None:
        self._convert = convert
        message = convert.markers(0, scenario, [robot.start for robot in scenario.robots])
        probes = []
        for number, marker in enumerate(message.markers):
            marker.header.stamp = probe_stamp()
            if marker.ns == ROBOTS:
                place = (PROBE_NUMBER * (2 * number + 1), PROBE_NUMBER * (2 * number + 2))
                marker.pose.position.x, marker.pose.position.y = place
                probes.append(_PLACE.pack(*place))
        self._template = Template(message, probes)

    def pack(self, step: int, cells: Sequence[int]) -> bytes:
        """Return the markers at a time step, the robots in their cells."""
        places = [_PLACE.pack(*self._convert.centres[cell]) for cell in cells]
        return self._template.pack(*self._convert.stamp(step), *places)
