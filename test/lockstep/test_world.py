# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world's side of the lock step, message by message."""

import pytest

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.wire import StartReason

EAST = Action(2, False, -1, False)
WEST = Action(3, False, -1, False)
NORTH = Action(0, False, -1, False)
DOWN = Action(1, False, -1, False)


class Port:
    """Records the world's messages."""

    def __init__(self):
        self.said = []

    def state(self, robot, step, cell):
        self.said.append(("state", robot, step, cell))

    def reward(self, robot, step, reward):
        self.said.append(("reward", robot, step, reward.total))

    def take(self):
        said = self.said
        self.said = []
        return said


def make_world(name="env1", **settings):
    """Return a world's side of the lock step that has started, and its port."""
    sure = {"starts": "fixed", "move_success": 1, "max_steps": 50, "steps": 100}
    scenario = load_scenario(name).with_settings({**sure, **settings})
    port = Port()
    world = WorldSide(make_run(scenario, {}), port)
    world.start()
    return world, port


@pytest.fixture
def made():
    return make_world()


@pytest.fixture
def world(made):
    return made[0]


@pytest.fixture
def port(made):
    return made[1]


# Cells of env1: row 0 is 0 1 2 3, row 1 is 4 5 6 7; robot 1 starts at 0, robot 2 at 3.


def test_start_says_every_state(port):
    assert port.take() == [("state", 0, 1, 0), ("state", 1, 1, 3)]


def test_the_barrier_opens_with_the_last_action(world, port):
    port.take()
    assert world.missing() == [0, 1]
    assert not world.complete
    assert world.action(1, 1, DOWN) is False
    assert world.missing() == [0]
    assert not world.complete
    assert port.take() == []
    assert world.action(0, 1, DOWN) is True
    assert world.complete
    world.advance()
    rewards = [("reward", 0, 1, 0.0), ("reward", 1, 1, 0.0)]
    assert port.take() == [*rewards, ("state", 0, 2, 4), ("state", 1, 2, 7)]
    assert not world.complete
    assert world.missing() == [0, 1]


@pytest.mark.parametrize("step", [0, 2, 7])
def test_actions_of_other_steps_are_stale(world, step):
    assert world.action(0, step, DOWN) is False
    assert world.missing() == [0, 1]
    assert world.stale == 1


def play(world, *actions):
    """Make a time step with these actions, one a robot; None: none."""
    for robot, action in enumerate(actions):
        if action is not None:
            world.action(robot, world.world.step, action)
    assert world.complete
    world.advance()


def test_a_watcher_hears_of_the_cells_before_and_after(world):
    heard = []
    world.watcher = lambda seen: heard.append((seen.cells, seen.after))
    before = tuple(world.world.cells)
    play(world, DOWN, DOWN)
    assert heard == [(before, tuple(world.world.cells))] and heard[0][0] != heard[0][1]


def left_out(world):
    """Let the deadline pass, and the others go on; return whom they leave out."""
    missing = world.expire()
    if missing and world.complete:
        world.advance()
    return missing


def arrive(world):
    """Take robot 1 of env1 to its goal while robot 2 stays."""
    for move in (DOWN, DOWN, EAST, EAST, EAST, EAST, DOWN, DOWN):
        play(world, move, NORTH)
    assert world.world.arrived == [True, False]


def test_the_first_of_two_actions_counts(world):
    world.action(0, 1, DOWN)
    assert world.action(0, 1, EAST) is False
    assert world.stale == 1
    world.action(1, 1, DOWN)
    world.advance()
    assert world.world.cells == [4, 7]


def test_an_arrived_robot_is_not_waited_for(world, port):
    arrive(world)
    assert world.missing() == [1]
    assert world.action(0, world.world.step, NORTH) is False
    assert world.stale == 1
    port.take()
    play(world, None, DOWN)
    rewards = [said for said in port.take() if said[0] == "reward"]
    assert [said[1] for said in rewards] == [1]


