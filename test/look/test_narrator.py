# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Places and moves in words, compared with ways that are searched for here in another manner."""

import re
from collections import deque
from functools import cache
from itertools import product

import numpy as np
import pytest

from sparse_coord_ros.core.game.actions import EAST, NORTH, SOUTH, WEST
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.protocol.wire import PerceptEnd
from sparse_coord_ros.show.narrator import Narrator, failing_in_words
from sparse_coord_ros.show.steps import questions_of

ALONG = {"robot_1": (1, 2), "robot_2": (1, 2)}
"""Two robots that go the same way, not toward each other."""


class Told:
    """Says on a map, by [row, column], what `Narrator` says."""

    def __init__(self, scenario):
        self.scenario = scenario
        self.words = Narrator(scenario)
        self.number = scenario.map.number

    def where(self, robot, place):
        return self.words.where(robot - 1, self.number[place])[0]

    def peer(self, robot, place, peer, at):
        cell = self.number[place]
        _, door = self.words.where(robot - 1, cell)
        return self.words.seen_from(robot - 1, cell, door, peer - 1, self.number[at])


@pytest.fixture
def env1():
    return Told(load_scenario("env1"))


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ((2, 2), "in the doorway"),
        ((2, 1), "before the doorway"),
        ((0, 0), "4 moves before the doorway"),
        ((2, 3), "1 move past the doorway"),
        ((4, 4), "4 moves past the doorway"),
    ],
)
def test_where_a_robot_is_by_its_doorway(env1, place, said):
    assert env1.where(1, place) == said


@pytest.mark.parametrize(
    ("place", "at", "said"),
    [
        # robot 1 goes from the west to the east, robot 2 comes toward it
        ((2, 1), (2, 3), "on the other side, 2 moves away"),
        ((2, 1), (0, 4), "on the other side, 5 moves away"),
        ((2, 1), (2, 2), "in the doorway"),
        ((2, 1), (2, 1), "in the same cell"),
        ((2, 1), (1, 1), "beside robot_1"),
        ((2, 1), (1, 0), "on this side, past the doorway, 2 moves away"),
        ((0, 0), (2, 2), "in the doorway"),
        ((0, 0), (0, 4), "on the other side, 8 moves away"),
        ((0, 0), (4, 0), "on this side, past the doorway, 4 moves away"),
        ((2, 2), (2, 3), "right ahead of robot_1"),
        ((2, 2), (4, 4), "ahead of robot_1, 4 moves away"),
        ((2, 2), (2, 1), "right behind robot_1, past the doorway"),
        ((2, 2), (2, 2), "in the same cell"),
        ((2, 3), (2, 1), "on the other side, past the doorway, 2 moves away"),
        ((2, 3), (2, 2), "in the doorway"),
        ((2, 3), (0, 3), "on this side, 2 moves away"),
    ],
)
def test_where_a_peer_is_seen_from_a_robot(env1, place, at, said):
    assert env1.peer(1, place, 2, at) == said


def test_a_peer_that_went_ahead_is_past_the_doorway(make):
    told = Told(make("1..D..2", robots=ALONG))
    assert (
        told.peer(1, (0, 1), 2, (0, 5))
        == "on the other side, past the doorway, 4 moves away"
    )
    assert told.peer(1, (0, 1), 2, (0, 3)) == "in the doorway"
    assert (
        told.peer(1, (0, 3), 2, (0, 5))
        == "ahead of robot_1, past the doorway, 2 moves away"
    )
    assert told.peer(1, (0, 3), 2, (0, 1)) == "behind robot_1, 2 moves away"
    assert told.peer(1, (0, 5), 2, (0, 3)) == "in the doorway"
    assert told.peer(1, (0, 0), 2, (0, 2)) == "on this side, 2 moves away"


def test_a_map_without_a_doorway(make):
    told = Told(make("1....\n##.##\n....2"))
    assert told.where(1, (0, 2)) == "in cell 2 [0, 2]"
    assert told.peer(1, (0, 2), 2, (0, 2)) == "in the same cell"
    assert told.peer(1, (0, 2), 2, (1, 2)) == "beside robot_1"
    assert told.peer(1, (0, 2), 2, (2, 4)) == "4 moves away"


