# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Places and moves in words."""

import numpy as np
import pytest

from sparse_coord_ros.core.game.actions import EAST, NORTH, SOUTH, WEST
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.measures import TRIAL, TRIALS, Measures
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.protocol.wire import PerceptEnd
from sparse_coord_ros.show.narrator import Narrator, failing_in_words
from sparse_coord_ros.show.steps import questions_of


class Told:
    """Says on a map, by [row, column], what `Narrator` says."""

    def __init__(self, scenario):
        self.words = Narrator(scenario)
        self.number = scenario.map.number

    def where(self, place):
        return self.words.where(self.number[place])

    def peer(self, place, at):
        return self.words.seen_from(self.number[place], self.number[at])


@pytest.fixture
def env1():
    return Told(load_scenario("env1"))


def test_where_a_robot_is(env1):
    assert env1.where((2, 1)) == "in cell 9"
    assert env1.where((2, 2)) == "in cell 10, in the doorway"
    assert Told(load_scenario("env2-2r")).where((2, 3)).endswith(", in a doorway")


@pytest.mark.parametrize(
    ("place", "at", "said"),
    [
        ((2, 1), (2, 1), "in the same cell"),
        ((2, 1), (1, 1), "in cell 5, 1 move away"),
        ((2, 1), (2, 2), "in cell 10, 1 move away, in the doorway"),
        ((2, 0), (2, 2), "in cell 10, 2 moves away, in the doorway"),
        ((0, 0), (0, 4), "in cell 3, 8 moves away"),
    ],
)
def test_where_a_peer_is_seen_from_a_robot(env1, place, at, said):
    assert env1.peer(place, at) == said


def test_rooms_without_a_way_between_them(make):
    told = Told(make("1..D.2\n######\n...D.."))
    assert told.peer((0, 1), (2, 0)) == "in cell 6, to which there is no way"


@pytest.mark.parametrize(
    ("others", "said"),
    [
        ([(4, 4)], "robot_2 is in cell 20, 5 moves away"),
        ([(2, 3), (4, 4)], "robot_2 is in cell 11, 2 moves away"),
        (
            [(2, 2), (1, 1)],
            "robot_2 is in cell 10, 1 move away, in the doorway; "
            "robot_3 is in cell 5, 1 move away",
        ),
        (
            [(4, 4), (4, 0)],
            "the closest robot, robot_3, is in cell 17, 3 moves away",
        ),
    ],
)
def test_of_several_robots_those_that_are_close_are_told(make, others, said):
    places = {"robot_1": (1, 2), "robot_2": (2, 1), "robot_3": ([1, 0], [1, 1])}
    told = Told(make("1.#.2\n..#..\n..D..\n..#..\n..#..", robots=places))
    seen = [(k, told.number[place]) for k, place in enumerate(others, start=1)]
    assert told.words.answer(told.number[2, 1], seen) == said


@pytest.mark.parametrize(
    ("end", "said"),
    [
        (PerceptEnd.ANSWERED, "Answer: robot_2 is in cell 11, 2 moves away."),
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
    due = f"robot_1 asks in cell 9. {said} robot_1 goes on."
    assert env1.words.question(seen, question) == due
    unknown = env1.words.question(seen._replace(cells=(None, east)), question)
    assert unknown.startswith("robot_1 asks; its cell is not known. ")
    unseen = env1.words.question(seen._replace(cells=(west, None)), question)
    assert "robot_2 is" not in unseen


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
    episodes = np.arange(10_000) < share * 10_000
    zeros = np.zeros((10_000, 2))
    values = [zeros, zeros, zeros[:, 0], zeros, episodes, zeros[:2], zeros[:2]]
    text = failing_in_words(Measures(TRIALS, TRIAL, 10_000, *values))
    if not told:
        assert text == ""
        return
    assert text == (
        f"This team fails: all robots arrive in {told} of its greedy episodes."
    )