def test_an_episode_ends_and_the_next_begins_two_steps_later():
    world, port = make_world(max_steps=2)
    play(world, DOWN, DOWN)
    port.take()
    play(world, DOWN, DOWN)
    states = [said for said in port.take() if said[0] == "state"]
    assert states == [
        ("state", 0, 3, 8),
        ("state", 1, 3, 12),
        ("state", 0, 5, 0),
        ("state", 1, 5, 3),
    ]
    assert world.world.episode == 1


def test_the_budget_ends_everything():
    world, _ = make_world(steps=2, max_steps=2)
    play(world, DOWN, DOWN)
    assert not world.finished
    play(world, DOWN, DOWN)
    assert world.finished
    assert world.world.episode == 0  # no new episode after the last step


def test_the_last_states_are_said():
    """Without them no robot would learn from the last transition."""
    world, port = make_world(steps=1)
    port.take()
    play(world, DOWN, DOWN)
    assert world.finished
    last = [("state", k, 2, world.world.cells[k]) for k in (0, 1)]
    assert port.take()[-2:] == last


def test_without_any_action_the_world_waits_on(world, port):
    port.take()
    assert left_out(world) == []
    assert (world.timeouts, world.absent, world.world.step) == (0, set(), 1)
    assert port.take() == []


def test_a_silent_robot_is_left_out_and_taken_back(world, port):
    world.action(0, 1, DOWN)
    port.take()
    assert left_out(world) == [1]
    assert (world.timeouts, world.absent) == (1, {1})
    assert world.world.cells == [4, 3]
    assert port.take() == [
        ("reward", 0, 1, 0.0),
        ("state", 0, 2, 4),
        ("state", 1, 2, 3),
    ]
    assert world.action(0, 2, DOWN) is True  # the world does not wait for robot 2
    world.advance()
    assert world.timeouts == 1
    world.action(1, 2, DOWN)  # too late, but it is there again
    assert (world.stale, world.absent) == (1, set())
    assert world.action(0, 3, EAST) is False
    assert world.action(1, 3, DOWN) is True
    world.advance()
    assert world.world.cells == [9, 7]


def test_who_leaves_a_robot_out_makes_no_step_yet(world):
    """Bodies must get their goals first."""
    world.action(0, 1, DOWN)
    assert world.expire() == [1]
    assert world.complete and world.world.step == 1


def test_a_silent_robot_beside_an_arrived_one_ends_the_episode(world):
    """The arrived one continues with a new episode instead of waiting for ever."""
    arrive(world)
    step = world.world.step
    made = world.world.transitions
    assert left_out(world) == [1]
    assert (world.timeouts, world.absent) == (1, {1})
    assert (world.world.episode, world.world.step, world.world.transitions) == (
        1,
        step + 2,
        made,
    )
    assert world.missing() == [0]


def test_a_deadline_with_nobody_missing_does_nothing(world):
    world.action(0, 1, DOWN)
    world.action(1, 1, DOWN)
    assert left_out(world) == []
    assert (world.timeouts, world.absent, world.world.step) == (0, set(), 1)


def test_an_episode_in_which_nobody_can_move_any_more_ends(world):
    for move in (DOWN, DOWN, EAST, EAST, EAST, EAST, DOWN):
        play(world, move, NORTH)
    world.action(0, world.world.step, DOWN)
    assert left_out(world) == [1]
    assert world.world.episode == 1
    assert world.world.arrived == [False, False]
    assert world.missing() == [0]


def test_repeat_says_what_the_missing_ones_may_have_lost(world, port):
    play(world, DOWN, DOWN)
    world.action(0, 2, DOWN)
    port.take()
    world.repeat()
    every = [
        ("reward", 0, 1, 0.0),
        ("state", 0, 2, 4),
        ("reward", 1, 1, 0.0),
        ("state", 1, 2, 7),
    ]
    assert port.take() == every
    world.repeat()
    assert port.take() == every


