# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The PettingZoo environment: its checks and ours; our learner learns the same bits through it."""

import numpy as np
import pytest

pytest.importorskip("pettingzoo")  # package.xml does not bring it: it has no rosdep key
from pettingzoo.test import parallel_api_test
from teams import plain_run

from sparse_coord_ros.base.errors import RunError, SettingError
from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Reward
from sparse_coord_ros.core.learners.agent import Agent, Choice
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.tables import tables_equal
from sparse_coord_ros.core.pettingzoo_env import parallel_env
from sparse_coord_ros.core.solve.optimum import independent_bound


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["env1", "env2-4r"])
@pytest.mark.parametrize("starts", ["fixed", "protocol"])
def test_pettingzoos_own_check(name, starts):
    parallel_api_test(parallel_env(name, starts=starts), num_cycles=300)


def random_run(env, seed, episodes=3):
    """Return all that an environment says while the same choices are made."""
    random = np.random.default_rng(7)
    said = []
    for episode in range(episodes):
        seen, infos = env.reset(seed=seed if episode == 0 else None)
        said.append(repr((seen, infos)))
        while env.agents:
            acts = {}
            for agent in env.agents:
                allowed = np.flatnonzero(seen[agent]["action_mask"])
                acts[agent] = int(random.choice(allowed))
                assert env.observation_space(agent).contains(seen[agent])
            seen, *rest = env.step(acts)
            assert env.state_space.contains(env.state())
            said.append(repr((seen, rest, env.state().tolist())))
    return said


@pytest.mark.parametrize("starts", ["fixed", "protocol"])
def test_the_same_seed_brings_the_same_episodes_to_their_ends(starts):
    scenario = load_scenario("env2-4r", perception="probability:0.6", horizon=60)
    first, again, other = (
        random_run(parallel_env(scenario, starts=starts), seed) for seed in (4, 4, 5)
    )
    assert first == again
    assert first != other


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("env1", {"penalty": -100, "perception": "probability:0.7"}),
        ("env2-4r", {"perception": "range:3"}),
        ("env2-4r", {"peers": "all", "perception": "probability:0.9"}),
    ],
)
def test_our_learner_learns_the_same_bits_through_it(name, settings):
    """The agents of Algorithm 1, driven by what the environment says alone."""
    scenario = load_scenario(name, steps=1200, **settings)
    due = plain_run(scenario, "coop", 3)
    due.advance(1200)
    env = parallel_env(scenario, starts="protocol", goal_value=False)
    rule = learner_of("coop")
    agents = {
        name: Agent(rule, scenario, k, 3) for k, name in enumerate(env.possible_agents)
    }
    seen, _ = env.reset(seed=3)
    asked = 0
    done = 0
    step = 1
    while done < 1200:
        cells = {name: int(seen[name]["observation"][0]) for name in env.agents}
        decided = {name: agents[name].decide(step, cells[name]) for name in env.agents}
        acts = {name: choice.action for name, choice in decided.items()}
        percepts = dict.fromkeys(env.agents)
        if 4 in acts.values():
            seen, _, _, _, infos = env.step(acts)
            assert all(info["half_step"] for info in infos.values())
            for agent in env.agents:
                _, half, success, *others = seen[agent]["observation"].tolist()
                assert half == 1
                if success:
                    asked += 1
                    percepts[agent] = tuple(cell - 1 for cell in others if cell)
        taken = {
            agent: agents[agent].act(
                step, cells[agent], decided[agent], percepts[agent]
            )
            for agent in env.agents
        }
        before = env.agents
        seen, rewards, ended, cut, infos = env.step(
            {n: a.move for n, a in taken.items()}
        )
        for agent in before:
            k = env.possible_agents.index(agent)
            parts = infos[agent]["reward_parts"]
            assert sum(parts) == rewards[agent]
            choice = Choice(cells[agent], decided[agent], taken[agent], percepts[agent])
            reward = Reward(*parts, rewards[agent])
            agents[agent].learn(step, choice, reward, int(env.state()[k]))
        done += 1
        step += 1
        if not env.agents:
            assert all(ended[agent] != cut[agent] for agent in before)
            seen, _ = env.reset()
            step += EPISODE_GAP
    assert asked > 20
    assert tables_equal([agent.tables for agent in agents.values()], due.tables)


@pytest.mark.parametrize("goal_value", [True, False])
def test_discounted_returns_are_the_rewards_of_evaluate(goal_value):
    """Robots on shortest paths, without a penalty: a robot alone in the world earns as much."""
    scenario = load_scenario("env1", penalty=0)
    grid = scenario.map
    env = parallel_env(scenario, goal_value=goal_value)
    moves = []
    for robot in scenario.robots:
        moves.append(grid.distances_to(robot.goal)[grid.next_cell].argmin(axis=1))
    seen, _ = env.reset(seed=5)
    returns = []
    for _ in range(400):
        total = 0.0
        discount = 1.0
        while env.agents:
            acts = {}
            for name in env.agents:
                cell = seen[name]["observation"][0]
                acts[name] = int(moves[env.possible_agents.index(name)][cell])
            seen, rewards, *_ = env.step(acts)
            total += discount * sum(rewards.values()) / len(scenario.robots)
            discount *= scenario.discount
        returns.append(total)
        seen, _ = env.reset()
    if goal_value:
        error = np.std(returns) / len(returns) ** 0.5
        assert abs(np.mean(returns) - independent_bound(scenario)) < 5 * error
    else:
        assert np.max(returns) < scenario.goal_reward


def test_masks_worth_and_bad_input():
    env = parallel_env("env1", render_mode="rgb_array")
    with pytest.raises(RunError, match="call reset first"):
        env.state()
    for seed in ("x", -1, 1.5, [1]):
        with pytest.raises(SettingError, match="setting seed"):
            env.reset(seed=seed)
    env.reset(seed=np.int64(1))
    for actions in (None, [0, 1]):
        with pytest.raises(SettingError, match="actions"):
            env.step(actions)
    seen, rewards, *_ = env.step({"robot_1": 4, "robot_2": 2})
    assert rewards == {"robot_1": 0.0, "robot_2": 0.0}
    assert seen["robot_1"]["action_mask"].tolist() == [1, 1, 1, 1, 0]
    assert seen["robot_2"]["action_mask"].tolist() == [0, 0, 1, 0, 0]
    with pytest.raises(SettingError, match="robot_2: action is 1"):
        env.step({"robot_1": 0, "robot_2": 1})
    for action in ("n", None, 1.5, -1):
        with pytest.raises(SettingError, match="robot_1: action"):
            env.step({"robot_1": action, "robot_2": 2})
    with pytest.raises(SettingError, match="'x'"):
        env.step({"x": 0})
    _, rewards, *_ = env.step({"robot_1": 0, "robot_2": 2})
    assert rewards["robot_1"] == -1.0
    picture = env.render()
    assert (picture.shape, picture.dtype) == ((80, 80, 3), np.uint8)
    for values in ({"starts": "any"}, {"render_mode": "human"}):
        with pytest.raises(SettingError, match="allowed"):
            parallel_env("env1", **values)
