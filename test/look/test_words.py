# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Places and moves in words."""

import pytest

from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.game.world import Action
from sparse_coord_ros.learn.simulation import Glimpse
from sparse_coord_ros.look.steps import questions_of
from sparse_coord_ros.look.words import Words
from sparse_coord_ros.wire import PerceptEnd


@pytest.fixture
def words():
    return Words(load_scenario("env1"))


def test_where_a_cell_is_by_its_doorway(words):
    grid = load_scenario("env1").map
    [door] = grid.doorways
    beside = sorted({*grid.next_cell[door].tolist()} - {door})
    assert [words.where(cell)[0] for cell in (door, *beside)] == [
        "in the doorway",
        *["before the doorway"] * len(beside),
    ]
    assert words.where(0) == ("4 moves from the doorway", 0) and words.near(door, 0) == "in it"
    assert words.there(0, [(0, beside[0])]) == "robot_1 is in front of it"
    assert words.there(0, [(0, 0), (1, 0)]) == "nobody is near it"


@pytest.mark.parametrize(
    ("end", "said"),
    [
        (PerceptEnd.ANSWERED, "Answer: robot_2 is in front of it. It waits."),
        (PerceptEnd.REFUSED, "It is refused. It waits."),
        (PerceptEnd.LATE, "No answer comes. It waits."),
    ],
)
def test_a_question_in_sentences(words, end, said):
    [door] = load_scenario("env1").map.doorways
    west, east = (load_scenario("env1").map.next_cell[door][move] for move in (3, 2))
    perceived = end == PerceptEnd.ANSWERED
    asking = Action(0, True, 1, perceived), Action(0, False, -1, False)
    seen = Glimpse(
        3, (int(west), int(east)), asking, (int(west), int(east)), False, (), (end, None)
    )
    [question] = questions_of(seen)
    assert words.question(seen, question) == f"robot_1 asks before the doorway. {said}"


@pytest.mark.parametrize(("after", "said"), [(20, "goes on"), (0, "steps back")])
def test_a_robot_that_is_far_away_next_as_in_a_damaged_log(words, after, said):
    home = load_scenario("env1").map.distances_to(load_scenario("env1").robots[0].goal)
    cell = int((home == 4).argmax())
    assert abs(home[cell] - home[after]) > 1
    assert words.goes(0, cell, 0, after) == said
