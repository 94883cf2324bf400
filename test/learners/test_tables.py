# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables on disk: bits kept, broken files refused with a line, nothing half written."""

import numpy as np
import pytest
from teams import memories_equal, tables_equal, tables_from_values

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.saved_tables import (
    TEAM_FILE,
    load_saved,
    load_team,
    pack_tables,
    robot_file,
    save_team,
    unpack_saved,
)
from sparse_coord_ros.core.runs.team import Team


@pytest.fixture
def team():
    """Return tables of two robots on env1 that cannot ask."""
    draws = np.random.default_rng(0)
    scenario = load_scenario("env1")
    made = []
    for k in range(2):
        q_star = draws.random((21, 5))
        q_star[:, 4] = np.nan
        made.append(tables_from_values(scenario, k, q_star))
    return made


def memories(team):
    return [table.memory for table in team]


def numbered(team):
    return dict(enumerate(memories(team), start=1))


def refusal(call, *arguments):
    with pytest.raises(TablesError) as error:
        call(*arguments)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("learner", ["coop", "voi"])
def test_round_trip_of_a_learner(tmp_path, learner):
    scenario = load_scenario("env1")
    rule = learner_of(learner)
    run = LearningRun(Team(scenario, rule, compiled=False), 1)
    run.advance(20)
    save_team(tmp_path, run.memories)
    assert tables_equal(load_team(tmp_path, scenario, rule), run.tables)


def test_team_round_trip(tmp_path, team):
    save_team(tmp_path, memories(team))
    assert [path.name for path in tmp_path.iterdir()] == [TEAM_FILE]
    assert tables_equal(
        load_team(tmp_path, load_scenario("env1"), learner_of("noncoop")), team
    )


@pytest.fixture
def sparse_run():
    """Return a run of three robots whose Q^C is over joint states."""
    scenario = load_scenario("crowd-3r", peers="all", q_star_init=250, steps=40)
    run = LearningRun(Team(scenario, Coop(), compiled=False), 1)
    run.advance(40)
    return run


def test_sparse_team_round_trip(tmp_path, sparse_run):
    save_team(tmp_path, sparse_run.memories)
    assert tables_equal(
        load_team(tmp_path, sparse_run.scenario, Coop()), sparse_run.tables
    )
    with np.load(tmp_path / TEAM_FILE) as file:
        shapes = {name: (file[name].shape, file[name].dtype) for name in file.files}
    due = {}
    for k, memory in enumerate(sparse_run.memories, start=1):
        rows = len(memory["q_coord_keys"])
        assert 0 < rows < 40
        due[f"q_star_{k}"] = ((59, 5), np.float64)
        due[f"updates_{k}"] = ((59, 5), np.int64)
        due[f"q_coord_keys_{k}"] = ((rows,), np.int64)
        due[f"q_coord_values_{k}"] = ((rows, 4), np.float64)
        due[f"q_coord_updates_{k}"] = ((rows, 4), np.int64)
    assert {name: shape for name, shape in shapes.items() if name != "format"} == due


def test_keys_are_the_digits_of_joint_states(sparse_run):
    memory = sparse_run.memories[1]
    tables = sparse_run.tables[1]
    for key, row in zip(
        memory["q_coord_keys"].tolist(), memory["q_coord_values"], strict=True
    ):
        state = (key // 59**2, key // 59 % 59, key % 59)
        assert tables.q_coord[state].tolist() == row.tolist()
        assert [tables.q_coord[(*state, move)] for move in range(4)] == row.tolist()
    assert tables.q_coord.shape == (59, 59, 59, 4)
    assert tables.q_coord[58, 58, 58].tolist() == [sparse_run.scenario.q_coord_init] * 4


def test_equal_tables_are_equal_bytes(team):
    data, again = (pack_tables(numbered(team), counts={"step": 7}) for _ in range(2))
    assert data == again
    saved = unpack_saved(data, [1, 2], where="here")
    for one, table in zip(saved, team, strict=True):
        assert memories_equal(one.memory, table.memory)
        assert one.counts == {"step": 7}
    assert "here" in refusal(lambda: unpack_saved(data[:-40], [1], where="here"))


def test_robots_files_apart(tmp_path, team):
    scenario = load_scenario("env1")
    for k, robot in enumerate(scenario.robots):
        counts = {"answered": k, "late": 0}
        robot_file(tmp_path, robot.name).write_bytes(
            pack_tables({k + 1: team[k].memory}, counts=counts)
        )
    assert tables_equal(load_team(tmp_path, scenario, learner_of("noncoop")), team)
    assert load_saved(robot_file(tmp_path, "robot_2"), [2])[0].counts == {
        "answered": 1,
        "late": 0,
    }
    (tmp_path / "tables_robot_2.npz").unlink()
    message = refusal(load_team, tmp_path, scenario, learner_of("noncoop"))
    assert "tables_robot_2.npz" in message


def test_a_robot_that_is_not_in_the_file(tmp_path, team):
    save_team(tmp_path, memories(team))
    message = refusal(
        load_team, tmp_path, load_scenario("env2-4r"), learner_of("noncoop")
    )
    for words in (TEAM_FILE, "q_star_3", "run or train"):
        assert words in message


def test_another_format_is_one_line(tmp_path, team):
    save_team(tmp_path, memories(team))
    with np.load(tmp_path / TEAM_FILE) as file:
        arrays = {**file, "format": np.array(1)}
    np.savez(tmp_path / TEAM_FILE, **arrays)
    message = refusal(load_saved, tmp_path / TEAM_FILE, [1])
    assert "format 1" in message


def test_tables_from_elsewhere_act_as_their_values_say():
    scenario = load_scenario("env1")
    q_star = np.zeros((21, 5))
    q_coord = np.zeros((21, 21, 4))
    q_coord[3, 4] = [0.0, 1.0, 2.0, 1.0]
    tables = tables_from_values(scenario, 1, q_star, q_coord)
    assert (tables.q_coord == q_coord).all() and (tables.q_star == q_star).all()
    message = refusal(tables_from_values, scenario, 0, np.zeros((20, 5)), None)
    assert (
        "tables do not match robot 1 of scenario env1 with learner coop: q_star "
        in message
    )
    assert "(cells" not in message
