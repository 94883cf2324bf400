# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many games at once: each is that of World and of PettingZoo, and pays what evaluate reports."""

import subprocess
import sys

import numpy as np
import pytest
from teams import drawn, walking

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import RunError, SettingError
from sparse_coord_ros.core.game import many_games
from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import PEER, PHASES, ROBOT, draw, keys_of
from sparse_coord_ros.core.game.perception import asked_peers
from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.world import Action, World

STARTS = {"starts": "mixed:0.7", "max_steps": 25, "horizon": 30}

CASES = [
    ("env1", {"penalty": -100, "perception": "probability:0.7"}),
    ("env1", {"perception": "line_of_sight", "interactions": "together:any_doorway"}),
    ("pentagon", {"perception": "probability:0.7", "move_success": 0.6}),
    ("crowd-3r", {"perception": "probability:0.6", "move_success": 0.8}),
    ("env2-4r", {"peers": "all", "perception": "range:6"}),
    ("crowd-8r", {"peers": "all", "perception": "probability:0.4"}),
    ("crowd-8r", {"perception": "probability:0.9", "penalty": -3}),
    ("env2-2r", {"interactions": "block:anywhere"}),
    ("crowd-8r", {"interactions": "together:anywhere+swap"}),
    ("env2-4r", {"interactions": "together+swap+block"}),
    ("env1", {"interactions": "swap", "common_reward": "each:1:0.5"}),
]
"""Two, three, four and eight robots; percepts that fail for each kind of reason; interactions."""


class OneGame:
    """A game of one seed, by `World` and `Percepts` alone."""

    def __init__(self, scenario, seed, phase):
        number = PHASES[phase]
        most = scenario.horizon if phase == "evaluation" else scenario.max_steps
        self.scenario = scenario
        self.world = World(scenario, seed, phase=number, max_steps=most)
        self.percepts = Percepts(scenario, seed, number)
        self.keys = keys_of(seed, number, len(scenario.robots))[ROBOT]

    def perceived(self, k):
        """Return what robot k perceives now: by peer its cell; empty: the percept fails."""
        step = self.world.step
        cells = self.world.cells
        which = draw(self.keys[k], step, PEER)
        peers = asked_peers(self.scenario.peers, k, len(cells), which)
        sees = [self.percepts.sees(step, k, cells[k], cells[j]) for j in peers]
        return {j: cells[j] for j in peers} if all(sees) else {}

    def observation(self, k, half, perceived):
        """Return the row of an observation."""
        world = self.world
        others = [perceived.get(j, -1) + 1 for j in range(len(world.cells)) if j != k]
        return [world.cells[k], half, bool(perceived), *others]

    def paid(self, moves, asked):
        """Make a time step; return rewards, their parts, who waited, and whether it conflicts."""
        world = self.world
        waited = list(world.arrived)
        acts = [
            None if waits else Action(int(move), bool(asks), -1, False)
            for move, asks, waits in zip(moves, asked, waited, strict=True)
        ]
        found = world.advance(acts)
        parts = [tuple(reward[:3]) for reward in found.rewards]
        for_ever = self.scenario.goal_reward / (1 - self.scenario.discount)
        rewards = [
            for_ever * (k in found.arrived) + part[1] + part[2]
            for k, part in enumerate(parts)
        ]
        return rewards, parts, found.miscoordination


def random_actions(random, masks):
    """Return actions that are allowed."""
    return (random.random(masks.shape) * masks).argmax(axis=-1)


