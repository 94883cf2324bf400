# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How robots interact: what two of them do to each other by where they are and where they go.

A scenario names its kinds of interaction, such as `together+swap`:

- `together`: two robots end a step in one doorway (paper, Section 4). All pay r^C.
- `swap`: two robots exchange their cells in a step. All pay r^C.
- `block`: a doorway holds one robot; a second one that wants in stays where it is. Nobody pays.

A step that costs r^C is a *miscoordination*. `together` and `block` can also hold anywhere on the
map. Goals are exempt from `swap` and `block`, and from `together:anywhere`: they hold any number
of robots, and robots that have arrived are in nobody's way.

The rules of `block`: a robot may follow one that leaves a cell, and robots may go around in a
circle. It may not enter a cell whose robot comes towards it. Of several that want into a free cell
the one with the lowest number goes. A robot that slips stays, and holds its cell. Two robots that
begin an episode in one cell may both leave it.

A step of a team is three arrays of cells, one cell a robot: `before` the step, `wanted`, and
`after` it. `settle`, `miscoordinates` and `partners` look at one step, in plain Python and in
compiled loops. `settled` and `miscoordinations` look at many steps, by NumPy.
"""

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.core.game.scenario import Scenario

NOWHERE = -1
"""The meeting place of a robot that can meet nobody where it is, or is not in the game."""


class Interactions(NamedTuple):
    """The interactions of a scenario, by cell.

    The last entry of each array is that of no cell: number -1, where a log lacks a robot's cell.

    Attributes:
        places: the meeting place of a cell: robots at one place are together; or `NOWHERE` [x].
        swaps: whether robots that exchange cells interact.
        passages: whether a cell can be exchanged [x].
        blocks: whether any cell holds only one robot.
        narrow: whether a cell holds only one robot [x].
    """

    places: Any
    swaps: bool
    passages: Any
    blocks: bool
    narrow: Any


def interactions_of(scenario: Scenario) -> Interactions:
    """Return the interactions of a scenario, as arrays."""
    entries = len(scenario.map.cells) + 1
    kinds = scenario.kinds
    exempt = [robot.goal for robot in scenario.robots]
    passages = np.zeros(entries, dtype=bool)
    if "swap" in kinds:
        passages[:-1] = True
        passages[exempt] = False
    narrow = np.zeros(entries, dtype=bool)
    if "block" in kinds:
        narrow[_where(scenario, kinds["block"])] = True
        narrow[exempt] = False
    return Interactions(
        places=_places(scenario, kinds.get("together")),
        swaps=bool(passages.any()),
        passages=passages,
        blocks=bool(narrow.any()),
        narrow=narrow,
    )


def can_miscoordinate(inter: Interactions) -> bool:
    """Return whether there is any cell in which robots miscoordinate: whether any pays r^C."""
    return inter.swaps or bool((inter.places != NOWHERE).any())


def only_together(inter: Interactions) -> bool:
    """Return whether robots interact at most by being together, where a step ends.

    If so, no robot changes where another one goes, and it does not matter where they come from.
    """
    return not (inter.swaps or inter.blocks)


def _where(scenario: Scenario, variant: str) -> list[int]:
    """Return the cells in which a kind of interaction holds, goals included, ascending."""
    if variant == "anywhere":
        return list(range(len(scenario.map.cells)))
    return sorted(scenario.map.doorways)


def _places(scenario: Scenario, variant: str | None) -> np.ndarray:
    """Return the meeting place of each cell; `variant` is None where there is none."""
    places = np.full(len(scenario.map.cells) + 1, NOWHERE, dtype=np.int64)
    if variant is None:
        return places
    cells = _where(scenario, variant)
    places[cells] = 0 if variant == "any_doorway" else cells
    if variant == "anywhere":
        places[[robot.goal for robot in scenario.robots]] = NOWHERE
    return places


# Two robots: numbers, or arrays of one shape.


@jitable
def together(place: Any, other: Any) -> Any:
    """Return whether robots at two meeting places are together."""
    return (place == other) & (place != NOWHERE)


@jitable
def exchanged(passages: Any, x: Any, y: Any, z: Any, w: Any) -> Any:
    """Return whether a robot that went from x to y exchanged cells with one from z to w."""
    return (x != y) & (x == w) & (y == z) & passages[x] & passages[y]


@jitable
def stops(c: Any, x: Any, z: Any, w: Any, first: bool) -> Any:
    """Return whether a robot stops another one that wants from x into narrow cell c.

    Args:
        c: the narrow cell.
        x: another cell.
        z: the cell of the robot that may be in the way.
        w: the cell that it wants, or in which it ends.
        first: whether it goes first where both want into the cell; True if the step is over.
    """
    there = (w == c) & ((z == c) | first)
    towards = (z == c) & (w == x)
    return there | towards


# One step of a team.


@jitable
def settle(inter: Interactions, before: Any, cells: Any) -> None:
    """Stop the robots that cannot go where they want.

    Robots are looked at in their order, and again as long as one was stopped: it may stop others.

    Args:
        inter: the interactions.
        before: the cell of each robot before the step [k].
        cells: the cell that each robot wants; changed to the cell in which it ends [k].
    """
    again = inter.blocks
    while again:
        again = False
        for k in range(len(cells)):
            c = cells[k]
            x = before[k]
            if c == x or not inter.narrow[c]:
                continue
            for j in range(len(cells)):
                if j != k and stops(c, x, before[j], cells[j], j < k):
                    cells[k] = x
                    again = True
                    break


@jitable
def miscoordinates(inter: Interactions, before: Any, after: Any) -> bool:
    """Return whether a step is a miscoordination: two robots are together, or exchanged cells.

    Args:
        inter: the interactions.
        before: the cell of each robot before the step [k].
        after: the cell in which it ended [k].
    """
    for k in range(len(after)):
        y = after[k]
        place = inter.places[y]
        if place == NOWHERE and not inter.swaps:
            continue
        for j in range(k):
            w = after[j]
            if together(place, inter.places[w]):
                return True
            if inter.swaps and exchanged(inter.passages, before[k], y, before[j], w):
                return True
    return False


@jitable
def partners(inter: Interactions, before: Any, wanted: Any, after: Any, k: int) -> int:
    """Return the robots with which robot k interacts in a step, the sum of 2^j; 0: with none.

    Args:
        inter: the interactions.
        before: the cell of each robot before the step [k].
        wanted: the cell that it wanted; its own one where the move slipped [k].
        after: the cell in which it ended [k].
        k: the robot.
    """
    y = after[k]
    place = inter.places[y]
    stopped = y != wanted[k]
    mask = 0
    if place == NOWHERE and not inter.swaps and not stopped:
        return mask
    for j in range(len(after)):
        if j == k:
            continue
        z = before[j]
        w = after[j]
        interacts = together(place, inter.places[w])
        if inter.swaps:
            interacts |= exchanged(inter.passages, before[k], y, z, w)
        if stopped:
            interacts |= stops(wanted[k], y, z, w, True)
        if interacts:
            mask |= 1 << j
    return mask


# Many steps at once.


def settled(inter: Interactions, before: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return where robots end that want to certain cells, as `settle` does.

    Args:
        inter: the interactions.
        before: the cell of each robot before each step, shape (K, N).
        wanted: the cell that it wants, same shape.

    Returns:
        The cell in which it ends, same shape.
    """
    after = np.array(wanted)
    team = range(len(after))
    again = inter.blocks
    while again:
        again = False
        for k in team:
            c = after[k]
            x = before[k]
            stopped = np.zeros(c.shape, dtype=bool)
            for j in team:
                if j != k:
                    stopped |= stops(c, x, before[j], after[j], j < k)
            stopped &= (c != x) & inter.narrow[c]
            after[k] = np.where(stopped, x, c)
            again |= bool(stopped.any())
    return after


def miscoordinations(
    inter: Interactions, before: np.ndarray, after: np.ndarray
) -> np.ndarray:
    """Return which steps are miscoordinations, as `miscoordinates` does.

    Args:
        inter: the interactions.
        before: the cell of each robot before each step, shape (K, N); -1: not known.
        after: the cell in which it ended, same shape.

    Returns:
        Shape (N,), bool.
    """
    happened = np.zeros(after.shape[1], dtype=bool)
    places = inter.places[after]
    for k, j in combinations(range(len(after)), 2):
        happened |= together(places[k], places[j])
        if inter.swaps:
            happened |= exchanged(
                inter.passages, before[k], after[k], before[j], after[j]
            )
    return happened
