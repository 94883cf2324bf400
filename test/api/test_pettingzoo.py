# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The PettingZoo environment: its checks and ours; our learner learns the same bits through it."""

import copy
import pickle

import numpy as np
import pytest

pytest.importorskip("pettingzoo")  # package.xml does not bring it: it has no rosdep key
from pettingzoo.test import parallel_api_test
from teams import drawn, plain_run, tables_equal, walking

import sparse_coord_ros as sc
from sparse_coord_ros.api import evaluate
from sparse_coord_ros.base.errors import RunError, SettingError
from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Reward
from sparse_coord_ros.core.learners.agent import Agent, Choice
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.pettingzoo_env import parallel_env


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["env1", "env2-4r"])
@pytest.mark.parametrize("asking", ["half_steps", "in_observation"])
def test_pettingzoos_own_check(name, asking):
    env = sc.pettingzoo_env(name, phase="learning", asking=asking)
    parallel_api_test(env, num_cycles=100)


@pytest.mark.parametrize("asking", ["half_steps", "in_observation"])
def test_it_is_a_game_of_the_vector_environment(asking):
    scenario = load_scenario("crowd-3r", perception="probability:0.6", horizon=30)
    many = sc.vector_env(scenario, 1, seed=5, asking=asking)
    env = parallel_env(scenario, asking=asking)
    random = np.random.default_rng(3)
    rows, _ = many.reset()
    seen, _ = env.reset(seed=5)
    for _ in range(80):
        for k, name in enumerate(env.possible_agents):
            one = seen[name]
            if asking == "half_steps":
                assert one["action_mask"].tolist() == rows["action_mask"][0, k].tolist()
                one = one["observation"]
            assert one.tolist() == rows["observation"][0, k].tolist()
        masks = rows["action_mask"]
        actions = (random.random(masks.shape) * masks).argmax(axis=-1)
        acts = dict(zip(env.agents, actions[0].tolist(), strict=True))
        rows, paid, ended, cut, infos = many.step(actions)
        seen, rewards, over, stopped, told = env.step(acts)
        assert [*rewards.values()] == paid[0].tolist()
        assert {*over.values()} == {bool(ended[0])}
        assert {*stopped.values()} == {bool(cut[0])}
        assert [one["arrived"] for one in told.values()] == infos["arrived"][0].tolist()
        if not env.agents:
            rows, _ = many.reset()
            seen, _ = env.reset()


def test_without_masks_every_action_is_allowed_at_any_time():
    env = parallel_env("env1", asking="in_observation")
    seen, _ = env.reset(seed=1)
    for name in env.agents:
        env.action_space(name).seed(1)
    while env.agents:
        assert all(
            env.observation_space(name).contains(one) for name, one in seen.items()
        )
        acts = {name: env.action_space(name).sample() for name in env.agents}
        seen, _, _, _, infos = env.step(acts)
        assert not any(info["half_step"] for info in infos.values())


@pytest.mark.parametrize("how", ["pickle", "cloudpickle", "copy"])
def test_it_can_be_pickled_and_copied_at_any_time(how):
    def again(env):
        if how == "copy":
            return copy.deepcopy(env)
        return pickle.loads(pytest.importorskip(how).dumps(env))

    env = parallel_env("env1", phase="learning")
    again(env).reset(seed=1)
    env.reset(seed=1)
    half = again(env)
    acts = {"robot_1": 4, "robot_2": 2}
    assert repr(half.step(acts)) == repr(env.step(acts))
    acts = {"robot_1": 0, "robot_2": 2}
    assert repr(again(half).step(acts)) == repr(env.step(acts))


def test_a_step_after_the_end_says_reset():
    env = parallel_env(load_scenario("env1", horizon=2))
    for _ in range(2):
        env.reset(seed=1)
        while env.agents:
            env.step(dict.fromkeys(env.agents, 0))
        for acts in ({}, {"robot_1": 0, "robot_2": 0}):
            with pytest.raises(RunError, match=r"has ended; call reset\(\)"):
                env.step(acts)


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


