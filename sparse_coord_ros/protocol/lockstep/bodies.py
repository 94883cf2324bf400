# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies between the barrier and the step: they move first, and the step follows when they arrive.

`BodyWorld` is the game that bodies play: a move leads to the cell that the body reports.
`BodiesSide` sends them: when every robot has acted, each moving body gets its goal cell; when all
bodies have reported their cells, the world makes the step. A body that does not arrive counts as
not moved.

At an episode's beginning bodies must be in the episode's first cells. A simulator puts them there;
people or programs bring real ones there, and the world waits.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.world import Action, World

NO_CELL = -1
"""In place of a cell: the body is in none."""

BEGIN = 1.0
"""Seconds at which simulated time begins. A pose of this time may be older than all goals."""


class BodyGoal(NamedTuple):
    """The goal of one body.

    Attributes:
        robot: the robot, from 0.
        start: its cell in the game.
        end: its destination, a cell.
    """

    robot: int
    start: int
    end: int


class Goals(NamedTuple):
    """The goals that bodies receive at once.

    Attributes:
        number: counts from 1; reports on older goals are ignored.
        step: the time step.
        placing: an episode begins: bodies may get to their cells on any way, and without a time
            limit.
        since: the time of the newest pose in earlier reports, by the clock of the poses. Drivers
            act only on newer poses: by then the simulator of the bodies knows the goals.
        bodies: the goals of the bodies that get one, in the robots' order.
    """

    number: int
    step: int
    placing: bool
    since: float
    bodies: tuple[BodyGoal, ...]


NO_GOALS = Goals(0, 0, False, BEGIN, ())
"""The goals of bodies before the first real ones, which have the number 1."""


class GoalReport(NamedTuple):
    """The end of one body's goal.

    Attributes:
        robot: the robot, from 0.
        number: the number of the goals.
        cell: the body's free cell; `NO_CELL` if it is in none.
        there: whether it reached its destination.
        seconds: the duration of its move, by the clock of its poses.
        stamp: the time of the pose on which the report is based.
    """

    robot: int
    number: int
    cell: int
    there: bool
    seconds: float
    stamp: float


class BodyWorld(World):
    """The Markov game of a scenario, played by bodies.

    Args:
        scenario: the problem.
        seed: the run's seed.
        slips: moves also fail at random, as in the grid and with its draws: the body gets the goal
            to stay. So a learned team meets the world in which it has learned, and bodies that
            always arrive play the grid's game, bit for bit.
        more: `phase` and `max_steps`, as of `World`.

    Attributes:
        there: the cell of each robot after the next step.
    """

    def __init__(
        self, scenario: Scenario, seed: int, *, slips: bool = True, **more: Any
    ) -> None:
        super().__init__(scenario, seed, **more)
        self.slips = slips
        self.there = list(self.cells)

    def told(self, actions: Sequence[Action | None]) -> list[int]:
        """Return each body's goal cell, or its own cell.

        A body stays if its move slips, or its robot does not act or is stopped.

        Args:
            actions: the joint action, complete.
        """
        wanted = list(self.cells)
        for k, action in enumerate(actions):
            if action is not None and not self.arrived[k]:
                wanted[k] = self.wanted(k, action.move)
        return super().settled(wanted)

    def wanted(self, k: int, move: int) -> int:
        """Return the cell to which a move of robot k leads; its own cell if the move slips."""
        if self.slips:
            return super().led(k, move)
        return int(self.scenario.map.next_cell[self.cells[k], move])

    def led(self, k: int, move: int) -> int:
        """Return the cell of robot k's body."""
        return self.there[k]

    def settled(self, wanted: Sequence[int]) -> list[int]:
        """Return the cells unchanged: `told` has stopped robots before they get there."""
        return list(wanted)