@pytest.mark.parametrize("phase", ["evaluation", "learning"])
@pytest.mark.parametrize(("name", "changed"), CASES)
def test_half_steps_are_the_games_of_the_world(name, changed, phase):
    scenario = sc.load_scenario(name, **{**STARTS, **changed})
    env = sc.vector_env(scenario, 3, seed=11, phase=phase)
    games = [OneGame(scenario, 11 + i, phase) for i in range(3)]
    team = range(len(scenario.robots))
    random = np.random.default_rng(1)
    seen, infos = env.reset()
    asked = np.zeros((3, len(team)), dtype=bool)
    counts = dict.fromkeys(("halves", "answers", "failures", "ends"), 0)
    for _ in range(150):
        actions = random_actions(random, seen["action_mask"])
        before = seen["action_mask"]
        over = [game.world.episode_over for game in games]
        half = infos["half_step"]
        seen, rewards, ended, cut, infos = env.step(actions)
        for i, game in enumerate(games):
            perceived = [{} for _ in team]
            acts = before[i].sum(axis=1) > 1
            if over[i]:
                counts["ends"] += 1
                game.world.begin_episode()
                paid = np.zeros(len(team)), np.zeros((len(team), 3)), False
            elif not half[i] and (actions[i][acts] == COORDINATE).any():
                counts["halves"] += 1
                asked[i] = (actions[i] == COORDINATE) & acts
                for k in np.flatnonzero(asked[i]):
                    perceived[k] = game.perceived(k)
                    counts["answers" if perceived[k] else "failures"] += 1
                paid = np.zeros(len(team)), np.zeros((len(team), 3)), False
                assert infos["half_step"][i]
            else:
                paid = game.paid(actions[i], asked[i])
                asked[i] = False
            expected = [
                game.observation(k, infos["half_step"][i], perceived[k]) for k in team
            ]
            assert seen["observation"][i].tolist() == expected
            assert rewards[i].tolist() == list(paid[0])
            assert infos["reward_parts"][i].tolist() == [list(row) for row in paid[1]]
            assert infos["miscoordination"][i] == paid[2]
            assert infos["arrived"][i].tolist() == game.world.arrived
            assert (ended[i] or cut[i]) == game.world.episode_over
            assert ended[i] == all(game.world.arrived)
            state = [*game.world.cells, *game.world.arrived, infos["half_step"][i]]
            assert env.state()[i].tolist() == state
    assert counts["halves"] > 20 and counts["ends"] > 3
    assert counts["answers"] + counts["failures"] > 20
    if changed.get("perception", "always").startswith("prob"):
        assert counts["failures"] > 3


@pytest.mark.parametrize("phase", ["evaluation", "learning"])
@pytest.mark.parametrize(("name", "changed"), CASES)
def test_in_observation_the_answer_is_of_the_next_time_step(name, changed, phase):
    scenario = sc.load_scenario(name, **{**STARTS, **changed})
    env = sc.vector_env(scenario, 3, seed=5, asking="in_observation", phase=phase)
    games = [OneGame(scenario, 5 + i, phase) for i in range(3)]
    team = range(len(scenario.robots))
    random = np.random.default_rng(2)
    seen, infos = env.reset()
    answers = 0
    for _ in range(100):
        actions = random_actions(random, seen["action_mask"])
        over = [game.world.episode_over for game in games]
        seen, rewards, ended, cut, infos = env.step(actions)
        for i, game in enumerate(games):
            perceived = [{} for _ in team]
            if over[i]:
                game.world.begin_episode()
                paid = [0.0] * len(team)
            else:
                asks = (actions[i] >= PRIMITIVES) & ~np.array(game.world.arrived)
                paid, *_ = game.paid(actions[i] % PRIMITIVES, asks)
                for k in np.flatnonzero(asks & ~np.array(game.world.arrived)):
                    perceived[k] = game.perceived(k)
                    answers += bool(perceived[k])
            expected = [game.observation(k, False, perceived[k]) for k in team]
            assert seen["observation"][i].tolist() == expected
            assert rewards[i].tolist() == list(paid)
            assert (ended[i] or cut[i]) == game.world.episode_over
            waits = np.array(game.world.arrived) | game.world.episode_over
            allowed = np.where(waits, 1, 2 * PRIMITIVES)
            assert seen["action_mask"][i].sum(axis=1).tolist() == allowed.tolist()
    assert not infos["half_step"].any()
    assert answers > 10


TINY = drawn(
    "31..D..2\n4..#####",
    {"robot_1": (1, 2), "robot_2": (2, 1), "robot_3": (3, 4)},
    perception="probability:0.5",
    penalty=-7,
    horizon=9,
    max_steps=7,
    starts="mixed:0.5",
)


def in_turn(env, steps=60):
    """Return all that an environment says while the same choices are made."""
    random = np.random.default_rng(4)
    seen, infos = env.reset(seed=9)
    said = [(seen, infos)]
    for _ in range(steps):
        said.append(env.step(random_actions(random, said[-1][0]["action_mask"])))
    return said


