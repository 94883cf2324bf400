# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Positions and actions of robots in words: relative to doorways and shortest paths.

Doorways are those of `show.doorways`: a passage of doorway cells is one doorway.
"""

from collections.abc import Sequence

import numpy as np

from sparse_coord_ros.base.palette import ANSWERED, FAILED, REFUSED
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.interactions import interactions_of
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.runs.evaluation import fails
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.protocol.wire import PerceptEnd
from sparse_coord_ros.show.doorways import NO_WAY, Doorways
from sparse_coord_ros.show.steps import Interacting, Question, interacting_in

ENDED = {
    ANSWERED: "The question is answered.",
    REFUSED: "The question is refused.",
    FAILED: "No answer comes.",
}


class Narrator:
    """Describes positions and actions of the robots of one scenario.

    Args:
        scenario: the problem.

    Attributes:
        names: the robots' names.
        doorways: the doorways of its map.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._grid = scenario.map
        self._interactions = interactions_of(scenario)
        self.names = [robot.name for robot in scenario.robots]
        self.doorways = Doorways(scenario.map)
        self._from = [self.doorways.moves_to(robot.start) for robot in scenario.robots]
        self._goal = [robot.goal for robot in scenario.robots]
        self._home = [self.doorways.moves_to(robot.goal) for robot in scenario.robots]

    def _cell(self, cell: int) -> str:
        row, column = self._grid.cells[cell]
        return f"in cell {cell} [{row}, {column}]"

    def led(self, cell: int, move: int) -> int:
        """Return the cell to which a move leads."""
        return int(self._grid.next_cell[cell, move])

    def past(self, robot: int, cell: int, door: int) -> bool:
        """True if a robot has passed a doorway.

        The doorway is on a shortest way from the robot's start to its cell, and not on a shortest
        way from there to its goal.
        """
        came = self.doorways.is_between(door, cell, self._from[robot])
        return came and not self.doorways.is_between(door, cell, self._home[robot])

    def where(
        self, robot: int, cell: int, toward: int | None = None
    ) -> tuple[str, int | None]:
        """Return a robot's position in words, and the number of the doorway in them.

        This is the doorway in which the robot is. Outside of doorways it is the next one on a
        shortest way to the goal; of several at the same distance, the one that the robot enters.
        If no doorway is ahead, it is the closest one; None if no doorway can be reached.

        Args:
            robot: its number from 0.
            cell: where it is.
            toward: the cell to which its move leads.
        """
        doorways = self.doorways
        the = "the doorway" if doorways.count == 1 else "a doorway"
        if doorways.of[cell] >= 0:
            return f"in {the}", int(doorways.of[cell])
        next_ones = doorways.on_the_way(cell, self._home[robot])
        if (next_ones < NO_WAY).any():
            away = int(next_ones.min())
            if away > 1:
                return f"{away} moves before {the}", int(next_ones.argmin())
            entered = -1 if toward is None else int(doorways.of[toward])
            if entered >= 0 and next_ones[entered] == 1:
                return f"before {the}", entered
            return f"before {the}", int(next_ones.argmin())
        ways = doorways.away(cell)
        if not (ways < NO_WAY).any():
            return self._cell(cell), None
        away = int(ways.min())
        door = int(ways.argmin())
        if self.past(robot, cell, door):
            moves = "1 move" if away == 1 else f"{away} moves"
            return f"{moves} past {the}", door
        return f"next to {the}" if away == 1 else f"{away} moves from {the}", door

    def seen_from(
        self, robot: int, cell: int, door: int | None, peer: int, at: int
    ) -> str:
        """Return a peer's position in words, as seen from a robot.

        Args:
            robot: the robot that asks, from 0.
            cell: where it is.
            door: the doorway that the words refer to, as of `where`.
            peer: the peer.
            at: where the peer is.
        """
        if at == cell:
            return "in the same cell"
        moves = int(self.doorways.moves_to(cell)[at])
        if moves >= NO_WAY:
            return f"{self._cell(at)}, to which there is no way"
        away = f"{moves} moves away"
        if moves == 1:
            away = f"beside {self.names[robot]}"
        if door is None:
            return away
        if self.doorways.of[at] == door:
            is_one_cell = len(self.doorways.cells_of[door]) == 1
            return "in the doorway" if is_one_cell else f"in the doorway, {away}"
        if self.doorways.of[cell] == door:
            side = self._ahead(robot, cell, door, at)
            if side and moves == 1:
                side = f"right {side}"
                away = ""
        elif moves == 1:
            side = ""
        else:
            side = self.doorways.side(door, cell, at)
        beyond = self._beyond(cell, door, peer, at, side)
        return ", ".join(part for part in (side, beyond, away) if part)

    def _beyond(self, cell: int, door: int, peer: int, at: int, side: str) -> str:
        """Return the part of the map of a peer outside of this doorway; may be empty.

        Args:
            cell: the cell of the robot that asks.
            door: the doorway that the words refer to.
            peer: the peer.
            at: where the peer is.
            side: the peer's side of that doorway; empty if it was not named.
        """
        if self.doorways.of[at] >= 0:
            return "in another doorway"
        if side:
            return "past the doorway" if self.past(peer, at, door) else ""
        is_beside = self.doorways.moves_to(cell)[at] == 1
        if not is_beside and self.doorways.behind_another(door, cell, at):
            return "on the other side of another doorway"
        return ""

    def _ahead(self, robot: int, cell: int, door: int, at: int) -> str:
        """Return in words whether a cell is ahead of a robot in a doorway or behind, or ""."""
        peer_way = self.doorways.leaves_by(door, cell, at)
        own_way = self.doorways.leaves_by(door, cell, self._goal[robot])
        if not peer_way or not own_way:
            return ""
        if peer_way <= own_way:
            return f"ahead of {self.names[robot]}"
        return "" if peer_way & own_way else f"behind {self.names[robot]}"

    def interacting(self, seen: TeamTransition) -> Interacting:
        """Return the interactions of robots in a time step."""
        return interacting_in(self._interactions, self._grid.next_cell, seen)

    def interactions(self, seen: TeamTransition) -> list[str]:
        """Return a sentence for each interaction of a time step."""
        found = self.interacting(seen)
        after = seen.after or ()
        told = []
        for robots in self._gathered(seen, found.together):
            told.append(self._together(robots, [after[k] for k in robots]))
        for k, j in found.exchanges:
            told.append(f"{self.names[k]} and {self.names[j]} exchange their cells.")
        for k in sorted({one[0] for one in found.stopped}):
            told.append(f"{self.names[k]} stays: {self._in_the_way(k, found)}.")
        return told

    def _together(self, robots: Sequence[int], cells: Sequence[int | None]) -> str:
        """Return a sentence: the robots that are together in some cells."""
        place = "the same cell"
        if self.doorways.of[cells[0]] >= 0:
            place = "the same doorway"
        if len(set(cells)) > 1:
            place = "doorways at the same time"
        return f"{_listed([self.names[k] for k in robots])} are in {place}."

    def _gathered(self, seen: TeamTransition, cells: Sequence[int]) -> list[list[int]]:
        """Return the groups of robots that end a time step together, in some cells."""
        places = self._interactions.places
        after = seen.after or ()
        groups = []
        for place in dict.fromkeys(int(places[cell]) for cell in cells):
            here = [
                k
                for k, cell in enumerate(after)
                if cell is not None and places[cell] == place
            ]
            groups.append(here)
        return groups

    def _in_the_way(self, robot: int, found: Interacting) -> str:
        """Return a text: the robots in the way of a stopped robot."""
        others = [self.names[j] for k, j, _ in found.stopped if k == robot]
        verb = "is" if len(others) == 1 else "are"
        return f"{_listed(others)} {verb} in its way"

    def _why_it_stays(self, robot: int, seen: TeamTransition, move: int) -> str:
        """Return the reason why a robot stays in its cell, although its move leads elsewhere."""
        found = self.interacting(seen)
        if any(one[0] == robot for one in found.stopped):
            return self._in_the_way(robot, found)
        cell = seen.cells[robot]
        narrow = self._interactions.narrow[self._grid.next_cell[cell, move]]
        fails = f"its move {ACTIONS[move]} fails"
        # A robot may be stopped by one that is stopped itself, or whose cell is not known.
        may_be_stopped = len(self.names) > 2 or None in seen.cells
        if narrow and may_be_stopped:
            return f"{fails}, or another robot stops it"
        return fails

    def does(
        self, robot: int, cell: int, move: int, after: int | None, why: str = ""
    ) -> str:
        """Return a robot's action in words, and whether it comes closer to its goal.

        Args:
            robot: the robot.
            cell: where it is.
            move: the move that it chose.
            after: its next cell (in a damaged log any cell); None: unknown.
            why: the reason why it stays, if its move leads elsewhere; empty: the move fails.
        """
        led = int(self._grid.next_cell[cell, move])
        if after is None:
            return f"chooses {ACTIONS[move]}"
        if after != cell:
            return self._goes(robot, cell, after, move)
        if led == cell:
            return "waits"
        return f"stays: {why or f'its move {ACTIONS[move]} fails'}"

    def _goes(self, robot: int, cell: int, after: int, move: int) -> str:
        now = self._home[robot][cell]
        then = self._home[robot][after]
        if now >= NO_WAY or then >= NO_WAY or now == then:
            return f"goes {ACTIONS[move]}"
        return "goes on" if then < now else "steps back"

    def answer(
        self, robot: int, cell: int, door: int | None, seen: Sequence[tuple[int, int]]
    ) -> str:
        """Return other robots' positions in words: of all close ones, or of the closest.

        Args:
            robot: the robot that asks.
            cell: where it is.
            door: the doorway that the words refer to, as of `where`.
            seen: number and cell of each other robot, at least one.
        """
        moves = self.doorways.moves_to(cell)
        close = [one for one in seen if self._is_close(one[1], door, moves)]
        if len(seen) > 1 and not close:
            peer, at = min(seen, key=lambda one: moves[one[1]])
            said = self.seen_from(robot, cell, door, peer, at)
            return f"the closest robot, {self.names[peer]}, is {said}"
        return "; ".join(
            f"{self.names[peer]} is {self.seen_from(robot, cell, door, peer, at)}"
            for peer, at in (close if len(seen) > 1 else seen)
        )

    def _is_close(self, at: int, door: int | None, moves: np.ndarray) -> bool:
        """True if a cell is in a doorway or beside it, or as close to the robot that asks."""
        return bool(
            moves[at] <= 1 or (door is not None and at in self.doorways.near[door])
        )

    def question(self, seen: TeamTransition, question: Question) -> str:
        """Return a question of a time step in sentences."""
        k, peers, end, move = question
        cell = seen.cells[k]
        after = None if seen.after is None else seen.after[k]
        name = self.names[k]
        others = [(peer, at) for peer in peers if (at := seen.cells[peer]) is not None]
        ended = ENDED[question.outcome]
        if end == PerceptEnd.NOBODY_TO_ASK:
            ended = "There is no other robot."
        if cell is None:
            return f"{name} asks; its cell is not known. {ended}"
        place, door = self.where(k, cell, int(self._grid.next_cell[cell, move]))
        if question.outcome == ANSWERED and others and len(others) == len(peers):
            ended = f"Answer: {self.answer(k, cell, door, others)}."
        why = "" if after != cell else self._why_it_stays(k, seen, move)
        does = self.does(k, cell, move, after, why)
        return f"{name} asks {place}. {ended} {name} {does}."


def failing_in_words(all_arrived: float) -> str:
    """Return a sentence that comes before what a team learned; empty where it does not fail.

    Args:
        all_arrived: share of its greedy episodes in which all robots arrive.
    """
    if not fails(all_arrived):
        return ""
    share = percent(all_arrived)
    return f"This team fails: all robots arrive in {share} of its greedy episodes."


def _listed(names: Sequence[str]) -> str:
    """Return names as a list in words."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