def test_a_passage_of_doorway_cells_is_one_doorway(make):
    told = Told(make("1..DDD..2"))
    assert told.where(1, (0, 0)) == "3 moves before the doorway"
    assert told.where(1, (0, 4)) == "in the doorway"
    assert told.peer(1, (0, 2), 2, (0, 3)) == "in the doorway, beside robot_1"
    assert told.peer(1, (0, 2), 2, (0, 5)) == "in the doorway, 3 moves away"
    assert told.peer(1, (0, 2), 2, (0, 6)) == "on the other side, 4 moves away"
    assert told.peer(1, (0, 3), 2, (0, 5)) == "in the doorway, 2 moves away"
    assert told.peer(1, (0, 3), 2, (0, 6)) == "ahead of robot_1, 3 moves away"
    assert (
        told.peer(1, (0, 5), 2, (0, 2))
        == "behind robot_1, past the doorway, 3 moves away"
    )


def test_a_wide_doorway(make):
    told = Told(make("1.D..\n..D.2"))
    assert told.where(1, (1, 1)) == "before the doorway"
    assert told.peer(1, (0, 1), 2, (1, 2)) == "in the doorway, 2 moves away"
    assert told.peer(1, (0, 1), 2, (1, 3)) == "on the other side, 3 moves away"
    assert (
        told.peer(1, (0, 2), 2, (1, 1))
        == "behind robot_1, past the doorway, 2 moves away"
    )


def test_several_doorways():
    told = Told(load_scenario("env2-2r"))  # four rooms in a ring
    assert told.where(1, (0, 1)) == "4 moves before a doorway"
    assert told.where(1, (2, 2)) == "before a doorway"
    cell = told.number[2, 2]
    number = told.number
    east, south = (
        told.words.where(0, cell, number[place])[1] for place in ((2, 3), (3, 2))
    )
    assert east != south, "it is said by the doorway that the robot enters"
    seen = {
        place: [
            told.words.seen_from(0, cell, door, 1, number[place])
            for door in (east, south)
        ]
        for place in ((2, 3), (2, 4), (4, 2), (4, 4), (6, 4), (1, 1))
    }
    assert seen[2, 3] == ["in the doorway", "in another doorway, beside robot_1"]
    another = "on the other side of another doorway, 2 moves away"
    assert seen[2, 4] == ["on the other side, 2 moves away", another]
    beyond = "on the other side, past the doorway, 2 moves away"
    assert seen[4, 2] == [another, beyond]
    assert seen[4, 4] == ["4 moves away"] * 2  # the room across, by either doorway
    assert seen[6, 4] == ["6 moves away"] * 2
    came = "on this side, past the doorway, 2 moves away"
    assert seen[1, 1] == [came, "on this side, 2 moves away"]


def test_doorways_one_behind_the_other(make):
    told = Told(make("1..D.D..2"))
    # it has passed one, and is before the next
    assert told.where(1, (0, 4)) == "before a doorway"
    assert (
        told.peer(1, (0, 2), 2, (0, 5))
        == "on the other side, in another doorway, 3 moves away"
    )
    assert told.peer(1, (0, 2), 2, (0, 8)) == "on the other side, 6 moves away"
    behind = "on the other side of another doorway, 2 moves away"
    assert told.peer(1, (0, 4), 2, (0, 2)) == behind
    assert (
        told.peer(1, (0, 3), 2, (0, 5))
        == "ahead of robot_1, in another doorway, 2 moves away"
    )


def test_a_doorway_where_several_rooms_meet():
    told = Told(load_scenario("pentagon"))
    assert told.where(1, (4, 8)) == "before a doorway"
    for at in ((3, 9), (5, 9), (4, 10)):
        assert told.peer(1, (4, 8), 2, at) == "on another side, 2 moves away"
    assert told.peer(1, (4, 8), 2, (4, 9)) == "in the doorway"
    assert told.peer(1, (4, 8), 2, (4, 7)) == "in another doorway, beside robot_1"
    # two ways, ahead and behind
    assert told.peer(2, (4, 9), 1, (8, 0)) == "13 moves away"


def test_a_doorway_in_a_ring_has_one_room_on_both_sides(make):
    told = Told(
        make("1....\n.###.\n.###.\n..D.2", robots={"robot_1": ([3, 1], [3, 3])})
    )
    assert told.where(1, (3, 1)) == "before the doorway"
    assert (
        told.peer(1, (3, 1), 1, (3, 4))
        == "on the other side, past the doorway, 3 moves away"
    )
    assert told.peer(1, (3, 1), 1, (0, 0)) == "on this side, 4 moves away"
    assert told.peer(1, (3, 1), 1, (0, 3)) == "7 moves away"  # as far either way