def as_lists(value):
    """Return plain data of what an environment says."""
    if isinstance(value, dict):
        return {name: as_lists(one) for name, one in value.items()}
    if isinstance(value, np.ndarray):
        return as_lists(value.tolist())
    if isinstance(value, list | tuple):
        return [as_lists(one) for one in value]
    return value


@pytest.mark.parametrize("asking", ["half_steps", "in_observation"])
@pytest.mark.parametrize("phase", ["evaluation", "learning"])
def test_compiled_and_plain_python_agree(monkeypatch, asking, phase):
    made = {"asking": asking, "phase": phase}
    scenario = sc.load_scenario("crowd-3r", perception="probability:0.6", **STARTS)
    compiled = in_turn(sc.vector_env(scenario, 3, **made))
    monkeypatch.setattr(many_games, "has_numba", lambda: False)
    monkeypatch.setattr(many_games, "loops", lambda: many_games.PLAIN)
    assert as_lists(in_turn(sc.vector_env(scenario, 3, **made))) == as_lists(compiled)


# What a team is worth.


def greedy_actions(tables, seen, random):
    """Return what greedy robots with these tables do; a draw decides between equal values."""
    masks = seen["action_mask"]
    values = np.full(masks.shape, -np.inf)
    for k, table in enumerate(tables):
        cell, half, answer, *others = seen["observation"][:, k].T
        values[:, k] = np.nan_to_num(table.q_star[cell], nan=-np.inf)
        if table.q_coord is not None:
            sure = answer == 1
            values[sure, k, :PRIMITIVES] = table.q_coord[cell, others[0] - 1][sure]
            for i in np.flatnonzero(half & ~sure):
                values[i, k, :PRIMITIVES] = table.values_asking(int(cell[i]), 0, ())
    values[masks == 0] = -np.inf
    return (values + 1e-9 * random.random(values.shape)).argmax(axis=-1)


def returns_of(env, tables, episodes):
    """Return discounted returns of so many episodes of each game, shape (n, robots)."""
    random = np.random.default_rng(6)
    found = [[] for _ in range(env.num_envs)]
    seen, infos = env.reset()
    total = np.zeros(seen["observation"].shape[:2])
    discount = np.ones(env.num_envs)
    while min(map(len, found)) < episodes:
        seen, rewards, ended, cut, infos = env.step(
            greedy_actions(tables, seen, random)
        )
        total += discount[:, None] * rewards
        discount *= np.where(infos["half_step"], 1.0, env.discount)
        over = ended | cut
        for i in np.flatnonzero(over):
            found[i].append(total[i].copy())
        total[over] = 0.0
        discount[over] = 1.0 / env.discount  # the next call begins an episode
    return np.concatenate([one[:episodes] for one in found])


@pytest.mark.parametrize("learner", ["coop", "voi", "noncoop"])
@pytest.mark.parametrize("perception", ["always", "probability:0.5"])
def test_a_learned_team_is_worth_what_exact_evaluation_says(learner, perception):
    scenario = sc.load_scenario(
        "env1", penalty=-100, perception=perception, steps=20_000
    )
    training = sc.train(scenario, learner, seed=4)
    env = sc.vector_env(training.scenario, 1000, seed=1)
    means = returns_of(env, training.tables, 8).mean(axis=1)
    error = means.std(ddof=1) / len(means) ** 0.5
    value = sc.evaluate_exact(training).mean("returns")
    assert abs(means.mean() - value) < 4 * error
    assert error < 0.5


def test_robots_that_have_arrived_pay_for_later_miscoordinations():
    """Robot 3 arrives with its first moves; robots 1 and 2 meet in the doorway later."""
    scenario = TINY.with_settings({"horizon": 200, "penalty": -50})
    tables = walking(scenario)
    env = sc.vector_env(scenario, 500, seed=3)
    found = returns_of(env, tables, 8)
    played = sc.evaluate(tables, scenario=scenario, learner="noncoop", trials=4000)
    error = found.mean(axis=1).std() / len(found) ** 0.5
    apart = abs(found.mean() - played.mean("returns"))
    assert apart < 4 * np.hypot(error, played.error("returns"))
    assert played.mean("miscoordinations") > 0.1
    goal = scenario.goal_reward / (1 - scenario.discount)
    assert (found[:, 2] < goal * scenario.discount**2 - 10).mean() > 0.05


