# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The log as arrays and as a data frame: equal to the simulation without ROS."""

import re
from collections import Counter
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from recordings import copied
from teams import chosen, plain_run, same_bits, tables_equal

from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.world import World
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.log.bags import BagWriter
from sparse_coord_ros.log.bags.playlist import Playlist
from sparse_coord_ros.log.bags.reader import open_bag
from sparse_coord_ros.log.runlog import read_run, verify
from sparse_coord_ros.log.runlog.explain import coordinations, explained
from sparse_coord_ros.protocol.wire.messages import Messages

HALF = {"perception": "probability:0.5"}


@pytest.fixture(scope="module", params=["env1", "crowd-3r"])
def run(request, record):
    settings = {"perception": "probability:0.5", "steps": 250}
    if request.param == "crowd-3r":
        settings["peers"] = "all"
    return record(request.param, settings)


def test_arrays_are_what_the_simulation_says(run):
    scenario = run.run.scenario
    log = read_run(run.bag)
    robots = range(len(run.names))
    agents = [Agent(Coop(), scenario, k, 7) for k in robots]
    percepts = Percepts(scenario, 7)
    world = World(scenario, 7)
    rows = {step: row for row, step in enumerate(log.step.tolist())}
    frame = Messages(run.run)
    seen = set()
    outcomes = Counter()

    def check_states():
        row = rows[world.step]
        seen.add(world.step)
        assert log.cells[row].tolist() == world.cells
        assert log.position[row].tolist() == [
            list(frame.centres[cell]) for cell in world.cells
        ]
        assert log.episode[row] == world.episode

    check_states()
    while world.transitions < scenario.steps:
        row = rows[world.step]
        choices = [chosen(agent, world, percepts) for agent in agents]
        actions = [None if choice is None else choice.action for choice in choices]
        outcome = world.advance(actions)
        for agent, choice in zip(agents, choices, strict=True):
            if choice is not None:
                k = agent.number
                agent.learn(world.step - 1, choice, outcome.rewards[k], world.cells[k])
        for k in robots:
            if actions[k] is None:
                assert log.action[row, k] == log.move[row, k] == log.peer[row, k] == -1
                assert np.isnan(log.rewards[row, k]).all() and not log.asked[row, k]
                continue
            _, decision, action, perceived = choices[k]
            assert log.action[row, k] == decision.action
            assert log.move[row, k] == action.move
            assert (log.asked[row, k], log.peer[row, k]) == (action.asked, action.peer)
            assert log.perceived[row, k] == action.perceived
            assert tuple(log.rewards[row, k]) == outcome.rewards[k]
            expected = [-1] * len(run.names)
            for peer, cell in zip(decision.peers, perceived or (), strict=False):
                expected[peer] = cell
            assert log.percept[row, k].tolist() == expected
            outcomes[action.asked, action.perceived] += 1
        check_states()
        if outcome.episode_over and world.transitions < scenario.steps:
            world.begin_episode()
            check_states()
    assert seen == set(rows)
    assert len(outcomes) == 3 and min(outcomes.values()) > 5
    final = [log.tables[k, world.step] for k in robots]
    assert tables_equal(final, [agent.tables for agent in agents])
    assert log.damage is None and log.problems == () and log.whole


def test_it_prints_as_one_line(run):
    assert re.fullmatch(
        r"<RunLog \S+.*; coop, seed \d+; [\d,]+ steps in \S+>", repr(read_run(run.bag))
    )


def test_a_data_frame(run):
    log = read_run(run.bag)
    frame = log.to_pandas()
    assert len(frame) == log.cells.size
    assert frame["asked"].sum() == log.asked.sum()
    second = frame[frame["robot"] == "robot_2"].set_index("step")
    assert second["cell"].tolist() == log.cells[:, 1].tolist()
    assert second["reward"].sum() == np.nansum(log.column("total")[:, 1])
    assert second["percept_robot_1"].tolist() == log.percept[:, 1, 0].tolist()


@pytest.mark.parametrize(
    ("name", "settings"),
    [("env1", HALF), ("env2-4r", {"max_steps": 9})],
)
def test_its_history_is_that_of_the_simulation(record, name, settings):
    run = record(name, {"steps": 300, **settings})
    found = read_run(run.bag).history()
    learning = plain_run(run.run.scenario, "coop", run.run.seed)
    learning.advance(300)
    expected = learning.history
    assert found.length.sum() == 300
    assert same_bits(found, expected)


def test_a_history_counts_whole_transitions_only(run):
    """Those whose reward and next state are in the log, and questions that brought a reward."""
    log = read_run(run.bag)
    whole = log.history()
    first = int(whole.first_step[0])
    length = int(whole.length[0])
    assert length > 8
    half = log.between(first, first + length // 2).history()
    assert half.length.tolist() == [length // 2]
    kept = np.ones(len(log.step), dtype=bool)
    kept[3:6] = False  # nobody recorded these: the length of their episode is unknown
    arrays = vars(log)
    rows = {name: a[kept] for name, a in arrays.items() if isinstance(a, np.ndarray)}
    assert replace(log, **rows).history().first_step[0] == whole.first_step[1]
    row, k = np.argwhere(log.asked & ~np.isnan(log.column("total")))[0]
    rewards = log.rewards.copy()
    rewards[row, k] = np.nan  # the world went on without the robot
    assert replace(log, rewards=rewards).history().asks.sum() == whole.asks.sum() - 1


def test_a_history_without_penalty_has_its_miscoordinations(record):
    run = record("env2-4r", {"penalty": 0, "interactions": "together:any_doorway"})
    found = read_run(run.bag).history()
    assert (
        found.miscoordinations.sum() == run.recording.world.world.miscoordinations > 0
    )


def test_a_team_in_a_namespace(good, tmp_path):
    source = open_bag(good.bag)
    bag = tmp_path / "bag"
    with closing(BagWriter(bag)) as new:
        new.add_metadata("sparse_coord_ros", source.metadata["sparse_coord_ros"])
        copied(new, source, source.messages(), prefix="/team_a")
    found = verify(bag)
    assert found.same, found.first
    assert found.steps == 250
    log = read_run(bag)
    assert next(explained(log, 0, coordinations(log, 0)[3:])).agrees
    opened = open_bag(bag)
    assert (
        Playlist(opened, opened.topics).step_count
        == Playlist(source, source.topics).step_count
    )


def test_reading_says_how_far_it_is(record):
    bag = record(settings={"steps": 600}, chunk=5000).bag
    told = []
    log = read_run(bag, lambda *counts: told.append(counts))
    size = sum(file.stat().st_size for file in bag.glob("*.mcap")) // 1000
    assert len(log.step) and told == sorted(told)
    assert {total for _, total in told} == {size}
    assert 0.5 * size < told[-1][0] <= size
