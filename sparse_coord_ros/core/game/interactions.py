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

Functions of two robots take plain numbers and arrays alike. Those of a team run on lists in plain
Python and on arrays in compiled loops; the last two take arrays of many steps at once.
"""

from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import inlined, inner
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.scenario import Scenario

NOWHERE = -1
"""The meeting place of a robot that can meet nobody where it is, or is not in the game."""


class Interactions(NamedTuple):
    """The interactions of a scenario, by cell.

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
    cells = len(scenario.map.cells)
    kinds = scenario.kinds
    exempt = [robot.goal for robot in scenario.robots]
    passages = np.zeros(cells, dtype=bool)
    if "swap" in kinds:
        passages[:] = True
        passages[exempt] = False
    narrow = np.zeros(cells, dtype=bool)
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


def check_only_together(scenario: Scenario, what: str, remedy: str) -> None:
    """Raise `SettingError` unless robots interact at most by being together.

    Args:
        scenario: the problem.
        what: what cannot plan with other interactions.
        remedy: what to do.
    """
    if not only_together(interactions_of(scenario)):
        allowed = "together, together:anywhere or together:any_doorway"
        raise SettingError(
            f"{what}: setting interactions is {scenario.interactions!r}, allowed: {allowed}, as "
            f"it plans by the cells in which steps end; {remedy}"
        )


def of_cells(inter: Interactions, cells: np.ndarray) -> Interactions:
    """Return the interactions in some cells, which are then numbered from 0."""
    return inter._replace(
        places=inter.places[cells],
        passages=inter.passages[cells],
        narrow=inter.narrow[cells],
    )


def none_of(inter: Interactions) -> Interactions:
    """Return that there are no interactions in these cells."""
    return Interactions(
        places=np.full_like(inter.places, NOWHERE),
        swaps=False,
        passages=np.zeros_like(inter.passages),
        blocks=False,
        narrow=np.zeros_like(inter.narrow),
    )


def as_lists(inter: Interactions) -> Interactions:
    """Return interactions with lists in place of arrays, which plain Python reads faster."""
    return inter._replace(
        places=inter.places.tolist(),
        passages=inter.passages.tolist(),
        narrow=inter.narrow.tolist(),
    )


def _where(scenario: Scenario, place: str) -> list[int]:
    """Return the cells in which a kind of interaction holds, goals included, ascending."""
    if place == "anywhere":
        return list(range(len(scenario.map.cells)))
    return sorted(scenario.map.doorways)


def _places(scenario: Scenario, place: str | None) -> np.ndarray:
    """Return the meeting place of each cell; `place` is None where there is none."""
    places = np.full(len(scenario.map.cells), NOWHERE, dtype=np.int64)
    if place is None:
        return places
    cells = _where(scenario, place)
    places[cells] = 0 if place == "any_doorway" else cells
    if place == "anywhere":
        places[[robot.goal for robot in scenario.robots]] = NOWHERE
    return places


# Two robots.


@inner
def together(place: Any, other: Any) -> Any:
    """Return whether robots at two meeting places are together: a bool, or an array of bools."""
    return (place == other) & (place != NOWHERE)


@inner
def exchanged(passages: Any, x: Any, y: Any, z: Any, w: Any) -> Any:
    """Return whether a robot that went from x to y exchanged cells with one from z to w.

    All are numbers, or arrays of one shape.
    """
    return (x != y) & (x == w) & (y == z) & passages[x] & passages[y]


@inner
def stops(c: Any, x: Any, z: Any, w: Any, first: bool) -> Any:
    """Return whether a robot stops another one that wants from x into narrow cell c.

    Args:
        c: the narrow cell.
        x: another cell.
        z: the cell of the robot that may be in the way.
        w: the cell that it wants, or in which it stays.
        first: whether it goes first where both want into the cell.
    """
    there = (w == c) & ((z == c) | first)
    towards = (z == c) & (w == x)
    return there | towards


@inner
def stopped_by(c: Any, x: Any, z: Any, w: Any) -> Any:
    """Return whether a robot that went from z to w stopped one that wanted from x into c."""
    return (w == c) | ((z == c) & (w == x))


@inner
def ends_of_two(inter: Interactions, x: int, z: int, y: int, w: int) -> tuple[int, int]:
    """Return where two robots end that want from x to y and from z to w.

    The rule is that of `settle`. Of two robots one look at each is enough: a second one that is
    stopped does not stop the first one, which goes elsewhere, or into a cell that is not narrow.

    Args:
        inter: the interactions.
        x: the cell of the first robot before the step.
        z: that of the second.
        y: the cell that the first robot wants; its own one where its move slipped.
        w: that of the second.
    """
    if y != x and inter.narrow[y] and stops(y, x, z, w, False):
        y = x
    if w != z and inter.narrow[w] and stops(w, z, x, y, True):
        w = z
    return y, w


@inner
def miscoordinate_two(inter: Interactions, x: int, z: int, y: int, w: int) -> bool:
    """Return whether a step of two robots from x to y and from z to w is a miscoordination."""
    if together(inter.places[y], inter.places[w]):
        return True
    return bool(inter.swaps and exchanged(inter.passages, x, y, z, w))


