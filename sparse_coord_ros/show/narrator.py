# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Positions and actions of robots in words, and the rules of a scenario."""

from collections.abc import Sequence
from functools import lru_cache

from sparse_coord_ros.base.palette import ANSWERED, FAILED, REFUSED
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.interactions import (
    NOWHERE,
    can_miscoordinate,
    interactions_of,
)
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.runs.measures import Measures
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.protocol.wire import PerceptEnd
from sparse_coord_ros.show.steps import Interacting, Question, interacting_in

ENDED = {
    ANSWERED: "The question is answered.",
    REFUSED: "The question is refused.",
    FAILED: "No answer comes.",
}

CLOSE = 2
"""Of several robots those are told that are at most so many moves away."""

KEPT = 256
"""Cells whose distances to all cells are kept for later calls."""

TOGETHER = {
    "": "are in one doorway",
    "anywhere": "are in one cell that is no goal",
    "any_doorway": "are in doorways",
}
"""What robots do that pay r^C together, by the variant of `together`."""

NARROW = {"": "A doorway", "anywhere": "A cell that is no goal"}
"""What holds one robot, by the variant of `block`."""


class Narrator:
    """Describes positions and actions of the robots of one scenario.

    Args:
        scenario: the problem.

    Attributes:
        names: the robots' names.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._grid = scenario.map
        self._interactions = interactions_of(scenario)
        self.names = [robot.name for robot in scenario.robots]
        self._moves_to = lru_cache(KEPT)(scenario.map.distances_to)
        self._home = [self._moves_to(robot.goal) for robot in scenario.robots]

    def led(self, cell: int, move: int) -> int:
        """Return the cell to which a move leads."""
        return int(self._grid.next_cell[cell, move])

    def _doorway(self, cell: int) -> str:
        """Return that a cell is a doorway, in words; empty if it is none."""
        doorways = self._grid.doorways
        if cell not in doorways:
            return ""
        return ", in the doorway" if len(doorways) == 1 else ", in a doorway"

    def where(self, cell: int) -> str:
        """Return the position of a robot that asks, in words."""
        return f"in cell {cell}{self._doorway(cell)}"

    def seen_from(self, cell: int, at: int) -> str:
        """Return a peer's position in words, as seen from a robot.

        Args:
            cell: where the robot is that asks.
            at: where the peer is.
        """
        if at == cell:
            return "in the same cell"
        moves = int(self._moves_to(cell)[at])
        away = f"{moves} moves away"
        if moves == 1:
            away = "1 move away"
        if moves < 0:
            away = "to which there is no way"
        return f"in cell {at}, {away}{self._doorway(at)}"

    def interacting(self, seen: TeamTransition) -> Interacting:
        """Return the interactions of robots in a time step."""
        return interacting_in(self._interactions, self._grid.next_cell, seen)

    def interactions(self, seen: TeamTransition) -> list[str]:
        """Return a sentence for each interaction of a time step."""
        interacting = self.interacting(seen)
        after = seen.after or ()
        sentences = []
        for robots in self._gathered(seen, interacting.together):
            sentences.append(self._together(robots, [after[k] for k in robots]))
        for k, j in interacting.exchanges:
            sentences.append(
                f"{self.names[k]} and {self.names[j]} exchange their cells."
            )
        for k in sorted({stop[0] for stop in interacting.stopped}):
            sentences.append(
                f"{self.names[k]} stays: {self._in_the_way(k, interacting)}."
            )
        return sentences

    def _together(self, robots: Sequence[int], cells: Sequence[int | None]) -> str:
        """Return a sentence: the robots that are together in some cells."""
        where = "the same cell"
        if cells[0] in self._grid.doorways:
            where = "the same doorway"
        if len(set(cells)) > 1:
            where = "doorways at the same time"
        return f"{_listed([self.names[k] for k in robots])} are in {where}."

    def _gathered(self, seen: TeamTransition, cells: Sequence[int]) -> list[list[int]]:
        """Return the groups of robots that end a time step together, in some cells."""
        places = self._interactions.places
        after = seen.after or ()
        groups = []
        for place in dict.fromkeys(int(places[cell]) for cell in cells):
            group = [
                k
                for k, cell in enumerate(after)
                if cell is not None and places[cell] == place
            ]
            groups.append(group)
        return groups

    def _in_the_way(self, robot: int, interacting: Interacting) -> str:
        """Return a text: the robots in the way of a stopped robot."""
        others = [self.names[j] for k, j, _ in interacting.stopped if k == robot]
        verb = "is" if len(others) == 1 else "are"
        return f"{_listed(others)} {verb} in its way"

    def _why_it_stays(self, robot: int, seen: TeamTransition, move: int) -> str:
        """Return the reason why a robot stays in its cell, although its move leads elsewhere."""
        interacting = self.interacting(seen)
        if any(stop[0] == robot for stop in interacting.stopped):
            return self._in_the_way(robot, interacting)
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
        if now < 0 or then < 0 or now == then:
            return f"goes {ACTIONS[move]}"
        return "goes on" if then < now else "steps back"

    def answer(self, cell: int, seen: Sequence[tuple[int, int]]) -> str:
        """Return other robots' positions in words: of all close ones, or of the closest.

        Args:
            cell: where the robot is that asks.
            seen: number and cell of each other robot, at least one.
        """
        moves = self._moves_to(cell)
        if len(seen) == 1:
            close = list(seen)
        else:
            close = [robot for robot in seen if 0 <= moves[robot[1]] <= CLOSE]
        if not close:
            reached = [robot for robot in seen if moves[robot[1]] >= 0] or seen
            peer, at = min(reached, key=lambda robot: moves[robot[1]])
            position = self.seen_from(cell, at)
            return f"the closest robot, {self.names[peer]}, is {position}"
        return "; ".join(
            f"{self.names[peer]} is {self.seen_from(cell, at)}" for peer, at in close
        )

    def question(self, seen: TeamTransition, question: Question) -> str:
        """Return a question of a time step in sentences."""
        k, peers, end, move = question
        cell = seen.cells[k]
        after = None if seen.after is None else seen.after[k]
        name = self.names[k]
        others = [(peer, at) for peer in peers if (at := seen.cells[peer]) is not None]
        end_in_words = ENDED[question.outcome]
        if end == PerceptEnd.NOBODY_TO_ASK:
            end_in_words = "There is no other robot."
        if cell is None:
            return f"{name} asks; its cell is not known. {end_in_words}"
        if question.outcome == ANSWERED and others and len(others) == len(peers):
            end_in_words = f"Answer: {self.answer(cell, others)}."
        why = "" if after != cell else self._why_it_stays(k, seen, move)
        does = self.does(k, cell, move, after, why)
        return f"{name} asks {self.where(cell)}. {end_in_words} {name} {does}."


def failing_in_words(measures: Measures) -> str:
    """Return a sentence that comes before what a team learned; empty where it does not fail.

    Args:
        measures: the measures of the team.
    """
    if not measures.failed:
        return ""
    share = percent(measures.mean("arrived"))
    return f"This team fails: all robots arrive in {share} of its greedy episodes."


def _listed(names: Sequence[str]) -> str:
    """Return names as a list in words."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def rules_in_words(scenario: Scenario) -> str:
    """Return the rules in a few sentences; an answer to every question goes without saying."""
    inter = interactions_of(scenario)
    sentences = []
    if can_miscoordinate(inter):
        sentences.append(
            f"If two robots {_miscoordination(scenario)}, {_payment(scenario)}."
        )
    if inter.blocks:
        sentences.append(f"{NARROW[scenario.kinds['block']]} holds one robot.")
    cost = f"costs {scenario.ask_cost:,g}" if scenario.ask_cost else "is free"
    sentences.append(f"A question {cost}.")
    sentences.append(_answers(scenario))
    return " ".join(sentence for sentence in sentences if sentence)


def _miscoordination(scenario: Scenario) -> str:
    """Return what two robots do that miscoordinate."""
    inter = interactions_of(scenario)
    what = []
    if (inter.places != NOWHERE).any():
        what.append(TOGETHER[scenario.kinds["together"]])
    if inter.swaps:
        what.append("exchange cells")
    return " or ".join(what)


def _payment(scenario: Scenario) -> str:
    """Return what a miscoordination costs whom."""
    price = f"{-scenario.penalty:,g}"
    if scenario.common_reward.kind == "same":
        return f"every robot pays {price}"
    return f"every robot pays its own factor times {price}"


def _answers(scenario: Scenario) -> str:
    """Return when a question is answered; an empty text where that is always."""
    model = scenario.perception
    match model.kind:
        case "always":
            return ""
        case "never":
            return "No question is answered."
        case "probability":
            return f"A question is answered with probability {model.numbers[0]:g}."
        case "range":
            return f"A question is answered within {model.numbers[0]:g} cells."
        case "line_of_sight":
            return "A question is answered where no wall is between the robots."
    return f"A question is answered as {model} says."
