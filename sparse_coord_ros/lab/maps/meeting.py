# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The need of coordination on an imported map, and a doorway that would create it."""

import dataclasses
from typing import NamedTuple

from sparse_coord_ros.core.game.grid import DOORWAY, GridMap
from sparse_coord_ros.core.game.interactions import interactions_of, only_together
from sparse_coord_ros.core.game.pose import metres
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.solve.advice import (
    LEAST_RELATIVE_GAIN,
    Advice,
    advice,
    in_questions,
    loss_of_ignoring,
)
from sparse_coord_ros.core.solve.shortest_paths import expected_meetings
from sparse_coord_ros.lab.maps.plan import Place, centre_of


class Doorway(NamedTuple):
    """A cell in which robots would meet if it were a doorway.

    Attributes:
        cell: its number.
        lost: the loss of a robot that ignores the others with this doorway, in questions.
    """

    cell: int
    lost: float


class Prospect(NamedTuple):
    """What coordination will bring to a team on an imported map.

    Attributes:
        advice: whether coordination will pay.
        note: the reason why coordination is not needed, and a remedy; empty: it is needed.
        doorway: (x, y) of a cell, in metres, which as a doorway would make coordination necessary;
            None: no such cell is known or needed.
    """

    advice: Advice
    note: str
    doorway: Place | None


def prospect_of(scenario: Scenario) -> Prospect:
    """Return what coordination will bring to a team; its map has a place in metres."""
    expected = advice(scenario)
    if len(scenario.robots) == 1 or expected.ratio >= LEAST_RELATIVE_GAIN:
        return Prospect(expected, "", None)
    note = (
        "nothing to coordinate: shortest paths rarely meet "
        f"({scenario.interactions}), and robots lose less by it than a question costs; "
    )
    meeting = best_doorway(scenario)
    if meeting is None:
        note += "choose starts and goals whose ways cross"
        return Prospect(expected, note, None)
    centre = centre_of(scenario.map, meeting.cell)
    doorway = f"a doorway at {metres(centre)}, where they meet most often,"
    if meeting.lost < LEAST_RELATIVE_GAIN:
        note += (
            f"even {doorway} would cost less than a question: choose starts and goals whose "
            "ways cross"
        )
        return Prospect(expected, note, None)
    note += f"{doorway} would cost each as much as {meeting.lost:.1f} questions"
    return Prospect(expected, note, centre)


def best_doorway(scenario: Scenario) -> Doorway | None:
    """Return the cell in which robots on shortest paths meet most.

    Starts and goals are left out: a doorway there is in the way of all robots.

    Returns:
        None if they never meet, or if the scenario's interactions are more than `together`:
        then the walls matter, and not the doorways alone.
    """
    if not only_together(interactions_of(scenario)):
        return None
    meetings = expected_meetings(scenario)
    for robot in scenario.robots:
        meetings[[robot.start, robot.goal]] = 0.0
    cell = int(meetings.argmax())
    if meetings[cell] == 0.0:
        return None
    changed = dataclasses.replace(scenario, map=with_doorway(scenario.map, cell))
    return Doorway(cell, in_questions(loss_of_ignoring(changed), changed))


def with_doorway(grid: GridMap, cell: int) -> GridMap:
    """Return a map in which a cell is a doorway."""
    row, column = grid.cells[cell]
    rows = list(grid.rows)
    rows[row] = rows[row][:column] + DOORWAY + rows[row][column + 1 :]
    return dataclasses.replace(grid, rows=tuple(rows))