# A team.


@inlined
def settle(inter: Interactions, before: Any, cells: Any, members: Any) -> None:
    """Stop the robots that cannot go where they want.

    Robots are looked at in their order, and again as long as one was stopped: it may stop others.

    Args:
        inter: the interactions.
        before: the cell of each robot before the step [k].
        cells: the cell that each robot wants; changed to the cell in which it ends [k].
        members: the robots that are in the game, ascending.
    """
    again = inter.blocks
    while again:
        again = False
        for k in members:
            c = cells[k]
            if c != before[k] and inter.narrow[c]:
                if is_stopped(before, cells, members, k):
                    cells[k] = before[k]
                    again = True


@inner
def is_stopped(before: Any, cells: Any, members: Any, k: int) -> bool:
    """Return whether robot k, which wants into a narrow cell, is stopped; as of `settle`."""
    for j in members:
        if j != k and stops(cells[k], before[k], before[j], cells[j], j < k):
            return True
    return False


@inlined
def miscoordinate(inter: Interactions, before: Any, cells: Any, members: Any) -> bool:
    """Return whether a step is a miscoordination: two robots are together, or exchanged cells.

    Args:
        inter: the interactions.
        before: the cell of each robot before the step [k].
        cells: the cell in which each robot ends [k].
        members: the robots that are in the game.
    """
    if meet(inter.places, cells, members):
        return True
    return inter.swaps and any_exchange(inter.passages, before, cells, members)


@inlined
def meet(places: Any, cells: Any, members: Any) -> bool:
    """Return whether two of the members are together.

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


@inner
def any_exchange(passages: Any, before: Any, cells: Any, members: Any) -> bool:
    """Return whether two of the members exchanged cells; arguments as of `miscoordinate`."""
    for i in range(len(members)):
        k = members[i]
        for n in range(i):
            j = members[n]
            if exchanged(passages, before[k], cells[k], before[j], cells[j]):
                return True
    return False


@inlined
def interacting(
    inter: Interactions, before: Any, wanted: Any, cells: Any, members: Any, k: int
) -> int:
    """Return the robots with which robot k interacts in a step, the sum of 2^j; 0: with none.

    Args:
        inter: the interactions.
        before: the cell of each robot before the step [k].
        wanted: the cell that each robot wanted; its own one where the move slipped [k].
        cells: the cell in which each robot ends [k].
        members: the robots that are in the game.
        k: the robot.
    """
    y = cells[k]
    found = 0
    if inter.places[y] == NOWHERE and not inter.swaps and y == wanted[k]:
        return found
    for j in members:
        if j != k and interact(inter, before, wanted, cells, k, j):
            found |= 1 << j
    return found


@inlined
def interact(
    inter: Interactions, before: Any, wanted: Any, cells: Any, k: int, j: int
) -> bool:
    """Return whether robot k interacts with robot j in a step.

    Other arguments are as of `interacting`.
    """
    y = cells[k]
    z = cells[j]
    if together(inter.places[y], inter.places[z]):
        return True
    if inter.swaps and exchanged(inter.passages, before[k], y, before[j], z):
        return True
    return bool(y != wanted[k] and stopped_by(wanted[k], y, before[j], z))


# A team in many steps.


def settled(inter: Interactions, before: Any, wanted: Any) -> np.ndarray:
    """Return where robots end that want to certain cells; the rule is that of `settle`.

    Args:
        inter: the interactions.
        before: the cell of each robot before the step, shape (K, ...).
        wanted: the cell that it wants, same shape.

    Returns:
        Same shape.
    """
    cells = np.array(wanted)
    team = len(cells)
    again = inter.blocks
    while again:
        again = False
        for k in range(team):
            stop = np.zeros(cells.shape[1:], dtype=bool)
            for j in range(team):
                if j != k:
                    stop |= stops(cells[k], before[k], before[j], cells[j], j < k)
            stop &= (cells[k] != before[k]) & inter.narrow[cells[k]]
            cells[k] = np.where(stop, before[k], cells[k])
            again = again or bool(stop.any())
    return cells


def miscoordinations(inter: Interactions, before: Any, after: Any) -> np.ndarray:
    """Return which steps are miscoordinations; the rule is that of `miscoordinate`.

    Args:
        inter: the interactions.
        before: the cell of each robot before the step, shape (K, ...); a negative number: it is
            not known.
        after: the cell in which it ended, same shape.

    Returns:
        Shape (...), bool.
    """
    before = np.asarray(before)
    after = np.asarray(after)
    places = np.where(after < 0, NOWHERE, inter.places[after])
    found: np.ndarray = np.zeros(after.shape[1:], dtype=bool) | any_together(places)
    if inter.swaps:
        known = (before >= 0) & (after >= 0)
        for k in range(len(after)):
            for j in range(k):
                swapped = exchanged(
                    inter.passages, before[k], after[k], before[j], after[j]
                )
                found |= known[k] & known[j] & swapped
    return found


def any_together(places: Any) -> Any:
    """Return whether two robots are together.

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
