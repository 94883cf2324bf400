# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's three measures: by hand, against exact values, for teams that never arrive."""

import numpy as np
import pytest
from teams import learn, tables_from_values, untrained, walking

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.core.game.draws import EVALUATION
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import World
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.evaluation import check_tables, greedy_team, play

GAMMA = 0.95


def test_sure_moves_by_hand(make):
    """Both enter the doorway of 1..D..2 at step 3 and arrive at step 6."""
    scenario = make(move_success=1)
    result = play(scenario, walking(scenario), trials=3, seed=0)
    assert result.mean("returns") == pytest.approx(
        200 * GAMMA**5 - 20 * GAMMA**2, rel=1e-12
    )
    assert result.mean("miscoordinations") == 1
    assert result.mean("time_to_goal") == 6
    assert result.spread("returns") == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("perception", ["always", "never", "probability:0.5"])
def test_asking_every_step_by_hand(make, perception):
    """Robot 1 acts once in each of the first five cells, robot 2 in each of the last five."""
    scenario = make("1....2", move_success=1, perception=perception, ask_cost=0.5)
    tables = walking(scenario, coordinate=1e9)
    result = play(scenario, tables, trials=3, seed=0)
    costs = 0.5 * sum(GAMMA**t for t in range(5))
    assert result.mean("returns") == pytest.approx(200 * GAMMA**4 - costs, rel=1e-12)
    assert result.mean("asks") == 5
    assert result.mean("time_to_goal") == 5
    assert result.stays.tolist() == [[1] * 5 + [0], [0] + [1] * 5]
    assert (result.asked == result.stays).all()


def test_a_perceived_peer_means_acting_on_q_coord(make):
    scenario = make("1....2", move_success=1)
    north = np.tile([1.0, 0.0, 0.0, 0.0], (6, 6, 1))  # a wall
    tables = []
    for k, pair in enumerate(walking(scenario, coordinate=1e9)):
        tables.append(tables_from_values(scenario, k, pair.q_star, north))
    assert play(scenario, tables, trials=1, seed=0).mean("arrived") == 0
    blind = scenario.with_settings({"perception": "never"})
    assert play(blind, tables, trials=1, seed=0).mean("arrived") == 1


def test_tables_that_do_not_fit():
    scenario = load_scenario("env1")
    other = load_scenario("isr")
    good = untrained(scenario)
    with pytest.raises(TablesError, match="1 robots.*env1"):
        play(scenario, [good], trials=1, seed=0)
    foreign = untrained(other)
    with pytest.raises(TablesError, match="robot 2 of scenario env1 .*q_star"):
        play(scenario, [good, foreign], trials=1, seed=0)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["q_star", "q_coord_values"])
def test_tables_of_no_numbers(name, value):
    scenario = load_scenario("crowd-3r")
    good = untrained(scenario)
    row = {
        "q_coord_keys": np.zeros(1, dtype=np.int64),
        "q_coord_values": np.ones((1, 4)),
        "q_coord_updates": np.ones((1, 4), dtype=np.int64),
    }
    memory = {n: array.copy() for n, array in (good.memory | row).items()}
    memory[name][0, 1] = value
    bad = Tables(scenario, good.rule, 1, memory)
    with pytest.raises(TablesError, match=f"robot 2 of .*{name} has values"):
        check_tables(scenario, [good, bad, good], "coop")


def test_robots_begin_each_greedy_episode_anew():
    """Those of voi forget whom they saw stand in their way."""
    voi = learner_of("voi")
    scenario = voi.with_defaults(load_scenario("crowd-3r", steps=600))
    team = greedy_team(scenario, learn(scenario, voi, 1), 0)
    world = World(scenario, 0, phase=EVALUATION)
    team.begin_episode(world)
    begun = [agent.memory()["stood"].tolist() for agent in team.agents]
    stood = set()
    for _ in range(3):
        while not world.episode_over:
            world.advance(team.act(world))
        stood |= {agent.memory()["stood"][0] >= 0 for agent in team.agents}
        team.begin_episode(world)
        assert [agent.memory()["stood"].tolist() for agent in team.agents] == begun
    assert True in stood
