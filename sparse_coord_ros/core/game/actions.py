# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The actions of a robot: the moves, their names and directions, and COORDINATE.

To add a move, add its name, direction and number here.
"""

MOVES = {"north": (-1, 0), "south": (1, 0), "east": (0, 1), "west": (0, -1)}
"""The primitive actions: by name the change of (row, column)."""

DIRECTIONS = tuple(MOVES.values())
"""The change of (row, column) of each move, by its number."""

NORTH, SOUTH, EAST, WEST = range(4)

PRIMITIVES = len(MOVES)
"""Number of primitive actions."""

COORDINATE = PRIMITIVES
"""The action that asks where peers are; it comes after the moves."""

ACTIONS = (*MOVES, "coordinate")
"""The name of each action, by its number."""

STAY = PRIMITIVES
"""In place of a move: what a step comes to that leaves a robot where it is."""

OUTCOMES = PRIMITIVES + 1
"""What a step can come to: each move, and `STAY`: a move failed, or the robot has arrived."""