def test_a_doorway_that_is_not_on_the_way(make):
    told = Told(make("1....2\n..##D#\n..##.."))
    assert told.where(1, (0, 4)) == "next to the doorway"
    assert told.where(1, (0, 2)) == "3 moves from the doorway"
    assert told.peer(1, (0, 4), 2, (2, 4)) == "on the other side, 2 moves away"
    assert told.where(1, (2, 4)) == "before the doorway"


def test_rooms_without_a_way_between_them(make):
    told = Told(make("1..D.2\n######\n...D.."))
    assert told.where(1, (2, 2)) == "next to a doorway"
    assert (
        told.peer(1, (0, 1), 2, (2, 0)) == "in cell 6 [2, 0], to which there is no way"
    )
    assert (
        told.peer(1, (0, 0), 2, (0, 2))
        == "on this side, past the doorway, 2 moves away"
    )
    alone = Told(make("1.D.2\n#####\n....."))
    assert alone.where(1, (2, 2)) == "in cell 7 [2, 2]"


@pytest.mark.parametrize(
    ("others", "said"),
    [
        ([(2, 3)], "robot_2 is on the other side, 2 moves away"),
        ([(2, 3), (4, 4)], "robot_2 is on the other side, 2 moves away"),
        ([(2, 2), (1, 1)], "robot_2 is in the doorway; robot_3 is beside robot_1"),
        ([(4, 4), (4, 0)], "the closest robot, robot_3, is on this side, 3 moves away"),
    ],
)
def test_of_several_robots_those_that_are_close_are_told(make, others, said):
    places = {"robot_1": (1, 2), "robot_2": (2, 1), "robot_3": ([1, 0], [1, 1])}
    told = Told(make("1.#.2\n..#..\n..D..\n..#..\n..#..", robots=places))
    cell = told.number[2, 1]
    _, door = told.words.where(0, cell)
    seen = [(k, told.number[place]) for k, place in enumerate(others, start=1)]
    assert told.words.answer(0, cell, door, seen) == said


@pytest.mark.parametrize(
    ("end", "said"),
    [
        (PerceptEnd.ANSWERED, "Answer: robot_2 is on the other side, 2 moves away."),
        (PerceptEnd.REFUSED, "The question is refused."),
        (PerceptEnd.LATE, "No answer comes."),
        (PerceptEnd.NOBODY_TO_ASK, "There is no other robot."),
    ],
)
def test_a_question_in_sentences(env1, end, said):
    west, door, east = (env1.number[2, column] for column in (1, 2, 3))
    perceived = end == PerceptEnd.ANSWERED
    asking = Action(EAST, True, 1, perceived), Action(WEST, False, -1, False)
    seen = TeamTransition(3, (west, east), asking, (door, east), False, (), (end, None))
    [question] = questions_of(seen)
    due = f"robot_1 asks before the doorway. {said} robot_1 goes on."
    assert env1.words.question(seen, question) == due
    unknown = env1.words.question(seen._replace(cells=(None, east)), question)
    assert unknown.startswith("robot_1 asks; its cell is not known. ")
    unseen = env1.words.question(seen._replace(cells=(west, None)), question)
    assert "is on the other side" not in unseen


@pytest.mark.parametrize(
    ("move", "after", "said"),
    [
        (EAST, (2, 2), "goes on"),
        (WEST, (2, 0), "steps back"),
        (EAST, (2, 1), "stays: its move east fails"),
        (EAST, None, "chooses east"),
        (NORTH, (4, 4), "goes on"),  # far away, as in a damaged log
    ],
)
def test_what_a_robot_does(env1, move, after, said):
    cell = None if after is None else env1.number[after]
    assert env1.words.does(0, env1.number[2, 1], move, cell) == said


def test_a_robot_that_moves_against_a_wall_waits(env1):
    assert env1.words.does(0, env1.number[0, 0], NORTH, env1.number[0, 0]) == "waits"
    assert env1.words.does(1, env1.number[1, 1], SOUTH, env1.number[1, 1]) != "waits"


def moves_from(grid, begin, closed=()):
    """Return the moves from a cell to all that can be reached without entering closed cells."""
    found = {begin: 0}
    front = deque([begin])
    while front:
        cell = front.popleft()
        for after in grid.next_cell[cell].tolist():
            if after not in found and after not in closed:
                found[after] = found[cell] + 1
                front.append(after)
    return found


