# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What decoded occupancy grids and markers show, checked against the scenario."""

from collections.abc import Callable
from typing import Any

import numpy as np

from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.runlog.decode import nanoseconds_of
from sparse_coord_ros.wire import DOORWAYS, GOALS, MAP_FRAME, ROBOTS
from sparse_coord_ros.wire.frame import Frame, flat_position


def occupancy(frame: Frame) -> Callable[[Any], bytes]:
    """Return a function that gives the data of a decoded OccupancyGrid.

    It raises ValueError where the grid does not lie on the map.
    """
    rows, columns = frame.grid.shape
    resolution = float(np.float32(frame.resolution))
    due = (resolution, columns, rows, 0, 0)

    def content(message: Any) -> bytes:
        info = message.info
        time = info.map_load_time
        if (info.resolution, info.width, info.height, time.sec, time.nanosec) != due:
            raise ValueError("has another resolution or size than the map")
        if flat_position(info.origin) != frame.origin:
            raise ValueError("has another origin than the map")
        data = bytes(value & 0xFF for value in message.data)
        if len(data) != rows * columns:
            raise ValueError(f"has {len(data)} cells, not {rows * columns}")
        return data

    return content


class MarkersContent:
    """Reads decoded MarkerArrays, as (nanoseconds, robots' positions).

    Calling it raises ValueError where the doorways, the goals or the order of the markers are not
    those of the scenario, or their stamps differ.

    Attributes:
        due: namespace, number and place of each marker; None in place of a robot's.
        robots: which of them are robots.
        looks: how the markers look, after the first message; it stays the same.
    """

    def __init__(self, frame: Frame, scenario: Scenario) -> None:
        self.due: list[tuple[Any, ...]] = [
            (DOORWAYS, number, frame.centres[cell])
            for number, cell in enumerate(sorted(frame.grid.doorways))
        ]
        for k, robot in enumerate(scenario.robots):
            self.due += [(GOALS, k, frame.centres[robot.goal]), (ROBOTS, k, None)]
        self.robots = [place for place, one in enumerate(self.due) if one[2] is None]
        self.looks: list[tuple[Any, ...]] | None = None

    def __call__(self, message: Any) -> tuple[int, list[Any]]:
        """Return what a message says."""
        stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in message.markers}
        said = [(m.ns, m.id, flat_position(m.pose)) for m in message.markers]
        shown = [(ns, k, None if ns == ROBOTS else place) for ns, k, place in said]
        if shown != self.due:
            raise ValueError("shows other doorways, goals or robots than the scenario's")
        if len(stamps) != 1 or any(m.header.frame_id != MAP_FRAME for m in message.markers):
            raise ValueError("holds several stamps, or another frame")
        looks = list(map(_look, message.markers))
        self.looks = self.looks or looks
        if looks != self.looks:
            raise ValueError("looks otherwise than those before it")
        places = [said[place][2] for place in self.robots]
        return nanoseconds_of(message.markers[0].header.stamp), places


def _look(marker: Any) -> tuple[Any, ...]:
    size, colour = marker.scale, marker.color
    return (
        *(marker.type, marker.action, size.x, size.y, size.z),
        *(colour.r, colour.g, colour.b, colour.a),
    )