def test_repeat_reaches_the_absent(world, port):
    world.action(0, 1, DOWN)
    left_out(world)
    port.take()
    world.action(0, 2, DOWN)
    world.repeat()
    states = [("state", 0, 2, 4), ("state", 1, 2, 3)]
    assert port.take() == [("reward", 0, 1, 0.0), *states], (
        "who did not act has no reward"
    )


def test_repeat_in_a_new_episode_says_no_old_reward(world, port):
    play(world, DOWN, DOWN)
    world.action(0, 2, DOWN)
    world.new_episode()
    assert world.missing() == [0, 1]  # the action that waited is forgotten
    port.take()
    world.repeat()
    assert port.take() == [("state", 0, 4, 0), ("state", 1, 4, 3)]


def test_it_counts_whom_it_leaves_out_at_each_step(world):
    """Arrived robots do not count, nor steps without a transition."""
    world.action(0, 1, DOWN)
    left_out(world)
    assert world.left_out == 1
    play(world, DOWN)
    assert (world.left_out, world.timeouts) == (2, 1)
    beside, _ = make_world()
    arrive(beside)
    left_out(beside)
    assert (beside.left_out, beside.timeouts) == (0, 1)


def test_it_says_why_an_episode_began():
    world, _ = make_world(max_steps=2)
    assert world.began == StartReason.START
    play(world, DOWN, DOWN)
    play(world, DOWN, DOWN)
    assert world.began == StartReason.STEPS
    world.new_episode()
    assert world.began == StartReason.RESET
    beside, _ = make_world()
    arrive(beside)
    left_out(beside)
    assert beside.began == StartReason.NOBODY_LEFT
    together, _ = make_world()
    together.start()
    play(together, DOWN, DOWN)
    state = together.snapshot()
    there = {"under_way": True, "cells": (19, 17), "arrived": (False, True)}
    together.go_on_from(state._replace(position=state.position._replace(**there)))
    together.start()
    play(together, EAST)
    assert together.began == StartReason.ARRIVED


def test_it_goes_on_where_another_one_was(world):
    world.action(0, 1, DOWN)
    left_out(world)
    other, _ = make_world()
    other.go_on_from(world.snapshot())
    assert other.held and not other.action(0, 2, DOWN)
    assert (other.absent, other.timeouts, other.left_out, other.world.step) == (
        {1},
        1,
        1,
        2,
    )
    other.go_on_from(None)
    assert (other.absent, other.timeouts, other.left_out, other.world.step) == (
        set(),
        0,
        0,
        1,
    )


def test_each_robot_that_misses_a_deadline_is_counted():
    world, _ = make_world("env2-4r")
    for robot in (0, 1):
        world.action(robot, 1, DOWN)
    assert left_out(world) == [2, 3]
    assert world.timeouts == 2
    world.action(0, 2, DOWN)
    assert left_out(world) == [1]
    assert (world.timeouts, world.absent) == (3, {1, 2, 3})


def test_another_world_goes_on_in_the_middle_of_an_episode():
    world, _ = make_world()
    port = Port()
    play(world, DOWN, DOWN)
    again = WorldSide(make_run(world.world.scenario, {}), port)
    again.go_on_from(world.snapshot())
    again.start()
    assert port.take() == [("state", 0, 2, 4), ("state", 1, 2, 7)]


def test_the_world_saves_at_each_step_that_robots_see():
    """Also at an episode's last one, which no action follows."""
    scenario = make_world(max_steps=3)[0].world.scenario
    port = Port()
    port.saved = []
    port.checkpoint = port.saved.append
    world = WorldSide(make_run(scenario, {"checkpoint": 1}), port)
    world.start()
    for _ in range(4):
        play(world, DOWN, DOWN)
    seen = sorted({step for what, _, step, _ in port.take() if what == "state"})
    assert port.saved == seen[1:], "at the first one there is nothing to save"
    assert 4 in port.saved