# Autoreset.


@pytest.mark.parametrize("asking", ["half_steps", "in_observation"])
def test_a_game_begins_anew_by_itself_or_by_a_mask_with_the_same_episodes(asking):
    """The same actions of each game bring the same episodes, whenever they begin."""
    scenario = sc.load_scenario("env2-4r", perception="probability:0.7", horizon=12)
    by_itself, by_mask = (
        episodes_of(sc.vector_env(scenario, 5, seed=8, asking=asking), masked=masked)
        for masked in (False, True)
    )
    assert by_itself == by_mask
    assert min(map(len, by_itself)) > 4


def episodes_of(env, *, masked):
    """Return a list for each game: its episodes, as lists of all that was said."""
    games = range(env.num_envs)
    randoms = [np.random.default_rng(i) for i in games]
    seen, infos = env.reset()
    current = [[as_lists([seen["observation"][i]])] for i in games]
    found = [[] for _ in games]
    over = np.zeros(env.num_envs, dtype=bool)
    while min(map(len, found)) < 5:
        actions = np.zeros(seen["observation"].shape[:2], dtype=np.int64)
        for i in games:
            if masked or not over[i]:
                actions[i] = random_actions(randoms[i], seen["action_mask"][i])
        begins = np.zeros_like(over) if masked else over
        seen, rewards, ended, cut, infos = env.step(actions)
        over = ended | cut
        for i in games:
            if begins[i]:
                current[i] = [as_lists([seen["observation"][i]])]
                assert not rewards[i].any() and not over[i]
                continue
            names = ("half_step", "miscoordination", "arrived", "reward_parts")
            kept = [seen["observation"][i], seen["action_mask"][i], rewards[i]]
            kept += [ended[i], cut[i], *(infos[name][i] for name in names)]
            current[i].append(as_lists(kept))
            if over[i]:
                found[i].append(current[i])
        if masked and over.any():
            seen, infos = env.reset(options={"reset_mask": over})
            assert (infos["_arrived"] == over).all()
            for i in np.flatnonzero(over):
                current[i] = [as_lists([seen["observation"][i]])]
    return [one[:5] for one in found]


