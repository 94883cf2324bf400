# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`explain` shows where a robot left a stand-off: it asked twice, saw no robot move, and left."""

import numpy as np
import pytest

from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.draws import LEARNING, LEAVE, ROBOT, draw, key_of
from sparse_coord_ros.core.learners.factored import LEAVING, LEAVING_SHARE
from sparse_coord_ros.log.runlog import read_run
from sparse_coord_ros.log.runlog.explain import (
    MAY_HAVE_LEFT,
    coordinations,
    explained,
    in_words,
    may_have_left,
)

WHY = "  asked twice in a row, saw that no robot moved, and leaves at random"


VALUES = {"checkpoint": 100, "learner": "factored"}


@pytest.fixture(scope="module")
def log(record):
    return read_run(record("crowd-3r", settings={"steps": 600}, values=VALUES).bag)


def told(log):
    """Return all questions with answers, and the lines of each."""
    found = []
    for robot in range(len(log.names)):
        for one in explained(log, robot, coordinations(log, robot)):
            if one.perceived is not None:
                found.append((one, list(in_words(log, one))))
    return found


def asked_twice_and_saw_no_robot_move(log, one):
    row = log.row_of[one.step]
    follows = log.step[row - 1] == one.step - 1
    answered = log.asked[row - 1, one.robot] and log.perceived[row - 1, one.robot]
    return follows and answered and (log.cells[row - 1] == log.cells[row]).all()


def test_each_move_that_the_values_do_not_say_is_told_as_left_at_random(log):
    """Robots with an answer do not explore: no other reason for such a move is left."""
    left = 0
    for one, lines in told(log):
        best = max(one.q_values)
        is_best = one.q_values[one.move] == best
        assert is_best or one.waiting_move is not None
        why = [line for line in lines if line.startswith(WHY)]
        if one.waiting_move is None:
            assert why == []
            continue
        left += 1
        assert asked_twice_and_saw_no_robot_move(log, one)
        assert log.run.scenario.map.next_cell[one.cell, one.move] != one.cell
        key = key_of(log.run.seed, LEARNING, one.robot, ROBOT)
        assert draw(key, one.step, LEAVE) < LEAVING
        assert one.q_values[one.waiting_move] == best
        assert one.q_values[one.move] >= (1 - LEAVING_SHARE) * best
        assert why == [f"{WHY} (probability {LEAVING:g})"]
        row = ", ".join(map(str, (one.cell, *one.perceived)))
        place = lines.index(why[0])
        assert lines[place + 1].startswith(
            f"  goes {ACTIONS[one.move]}, though by Q^C[{row}] it would go "
            f"{ACTIONS[one.waiting_move]}: north "
        )
    assert left >= 2


def test_a_pair_leaves_no_stand_off(record):
    settings = {"steps": 600, "penalty": -100}
    log = read_run(record(settings=settings, values=VALUES).bag)
    assert all(one.waiting_move is None for one, _ in told(log))
    assert not any(MAY_HAVE_LEFT in line for _, lines in told(log) for line in lines)


def test_where_values_are_unknown_it_says_that_the_robot_may_have_left(log):
    may = 0
    for one, _ in told(log):
        unknown = one._replace(q_values=(), waiting_move=None, doubt="lost")
        lines = list(in_words(log, unknown))
        leads = log.run.scenario.map.next_cell[one.cell, one.move] != one.cell
        doubtful = asked_twice_and_saw_no_robot_move(log, one) and leads
        assert (f"  {MAY_HAVE_LEFT}" in lines) == doubtful
        assert (lines[-1] == f"  goes {ACTIONS[one.move]}; lost") == doubtful
        assert doubtful or one.waiting_move is None
        may += doubtful
    assert may


def test_a_move_may_be_a_way_out_only_after_two_answers_in_which_no_robot_moved(log):
    run = log.run
    robots = len(log.names)
    cells = [[5] * robots] * 2
    [move] = np.flatnonzero(run.scenario.map.next_cell[5] != 5)[:1].tolist()
    assert may_have_left(run, 0, cells, [True, True], move)
    assert not may_have_left(run, 0, cells, [False, True], move)
    assert not may_have_left(run, 0, cells, [True, False], move)
    moved = [[5] * robots, [5] * (robots - 1) + [6]]
    assert not may_have_left(run, 0, moved, [True, True], move)
    unknown = [[5] * robots, [5] * (robots - 1) + [None]]
    assert not may_have_left(run, 0, unknown, [True, True], move)