class Ways:
    """What is true of cells of a map."""

    def __init__(self, scenario):
        self.grid = scenario.map
        self.robots = scenario.robots
        self.doorways = self.grid.doorways
        self.moves = cache(lambda cell: moves_from(self.grid, cell))
        self.closed = cache(lambda cell, closed: moves_from(self.grid, cell, closed))
        outside = set(range(len(self.grid.cells))) - self.doorways
        self.passage = {
            c: frozenset(moves_from(self.grid, c, outside)) for c in self.doorways
        }
        self.room = {
            c: frozenset(moves_from(self.grid, c, self.doorways)) for c in outside
        }

    def joins(self, doorway, cell, other):
        """Whether a doorway is between the rooms of two cells, and on a shortest way."""
        beside = {
            after for door in doorway for after in self.grid.next_cell[door].tolist()
        }
        rooms = self.room[cell], self.room[other]
        through = min(
            self.moves(cell)[door] + self.moves(other)[door] for door in doorway
        )
        shortest = through == self.moves(cell)[other]
        return (
            rooms[0] != rooms[1] and shortest and all(beside & room for room in rooms)
        )

    def parts(self, closed, cell, other):
        """Whether all shortest ways between two cells lead through closed cells."""
        return self.closed(cell, closed).get(other, 9**9) > self.moves(cell)[other]

    def on_the_way(self, doorway, begin, end):
        """Whether a shortest way leads through a doorway."""
        one = self.moves(begin)
        other = self.moves(end)
        return any(one[door] + other[door] == one[end] for door in doorway)

    def first_moves(self, doorway, begin, end):
        """Return by which cells shortest ways leave a doorway; they may lead through it again."""
        left = set()
        for cell in {
            c for door in doorway for c in self.grid.next_cell[door].tolist()
        } - doorway:
            if (
                self.moves(begin)[cell] + self.moves(cell)[end]
                == self.moves(begin)[end]
            ):
                left.add(cell)
        return left

    def is_true(self, part, k, cell, doorway, peer, at):
        """Whether a part of a phrase is true."""
        far = self.moves(cell)[at]
        name = self.robots[k].name
        goal = self.robots[k].goal
        if part.startswith("right "):
            return far == 1 and self.is_true(part[6:], k, cell, doorway, peer, at)
        if away := re.fullmatch("([0-9]+) moves away", part):
            return far == int(away[1]) > 1
        if part in (f"ahead of {name}", f"behind {name}"):
            own, others = (self.first_moves(doorway, cell, end) for end in (goal, at))
            return (
                others <= own
                if "ahead" in part
                else others and own and not others & own
            )
        others = set(self.passage.values()) - {doorway}

        def is_across(door):
            return self.parts(door, cell, at) or self.joins(door, cell, at)

        return {
            "in the same cell": lambda: at == cell,
            f"beside {name}": lambda: far == 1,
            "in the doorway": lambda: at in doorway,
            "in another doorway": lambda: at in self.doorways and at not in doorway,
            "on the other side": lambda: is_across(doorway),
            "on another side": lambda: is_across(doorway),
            "on this side": lambda: (
                at in self.room[cell] and not self.on_the_way(self.doorways, cell, at)
            ),
            "on the other side of another doorway": lambda: any(
                self.joins(other, cell, at) for other in others
            ),
            "past the doorway": lambda: (
                self.on_the_way(doorway, self.robots[peer].start, at)
                and not self.on_the_way(doorway, at, self.robots[peer].goal)
            ),
        }[part]()  # fmt: skip


GENERATED = ("doors-2r-1", "loop-2r-1", "corridor-2r-1", "crossing-2r-1", "rooms-4r-1")
MAPS = (
    "env1",
    "env2-2r",
    "pentagon",
    "crowd-3r",
    "cit",
    *(f"unseen1-{one}" for one in GENERATED),
)


@pytest.mark.parametrize("name", MAPS)
def test_every_phrase_is_true_of_all_cells(name):
    """Of a robot in each cell and a peer in each cell; no phrase is too much, and one is there."""
    scenario = load_scenario(name)
    words = Narrator(scenario)
    ways = Ways(scenario)
    cells = range(len(scenario.map.cells))
    last = len(scenario.robots) - 1
    said = set()
    for (k, peer), cell in product(((0, last), (last, 0)), cells):
        place, door = words.where(k, cell)
        doorway = frozenset(np.flatnonzero(words.doorways.of == door).tolist())
        assert doorway in ways.passage.values()
        check_place(ways, place, k, cell, doorway)
        for at in cells:
            phrase = words.seen_from(k, cell, door, peer, at)
            for part in phrase.split(", "):
                assert ways.is_true(part, k, cell, doorway, peer, at), (
                    place,
                    cell,
                    at,
                    phrase,
                )
                said.add(re.sub(r"\d+", "N", part))
    assert {"in the same cell", "in the doorway", "N moves away"} <= said