class BodiesSide:
    """Sends the bodies of a `BodyWorld`.

    Bodies that are in each other's way move one after the other: see `waves`.

    Args:
        world: the game.
        tell: sends goals to the bodies.

    Attributes:
        placing: whether the world waits for bodies in the cells where the episode begins or
            continues.
        failed: moves that failed.
        lost: failed moves after which the body was in no cell, or its pose was unknown.
        seconds: the total duration of the steps, by the clock of the poses.
    """

    def __init__(self, world: BodyWorld, tell: Callable[[Goals], None]) -> None:
        self._world = world
        self._tell = tell
        self._step: int | None = None
        self._expected: list[int] | None = None
        self.placing = False
        self._ahead: list[tuple[BodyGoal, ...]] = []
        self._under_way: dict[int, BodyGoal] = {}
        self._number = 0
        self._longest = 0.0
        self._since = BEGIN
        self.failed = self.lost = 0
        self.seconds = 0.0

    @property
    def waiting(self) -> list[int]:
        """The robots whose bodies have not reported yet."""
        return sorted(self._under_way)

    def made(self, actions: Sequence[Action | None]) -> bool:
        """Return whether the world can make its step; at a new step the bodies get goals first.

        Args:
            actions: the joint action, complete.
        """
        world = self._world
        if self._step != world.step:
            self._step = world.step
            self._ahead = []
            self._under_way = {}
            self._longest = 0.0
            left = self._expected
            self._expected = world.there = list(world.cells)
            if left != world.there:  # an episode begins, or continues after a break
                here = tuple(
                    BodyGoal(k, cell, cell) for k, cell in enumerate(world.cells)
                )
                self._send(here, placing=True)
            told = world.told(actions)
            goals = [
                BodyGoal(k, world.cells[k], told[k])
                for k, action in enumerate(actions)
                if action is not None and not world.arrived[k]
            ]
            self._ahead += waves(goals, world.scenario.map.doorways)
        self._go_on()
        return not self._under_way

    def reached(self, report: GoalReport) -> bool:
        """Note a body's report; return whether the world may continue."""
        goal = self._under_way.get(report.robot)
        if goal is None or report.number != self._number:
            return False
        del self._under_way[report.robot]
        self._since = max(self._since, report.stamp)
        if not self.placing:
            self._longest = max(self._longest, report.seconds)
            self._settle(goal, report.cell)
        self._go_on()
        return not self._under_way

    def give_up(self) -> None:
        """Count the awaited bodies as not moved."""
        for k in self.waiting:
            self._settle(self._under_way.pop(k), NO_CELL)
        self._go_on()

    def _settle(self, goal: BodyGoal, cell: int) -> None:
        self.failed += cell != goal.end
        self.lost += cell == NO_CELL
        self._world.there[goal.robot] = goal.start if cell == NO_CELL else cell

    def _go_on(self) -> None:
        """Send the next wave of bodies when all earlier ones have arrived."""
        while not self._under_way:
            self.seconds = self.seconds + self._longest
            self._longest = 0.0
            self.placing = False
            if not self._ahead:
                return
            self._send(self._ahead.pop(0))

    def _send(self, goals: tuple[BodyGoal, ...], *, placing: bool = False) -> None:
        self._number += 1
        self.placing = placing
        self._under_way = {goal.robot: goal for goal in goals}
        self._tell(Goals(self._number, self._world.step, placing, self._since, goals))


def waves(
    goals: Sequence[BodyGoal], doorways: frozenset[int]
) -> list[tuple[BodyGoal, ...]]:
    """Return the goals in the order in which bodies can drive them; a body that stays has none.

    A body enters a cell after the body in it has left. Of several bodies with one destination only
    one goes at a time; bodies in doorways go first. If bodies change places, bodies in doorways go
    first; without such bodies all go at once.
    """
    moving = (goal for goal in goals if goal.end != goal.start)
    ahead = sorted(moving, key=lambda goal: (goal.start not in doorways, goal.robot))
    ordered = []
    while ahead:
        leaving = {goal.start for goal in ahead}
        out = [c for c in ahead if c.start in doorways and c.end not in doorways]
        ready = [c for c in ahead if c.end not in leaving] or out or ahead
        first = {goal.end: goal for goal in reversed(ready)}.values()
        ordered.append(tuple(sorted(first)))
        ahead = [goal for goal in ahead if goal not in first]
    return ordered