def test_a_mask_of_reset_begins_some_games_and_leaves_others():
    env = sc.vector_env("env1", 3, seed=1)
    with pytest.raises(RunError, match="no episodes yet"):
        env.step(np.zeros((3, 2), dtype=int))
    with pytest.raises(RunError, match="no episodes yet"):
        env.reset(options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(RunError, match="no episodes yet"):
        env.state()
    begun = env.reset()[0]["observation"]
    first = env.step(np.full((3, 2), COORDINATE))[0]
    assert first["observation"][:, :, 1].all()
    mask = np.array([False, True, False])
    seen, infos = env.reset(seed=40, options={"reset_mask": mask})
    assert (seen["observation"][mask] == begun[mask]).all()
    assert infos["half_step"].tolist() == [True, False, True]
    assert infos["_half_step"].tolist() == mask.tolist()
    moved = env.step(np.zeros((3, 2), dtype=int))[0]["observation"][1]
    other = sc.vector_env("env1", 1, seed=41)
    other.reset()
    assert (other.step(np.zeros((1, 2), dtype=int))[0]["observation"][0] == moved).all()


# Arguments, masks, libraries.


def test_options_of_a_reset_are_a_dictionary():
    env = sc.vector_env("env1", 2, seed=1)
    with pytest.raises(
        SettingError, match="options: value is 5, allowed: a dictionary"
    ):
        env.reset(options=5)
    env.reset(options={})


def test_bad_actions_change_nothing():
    env = sc.vector_env("env1", 2, seed=1)
    seen, _ = env.reset()
    for actions in (None, [[0, 1]], np.zeros((2, 2)), [[0, 1], [0, "n"]], {}):
        with pytest.raises(SettingError, match="actions"):
            env.step(actions)
    for action in (-1, 5, 2**40):
        with pytest.raises(SettingError, match="game 1, robot_2: action"):
            env.step([[0, 0], [0, action]])
    before = env.state()
    seen, rewards, *_ = env.step([[COORDINATE, 2], [0, 0]])
    assert rewards[0].tolist() == [0.0, 0.0]
    assert seen["action_mask"][0].tolist() == [[1, 1, 1, 1, 0], [0, 0, 1, 0, 0]]
    assert seen["action_mask"][1].all()
    with pytest.raises(SettingError, match=r"game 0, robot_2: .*allowed: \[2\]"):
        env.step([[0, 3], [0, 0]])
    seen["action_mask"][:] = 1
    with pytest.raises(SettingError, match="game 0, robot_1: action is 4"):
        env.step([[COORDINATE, 2], [0, 0]])
    assert env.state()[0, :4].tolist() == before[0, :4].tolist()
    rewards = env.step([[0, 2], [0, 0]])[1]
    assert rewards[0, 0] == -1.0


def test_seeds():
    same = sc.vector_env("env1", 4, seed=6, phase="learning").reset()[0]["observation"]
    assert (
        sc.vector_env("env1", 4, phase="learning").reset(seed=6)[0]["observation"]
        == same
    ).all()
    later = sc.vector_env("env1", 3, seed=7, phase="learning").reset()[0]["observation"]
    assert (later == same[1:]).all()
    chances = {
        sc.vector_env("env1", 9, phase="learning").reset()[0]["observation"].tobytes()
        for _ in range(3)
    }
    assert len(chances) == 3


def test_a_list_has_the_seed_of_each_game():
    env = sc.vector_env("env1", 3, seed=[9, 3, 4], phase="learning")
    single = [sc.vector_env("env1", 1, seed=i, phase="learning") for i in (9, 3, 4)]
    seen = env.reset()[0]["observation"]
    assert seen.tolist() == [
        one.reset()[0]["observation"][0].tolist() for one in single
    ]
    again = env.reset(seed=[9, None, 4])[0]["observation"]
    assert again[[0, 2]].tolist() == seen[[0, 2]].tolist()
    assert again[1].tolist() == single[1].reset()[0]["observation"][0].tolist()
    with pytest.raises(SettingError, match="allowed: 3 seeds, one for each game"):
        env.reset(seed=[1, 2])


@pytest.mark.parametrize("how", ["pickle", "cloudpickle"])
def test_it_can_be_pickled_at_any_time(how):
    module = pytest.importorskip(how)
    env = sc.vector_env("env1", 2, seed=1)
    for _ in range(2):
        other = module.loads(module.dumps(env))
        assert as_lists(in_turn(other, 9)) == as_lists(in_turn(env, 9))


def test_it_is_an_environment_of_gymnasium():
    vector = pytest.importorskip("gymnasium.vector")
    for asking in ("half_steps", "in_observation"):
        env = sc.vector_env("crowd-3r", 3, seed=1, asking=asking)
        assert isinstance(env, vector.VectorEnv)
        assert env.metadata["autoreset_mode"] == vector.AutoresetMode.NEXT_STEP
        wrapped = vector.VectorWrapper(env)
        env.action_space.seed(1)
        seen, _ = wrapped.reset(seed=3)
        for _ in range(30):
            assert env.observation_space.contains(seen)
            one = {name: rows[0] for name, rows in seen.items()}
            assert env.single_observation_space.contains(one)
            actions = env.action_space.sample()
            if asking == "half_steps":
                actions = random_actions(np.random, seen["action_mask"])
            assert env.action_space.contains(actions)
            seen, *_ = wrapped.step(actions)
        wrapped.close()


def test_it_needs_no_gymnasium():
    code = """
import sys
sys.modules["gymnasium"] = None
import numpy as np
import sparse_coord_ros as sc
env = sc.vector_env("env1", 3, seed=1)
seen, infos = env.reset()
seen, rewards, *_ = env.step(np.zeros((3, 2), dtype=int))
print(rewards.shape, env.actions, env.robots)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "(3, 2) 5 ('robot_1', 'robot_2')\n", done.stderr
