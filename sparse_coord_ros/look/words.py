# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where robots are and what they do, in words that need no numbers of cells: by the doorways."""

from collections.abc import Sequence

import numpy as np

from sparse_coord_ros.game.actions import ACTIONS
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.simulation import Glimpse
from sparse_coord_ros.look.steps import Question
from sparse_coord_ros.palette import ANSWERED, FAILED, REFUSED

ENDED = {ANSWERED: "It is answered.", REFUSED: "It is refused.", FAILED: "No answer comes."}


class Words:
    """Says it of one scenario.

    Args:
        scenario: the problem.

    Attributes:
        names: of the robots.
        ways: by doorway the moves from each cell to it, shape (doorways, cells).
    """

    def __init__(self, scenario: Scenario) -> None:
        grid = scenario.map
        self.names = [robot.name for robot in scenario.robots]
        doorways = sorted(grid.doorways)
        self.ways = np.array([grid.distances_to(cell) for cell in doorways], dtype=np.int64)
        self.ways = self.ways.reshape(len(doorways), len(grid.cells))
        self._home = [grid.distances_to(robot.goal) for robot in scenario.robots]

    def where(self, cell: int) -> tuple[str, int | None]:
        """Return where a cell is, and the number of the doorway that this is said by."""
        if not len(self.ways):
            return f"in cell {cell}", None
        door = int(self.ways[:, cell].argmin())
        what, away = "the doorway" if len(self.ways) == 1 else "a doorway", self.ways[door, cell]
        return {0: f"in {what}", 1: f"before {what}"}.get(away, f"{away} moves from {what}"), door

    def near(self, cell: int, door: int | None) -> str:
        """Return where another cell is, seen from the doorway that was named last."""
        if door is None:
            return f"in cell {cell}"
        away = self.ways[door, cell]
        return {0: "in it", 1: "in front of it"}.get(away, f"{away} moves from it")

    def goes(self, robot: int, cell: int, move: int, after: int | None) -> str:
        """Return what a robot does, by whether that leads it to its goal.

        Args:
            robot: the robot.
            cell: where it is.
            move: what it chose.
            after: where it is next, in a damaged log anywhere; None: nobody knows.
        """
        if after is None:
            return f"goes {ACTIONS[move]}"
        closer = int(np.sign(self._home[robot][cell] - self._home[robot][after]))
        return "waits" if after == cell else ("steps aside", "goes on", "steps back")[closer]

    def there(self, door: int | None, seen: Sequence[tuple[int, int]]) -> str:
        """Return where other robots are; of several only those that are close to the doorway.

        Args:
            door: the number of the doorway that was named last; None: there are none.
            seen: number and cell of each of them.
        """
        if len(seen) > 1 and door is not None:
            seen = [one for one in seen if self.ways[door, one[1]] <= 1]
        said = [f"{self.names[k]} is {self.near(cell, door)}" for k, cell in seen]
        return " and ".join(said) or "nobody is near it"

    def question(self, seen: Glimpse, question: Question) -> str:
        """Return a question of a time step in sentences."""
        k, peers, _, move = question
        cell, after = seen.cells[k], None if seen.after is None else seen.after[k]
        others = [(peer, at) for peer in peers if (at := seen.cells[peer]) is not None]
        if cell is None:
            return f"{self.names[k]} asks; where it is nobody tells."
        place, door = self.where(cell)
        known = question.outcome == ANSWERED and len(others) == len(peers)
        ended = f"Answer: {self.there(door, others)}." if known else ENDED[question.outcome]
        return f"{self.names[k]} asks {place}. {ended} It {self.goes(k, cell, move, after)}."