def check_place(ways, place, k, cell, doorway):
    """Check where a robot is said to be."""
    goal = ways.robots[k].goal
    start = ways.robots[k].start
    far = min(ways.moves(cell)[door] for door in doorway)
    ahead = ways.on_the_way(doorway, cell, goal)
    the = "the doorway" if len(set(ways.passage.values())) == 1 else "a doorway"
    if place == f"in {the}":
        assert far == 0
    elif before := re.fullmatch(f"(?:([0-9]+) moves )?before {the}", place):
        # fmt: skip
        on_the_way = [
            ways.moves(cell)[door]
            for door in doorway
            if ways.moves(cell)[door] + ways.moves(door)[goal] == ways.moves(cell)[goal]
        ]
        assert ahead and min(on_the_way) == int(before[1] or 1)
    elif past := re.fullmatch(f"([0-9]+) moves? past {the}", place):
        assert (
            far == int(past[1]) and not ahead and ways.on_the_way(doorway, start, cell)
        )
    else:
        away = re.fullmatch(f"([0-9]+) moves from {the}|next to {the}", place)
        assert far == int(away[1] or 1) and not ahead


def one_step(scenario, before, after, moves, *, miscoordination=False):
    """Return a time step of robots that ask nothing, by places [row, column]."""
    number = scenario.map.number
    actions = tuple(Action(move, False, -1, False) for move in moves)
    cells = [tuple(number[one] for one in places) for places in (before, after)]
    return TeamTransition(0, cells[0], actions, cells[1], miscoordination)


@pytest.mark.parametrize(
    ("interactions", "before", "after", "moves", "said"),
    [
        (
            "together",
            [(2, 1), (2, 3)],
            [(2, 2), (2, 2)],
            (EAST, WEST),
            ["robot_1 and robot_2 are in the same doorway."],
        ),
        (
            "together:anywhere",
            [(0, 0), (1, 1)],
            [(0, 1), (0, 1)],
            (EAST, NORTH),
            ["robot_1 and robot_2 are in the same cell."],
        ),
        (
            "swap",
            [(2, 1), (2, 2)],
            [(2, 2), (2, 1)],
            (EAST, WEST),
            ["robot_1 and robot_2 exchange their cells."],
        ),
        (
            "block",
            [(2, 1), (2, 3)],
            [(2, 2), (2, 3)],
            (EAST, WEST),
            ["robot_2 stays: robot_1 is in its way."],
        ),
        # The first robot goes first: that it stays is its own move's failure.
        ("block", [(2, 1), (2, 3)], [(2, 1), (2, 2)], (EAST, WEST), []),
        # No cell but the doorway holds only one robot.
        ("block", [(0, 0), (0, 1)], [(0, 0), (0, 1)], (EAST, WEST), []),
        ("together", [(2, 1), (2, 3)], [(2, 2), (2, 3)], (EAST, WEST), []),
    ],
)
def test_interactions_in_sentences(interactions, before, after, moves, said):
    scenario = load_scenario("env1", interactions=interactions)
    met = interactions != "block" and bool(said)
    seen = one_step(scenario, before, after, moves, miscoordination=met)
    assert Narrator(scenario).interactions(seen) == said


def test_a_robot_that_asks_and_is_stopped_says_by_which_one():
    scenario = load_scenario("env1", interactions="block")
    seen = one_step(scenario, [(2, 1), (2, 3)], [(2, 2), (2, 3)], (EAST, WEST))
    asking = Action(WEST, True, 0, True)
    seen = seen._replace(actions=(seen.actions[0], asking))
    [question] = questions_of(seen)
    told = Narrator(scenario).question(seen, question)
    assert told.endswith("robot_2 stays: robot_1 is in its way.")
    slipped = seen._replace(after=(seen.cells[0], seen.cells[1]))
    told = Narrator(scenario).question(slipped, question)
    assert told.endswith("robot_2 stays: its move west fails.")


@pytest.mark.parametrize(
    ("share", "told"), [(1.0, ""), (0.9995, ""), (0.998, "99.8 %"), (0.0, "0 %")]
)
def test_of_a_team_that_fails_it_is_said_how_often_all_arrive(share, told):
    text = failing_in_words(share)
    if not told:
        assert text == ""
        return
    assert text == (
        f"This team fails: all robots arrive in {told} of its greedy episodes."
    )