@pytest.mark.parametrize("phase", ["evaluation", "learning"])
def test_the_same_seed_brings_the_same_episodes_to_their_ends(phase):
    scenario = load_scenario("env2-4r", perception="probability:0.6", horizon=60)
    first, again, other = (
        random_run(parallel_env(scenario, phase=phase), seed) for seed in (4, 4, 5)
    )
    assert first == again
    assert first != other


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("env1", {"penalty": -100, "perception": "probability:0.7"}),
        ("env2-4r", {"peers": "all", "perception": "probability:0.9"}),
    ],
)
def test_our_learner_learns_the_same_bits_through_it(name, settings):
    """The agents of Algorithm 1, driven by what the environment says alone."""
    scenario = load_scenario(name, steps=500, **settings)
    due = plain_run(scenario, "coop", 3)
    due.advance(500)
    env = parallel_env(scenario, phase="learning")
    rule = learner_of("coop")
    agents = {
        name: Agent(rule, scenario, k, 3) for k, name in enumerate(env.possible_agents)
    }
    seen, infos = env.reset(seed=3)
    asked = 0
    done = 0
    step = 1
    while done < 500:
        acting = [name for name in env.agents if not infos[name]["arrived"]]
        cells = {name: int(seen[name]["observation"][0]) for name in acting}
        decided = {name: agents[name].decide(step, cells[name]) for name in acting}
        acts = {name: choice.action for name, choice in decided.items()}
        percepts = dict.fromkeys(acting)
        if 4 in acts.values():
            seen, _, _, _, infos = env.step(acts)
            assert all(info["half_step"] for info in infos.values())
            for agent in acting:
                _, half, success, *others = seen[agent]["observation"].tolist()
                assert half == 1
                if success:
                    asked += 1
                    percepts[agent] = tuple(cell - 1 for cell in others if cell)
        taken = {
            agent: agents[agent].act(
                step, cells[agent], decided[agent], percepts[agent]
            )
            for agent in acting
        }
        seen, rewards, ended, cut, infos = env.step(
            {n: a.move for n, a in taken.items()}
        )
        for agent in acting:
            k = env.possible_agents.index(agent)
            parts = infos[agent]["reward_parts"]
            goal = parts[0] / (1 - scenario.discount)
            assert goal + parts[1] + parts[2] == rewards[agent]
            choice = Choice(cells[agent], decided[agent], taken[agent], percepts[agent])
            reward = Reward(*parts, sum(parts))
            agents[agent].learn(step, choice, reward, int(env.state()[k]))
        done += 1
        step += 1
        if not env.agents:
            assert len({*ended.values()}) == len({*cut.values()}) == 1
            assert all(ended.values()) != all(cut.values())
            seen, infos = env.reset()
            step += EPISODE_GAP
    assert asked > 20
    assert tables_equal([agent.tables for agent in agents.values()], due.tables)


def test_discounted_returns_are_those_of_evaluate():
    """Robot 3 arrives first; then the others meet in the doorway, and all pay."""
    robots = {"robot_1": (1, 2), "robot_2": (2, 1), "robot_3": (3, 4)}
    scenario = drawn("31..D..2\n4..#####", robots, penalty=-50)
    tables = walking(scenario)
    env = parallel_env(scenario)
    seen, _ = env.reset(seed=5)
    random = np.random.default_rng(5)
    returns = []
    late = 0
    for _ in range(400):
        total = 0.0
        discount = 1.0
        while env.agents:
            acts = {}
            for k, name in enumerate(env.agents):
                values = tables[k].q_star[seen[name]["observation"][0], :4]
                acts[name] = int(random.choice(np.flatnonzero(values == values.max())))
            before = seen
            seen, rewards, *_ = env.step(acts)
            for name, reward in rewards.items():
                waits = before[name]["action_mask"].sum() == 1
                late += waits and reward < 0.0
            total += discount * np.mean([*rewards.values()])
            discount *= scenario.discount
        returns.append(total)
        seen, _ = env.reset()
    found = evaluate(tables, scenario=scenario, learner="noncoop", trials=4000)
    error = np.std(returns) / len(returns) ** 0.5
    assert late > 0
    assert abs(np.mean(returns) - found.mean("returns")) < 4 * error


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
    for values in ({"phase": "any"}, {"render_mode": "human"}):
        with pytest.raises(SettingError, match="allowed"):
            parallel_env("env1", **values)
