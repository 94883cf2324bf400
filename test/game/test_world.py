# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The Markov game: dynamics, rewards, episodes."""

from collections import Counter

import numpy as np
import pytest

from sparse_coord_ros.core.game.actions import EAST, NORTH, WEST
from sparse_coord_ros.core.game.draws import EVALUATION
from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import FIRST_STEP, Action, Reward, World

SURE = {"move_success": 1, "starts": "fixed"}


def go(move):
    return Action(move, False, -1, False)


def ask(move):
    return Action(move, True, 1, True)


@pytest.mark.parametrize("success", [0.8, 0.3])
def test_moves_succeed_with_their_probability_robot_by_robot(make, success):
    """Both robots swing between two cells; every move that succeeds changes the cell."""
    steps = 20_000
    robots = {"a": ([0, 0], [2, 0]), "b": ([0, 4], [2, 0])}
    grid = "..#..\n..#..\n....."
    world = World(
        make(grid, robots, starts="fixed", move_success=success, max_steps=steps), 11
    )
    moved = np.zeros((steps, 2))
    for t in range(steps):
        before = list(world.cells)
        world.advance([go(EAST if x in (0, 2) else WEST) for x in before])
        moved[t] = [x != y for x, y in zip(before, world.cells, strict=True)]
    error = (success * (1 - success) / steps) ** 0.5
    assert np.abs(moved.mean(axis=0) - success).max() < 4 * error
    assert abs(np.corrcoef(moved.T)[0, 1]) < 4 / steps**0.5
    assert abs(np.corrcoef(moved[1:, 0], moved[:-1, 0])[0, 1]) < 4 / steps**0.5
    assert world.transitions == steps


def test_arrival_pays_once_and_the_arrived_robot_stays(make):
    world = World(make("1.2..", {"a": (1, [0, 1]), "b": (2, 1)}, **SURE), 0)
    first = world.advance([go(EAST), go(WEST)])
    assert first.arrived == (0,)
    assert first.rewards[0] == Reward(10.0, 0.0, 0.0, 10.0, 0)
    assert first.rewards[1] == Reward(0.0, 0.0, 0.0, 0.0, 0)
    assert world.arrived == [True, False]
    assert not first.episode_over
    # the arrived robot's action has no effect
    second = world.advance([go(EAST), go(WEST)])
    assert world.cells == [1, 0]
    assert second.rewards[0].individual == 0.0
    assert second.arrived == (1,)
    assert second.episode_over


def test_a_missing_action_is_staying(make):
    world = World(make(**SURE), 0)
    world.advance([None, go(WEST)])
    assert world.cells == [0, 5]


def test_rewards_add_up_and_asking_costs_whether_answered_or_not(make):
    world = World(make("1D2", ask_cost=0.5, **SURE), 0)
    refused = Action(WEST, True, 0, False)
    outcome = world.advance([ask(EAST), refused])
    felt = (0.0, -20.0, -0.5, -20.5)
    assert outcome.rewards == (Reward(*felt, 0b10), Reward(*felt, 0b01))
    assert world.advance([ask(EAST), go(NORTH)]).rewards[0] == Reward(
        10.0, 0.0, -0.5, 9.5, 0
    )


def test_a_miscoordination_falls_on_every_robot_the_arrived_too(make):
    robots = {"a": ([0, 0], [0, 4]), "b": ([0, 4], [0, 0]), "c": ([0, 4], [0, 3])}
    world = World(make("..D..", robots, **SURE), 0)
    first = world.advance([go(EAST), go(WEST), go(WEST)])
    assert first.arrived == (2,)
    assert not first.miscoordination  # two robots in one cell, which is no doorway
    second = world.advance([go(EAST), go(WEST), None])
    assert second.miscoordination
    assert [reward.common for reward in second.rewards] == [-20.0] * 3
    assert [reward.total for reward in second.rewards] == [-20.0] * 3
    third = world.advance([go(NORTH), go(NORTH), None])  # staying together costs again
    assert third.miscoordination
    assert world.miscoordinations == 2
    assert not world.advance([go(EAST), go(NORTH), None]).miscoordination


def test_passing_each_other_is_no_miscoordination(make):
    world = World(make("1D2", {"a": ([0, 1], 2), "b": (2, 1)}, **SURE), 0)
    assert not world.advance([go(EAST), go(WEST)]).miscoordination


def test_steps_episodes_and_their_gap(make):
    world = World(make(max_steps=3, **SURE), 0)
    assert (
        (world.step, world.episode, world.transitions)
        == (FIRST_STEP, 0, 0)
        == (1, 0, 0)
    )
    over = [world.advance([go(NORTH), go(NORTH)]).episode_over for _ in range(3)]
    assert over == [False, False, True]
    assert world.step == 4
    world.advance([go(EAST), go(WEST)])
    world.begin_episode()
    assert world.step == 5 + EPISODE_GAP == 7
    assert (world.episode, world.transitions) == (1, 4)
    assert world.cells == [0, 6]
    over = [world.advance([go(NORTH), go(NORTH)]).episode_over for _ in range(3)]
    assert over == [False, False, True]


def starts(scenario, episodes, **options):
    """Return the start cells of many episodes, shape (episodes, robots)."""
    world = World(scenario, 3, **options)
    cells = [list(world.cells)]
    for _ in range(episodes - 1):
        world.begin_episode()
        cells.append(list(world.cells))
    return np.array(cells)


def test_random_starts_are_uniform_never_the_goal_never_cut_off(make):
    scenario = make("1....2#.", starts="random")
    drawn = starts(scenario, 4000)
    for k, robot in enumerate(scenario.robots):
        counted = Counter(drawn[:, k].tolist())
        assert set(counted) == set(range(6)) - {robot.goal}
        # chi squared, 0.1 %
        assert sum((n - 800) ** 2 / 800 for n in counted.values()) < 18.5
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 4 / 4000**0.5


@pytest.mark.parametrize(
    ("setting", "options"),
    [("fixed", {}), ("random", {"phase": EVALUATION}), ("mixed:0", {})],
)
def test_fixed_starts(setting, options):
    scenario = load_scenario("env2-4r").with_settings({"starts": setting})
    assert (starts(scenario, 50, **options) == [r.start for r in scenario.robots]).all()


def test_the_world_says_who_was_with_whom():
    scenario = load_scenario("env2-4r", penalty=-20)
    world = World(scenario, 0)
    first, second = sorted(scenario.map.doorways)[:2]
    world.cells = [first, second, first, second]
    world.led = lambda k, move: world.cells[k]
    stay = [go(NORTH)] * 4
    assert [r.partners for r in world.advance(stay).rewards] == [4, 8, 1, 2]
    world.cells = [first, second, first, 0]
    rewards = world.advance(stay).rewards
    assert [r.partners for r in rewards] == [4, 0, 1, 0]
    assert [r.common for r in rewards] == [-20.0] * 4
