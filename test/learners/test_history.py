# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The learning history: what goes into a row, curves, data frames and files."""

from dataclasses import replace

import pytest
from teams import same_bits

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, Reward, StepOutcome
from sparse_coord_ros.core.runs.history import (
    HISTORY_FILE,
    HistoryRecorder,
    blank_history,
    concatenated,
    load_history,
)

SCENARIO = load_scenario("env1", penalty=-5, ask_cost=1, goal_reward=10, discount=0.5)
"""Powers of the discount are exact; a goal is worth 20."""

MOVE = Action(0, False, -1, False)
ASK = Action(1, True, 1, True)


def reward(individual=0.0, common=0.0, cost=0.0):
    return Reward(individual, common, cost, individual + common + cost)


def outcome(*rewards, met=False, arrived=(), over=False):
    return StepOutcome(rewards, met, arrived, over)


def recorded():
    """Two robots, three episodes: 0 and 2 with transitions, 1 without, 3 cut off."""
    recorder = HistoryRecorder(SCENARIO)
    recorder.add(0, 1, [MOVE, ASK], outcome(reward(), reward(cost=-1.0)))
    met = outcome(reward(common=-5.0), reward(10.0, -5.0), met=True, arrived=(1,))
    recorder.add(0, 2, [MOVE, MOVE], met)
    later = outcome(
        reward(10.0, -5.0), reward(0.0, -5.0), met=True, arrived=(0,), over=True
    )
    recorder.add(0, 3, [MOVE, None], later)
    recorder.add(
        2, 8, [ASK, ASK], outcome(reward(cost=-1.0), reward(cost=-1.0), over=True)
    )
    recorder.add(3, 11, [None, MOVE], outcome(reward(), reward()))
    return recorder


def test_what_is_counted():
    history = recorded().so_far
    assert (history.episodes, history.robots) == (3, 2)
    assert history.first_step.tolist() == [1, 8, 11]
    assert history.length.tolist() == [3, 1, 1]
    # Robot 2 arrives with the first meeting, and pays for the second one, too.
    first = [-5 / 2 + 15 / 4, -1 + 15 / 2 - 5 / 4]
    assert history.returns.tolist() == [first, [-1.0, -1.0], [0.0, 0.0]]
    assert history.miscoordinations.tolist() == [2, 0, 0]
    assert history.asks.tolist() == [[0, 1], [1, 1], [0, 0]]
    assert history.arrived.tolist() == [[True, True], [False, False], [False, False]]
    assert history.present.all()


def test_asking_for_it_in_between_changes_nothing():
    scenario = replace(SCENARIO, robots=SCENARIO.robots[:1])
    recorder = HistoryRecorder(scenario)
    whole = HistoryRecorder(scenario)
    for episode in range(300):
        for step in range(1 + episode % 3):
            what = (
                episode,
                10 * episode + step,
                [ASK],
                outcome(reward(0.1, -0.2), met=True),
            )
            recorder.add(*what)
            whole.add(*what)
            before = recorder.so_far
            assert before.length.sum() == before.miscoordinations.sum()
    assert same_bits(recorder.so_far, whole.so_far)
    assert whole.so_far.episodes == 300
    assert before.length[-1] == 3


def test_going_on_with_an_episode_and_after_one():
    expected = recorded()
    for under_way in (True, False):
        recorder = HistoryRecorder(
            SCENARIO, history=recorded().so_far, under_way=under_way
        )
        what = (12, [MOVE, MOVE], outcome(reward(10.0), reward(), arrived=(0,)))
        recorder.add(0, *what)
        recorder.add(1, 15, *what[1:])
        if under_way:
            expected.add(3, *what)
            expected.add(4, 15, *what[1:])
            assert same_bits(recorder.so_far, expected.so_far)
        assert recorder.so_far.episodes == (4 if under_way else 5)


def test_curves():
    history = recorded().so_far
    steps, lengths = history.curve("length")
    assert (steps.tolist(), lengths.tolist()) == ([0, 3, 4], [3, 1, 1])
    steps, returns = history.curve("returns", 2)
    assert (steps.tolist(), returns.tolist()) == ([3, 4], [1.125, -0.5])
    assert history.curve("returns", 3, robot=2)[1].tolist() == [4.25 / 3]
    assert history.curve("arrived", 99)[1].tolist() == [1 / 3]
    assert history.curve("miscoordinations", robot=1)[1].tolist() == [2, 0, 0]
    for arguments in (("speed",), ("asks", 0)):
        with pytest.raises(RunError, match="history: "):
            history.curve(*arguments)
    for robot in (0, 3):
        with pytest.raises(RunError, match="no robot"):
            history.curve("asks", robot=robot)


def test_curves_of_robots_that_learned_alone():
    parts = []
    for k in range(2):
        recorder = HistoryRecorder(SCENARIO)
        for episode in range(3):
            acts = [ASK, MOVE][k]
            actions = [acts if robot == k else None for robot in range(2)]
            told = outcome(reward(), reward(), met=k == 1)
            recorder.add(episode, 1 + 10 * episode + k, actions, told)
        parts.append(recorder.so_far)
        parts[k].present[:, 1 - k] = False
    history = concatenated(parts)
    assert history.curve("returns", robot=2)[1].tolist() == [-5.0] * 3
    steps, returns = history.curve("returns")
    assert steps.tolist() == [0, 0, 1, 1, 2, 2]
    assert returns.tolist() == [-1.0, -5.0] * 3
    frame = history.to_pandas()
    assert frame["robot"].tolist() == [1, 1, 1, 2, 2, 2]


def test_data_frame():
    frame = recorded().so_far.to_pandas(["a", "b"])
    assert len(frame) == 6
    row = frame[(frame.episode == 0) & (frame.robot == "b")].iloc[0]
    assert row.to_dict() == {
        "episode": 0,
        "steps_before": 0,
        "length": 3,
        "robot": "b",
        "returns": 5.25,
        "asks": 1,
        "arrived": True,
        "miscoordinations": 2,
    }


def test_file(tmp_path):
    history = recorded().so_far
    history.save(tmp_path)
    found = load_history(tmp_path)
    assert same_bits(found, history)
    assert [array.dtype for array in found] == [array.dtype for array in history]
    other = recorded()
    other.add(3, 12, [MOVE, None], outcome(reward(), reward()))
    assert not same_bits(other.so_far, history)
    blank_history(0, 4).save(tmp_path)
    assert same_bits(load_history(tmp_path), blank_history(0, 4))
    assert not same_bits(blank_history(0, 4), blank_history(0, 3))


def test_files_that_are_none(tmp_path):
    with pytest.raises(RunError, match="history.npz"):
        load_history(tmp_path)
    recorded().so_far.save(tmp_path)
    file = tmp_path / HISTORY_FILE
    whole = file.read_bytes()
    for broken in (b"PK", whole[:-9]):
        file.write_bytes(broken)
        with pytest.raises(RunError, match="history.npz"):
            load_history(tmp_path)
