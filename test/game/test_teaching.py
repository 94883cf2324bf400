# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios that teach the kinds of interaction: robots that ignore each other lose there."""

import numpy as np
import pytest

from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.draws import EVALUATION
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, World
from sparse_coord_ros.core.learners.lone import lone_values

TRIALS = 120


def ignoring(scenario):
    """Return mean reward, miscoordinations and arrivals of robots on shortest paths."""
    rng = np.random.default_rng(0)
    goals = [robot.goal for robot in scenario.robots]
    lead = scenario.map.next_cell
    ways = [scenario.map.distances_to(goal) for goal in goals]
    world = World(scenario, 0, phase=EVALUATION, max_steps=scenario.horizon)
    prize = scenario.goal_reward / (1 - scenario.discount)
    rewards = []
    arrived = 0
    for _ in range(TRIALS):
        worth = 1.0
        total = 0.0
        while not world.episode_over:
            actions = []
            for way, cell in zip(ways, world.cells, strict=True):
                ahead = [m for m in range(PRIMITIVES) if way[lead[cell, m]] < way[cell]]
                chosen = (
                    Action(int(rng.choice(ahead)), False, -1, False) if ahead else None
                )
                actions.append(chosen)
            outcome = world.advance(actions)
            total += worth * prize * len(outcome.arrived)
            total += worth * sum(reward.common for reward in outcome.rewards)
            worth *= scenario.discount
        rewards.append(total / len(goals))
        arrived += all(world.arrived)
        world.begin_episode()
    return np.mean(rewards), world.miscoordinations / TRIALS, arrived / TRIALS


@pytest.mark.parametrize(
    ("name", "interactions", "most", "conflicts", "arrivals"),
    [
        ("aisle", "swap", 0.97, (0.2, 0.5), (1, 1)),
        ("lane", "block:anywhere", 0.05, (0, 0), (0, 0.05)),
        ("floor-4r", "together:anywhere+swap+block", 0.4, (1.5, 2.5), (0.2, 0.6)),
    ],
)
def test_robots_that_ignore_each_other_lose(
    name, interactions, most, conflicts, arrivals
):
    """`most` is what they may earn, as a share of what robots alone in the world earn."""
    scenario = load_scenario(name)
    assert scenario.interactions == interactions
    robots = scenario.robots
    alone = np.mean(
        [lone_values(scenario, k)[r.start].max() for k, r in enumerate(robots)]
    )
    reward, found, arrived = ignoring(scenario)
    assert reward <= most * alone
    assert conflicts[0] <= found <= conflicts[1]
    assert arrivals[0] <= arrived <= arrivals[1]
