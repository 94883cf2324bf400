# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a miscoordination is: two robots at one meeting place (paper, Section 4).

The setting `conflict` says which cells are one meeting place: each doorway by itself, or all
doorways together. Functions take plain numbers and arrays alike; compiled loops call `together`,
and `meet`, which is theirs alone.
"""

from typing import Any

import numpy as np

from sparse_coord_ros.base.compiling import inlined, inner
from sparse_coord_ros.core.game.scenario import Scenario

NOWHERE = -1
"""The meeting place of a robot that is in no doorway, or not in the game: it meets nobody."""


def meeting_places(scenario: Scenario) -> np.ndarray:
    """Return the meeting place of each cell, or `NOWHERE`: shape (cells,), int64."""
    places = np.full(len(scenario.map.cells), NOWHERE, dtype=np.int64)
    doorways = sorted(scenario.map.doorways)
    places[doorways] = 0 if scenario.conflict == "any_doorway" else doorways
    return places


@inner
def together(place: Any, other: Any) -> Any:
    """Return whether robots at two meeting places miscoordinate: a bool, or an array of bools."""
    return (place == other) & (place != NOWHERE)


@inlined
def meet(places: Any, cells: Any, members: Any) -> bool:
    """Return whether robots miscoordinate: two of them are at one meeting place.

    Args:
        places: the meeting place of each cell.
        cells: the cell of each robot.
        members: the robots that are in the game.
    """
    for i in range(len(members)):
        place = places[cells[members[i]]]
        if place != NOWHERE:
            for j in range(i):
                if together(place, places[cells[members[j]]]):
                    return True
    return False


def miscoordinated(places: Any) -> Any:
    """Return whether a joint state is a miscoordination: r^C falls on every robot.

    Args:
        places: the meeting place of each robot; or arrays of them, robots first: shape (K, ...).

    Returns:
        A bool; for arrays of shape (K, ...) and two robots or more bools of shape (...).
    """
    found: Any = False
    for k, place in enumerate(places):
        for other in places[:k]:
            found = found | together(place, other)
    return found


def miscoordinations(scenario: Scenario, cells: np.ndarray) -> np.ndarray:
    """Return which joint states are miscoordinations.

    Args:
        scenario: the problem.
        cells: the cell of each robot, shape (T, K); a negative number: nobody knows.

    Returns:
        Shape (T,), bool.
    """
    places = np.where(cells < 0, NOWHERE, meeting_places(scenario)[cells])
    found: np.ndarray = np.zeros(len(cells), dtype=bool) | miscoordinated(places.T)
    return found
