# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables on disk: bits kept, broken files refused with a line, nothing half written."""

import numpy as np
import pytest

from sparse_coord_ros.errors import TablesError
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learners.tables import Tables
from sparse_coord_ros.learners.registry import learner_of
from sparse_coord_ros.engine.run import Learning
from sparse_coord_ros.learners.tables import tables_equal
from sparse_coord_ros.learn.sparse import SparseTable
from sparse_coord_ros.learn.tables import TEAM_FILE, load_saved, load_team, pack_tables, robot_file, save_team, unpack_robot, unpack_saved


@pytest.fixture
def team():
    """Return tables of two robots on env1, with NaN columns."""
    draws = np.random.default_rng(0)
    pairs = [Tables(draws.random((21, 5)), draws.random((21, 21, 4))) for _ in range(2)]
    for pair in pairs:
        pair.q_star[:, 4] = np.nan
    return pairs


def refusal(call, *arguments):
    with pytest.raises(TablesError) as error:
        call(*arguments)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_team_round_trip(tmp_path, team):
    save_team(tmp_path, team)
    assert [path.name for path in tmp_path.iterdir()] == [TEAM_FILE]
    assert tables_equal(load_team(tmp_path, load_scenario("env1")), team)


@pytest.fixture
def sparse_team():
    """Return tables of three robots over joint states; the third has seen none."""
    draws = np.random.default_rng(1)
    team = []
    for k in range(3):
        table = SparseTable(21, 3, 150.0)
        for _ in range((40, 7, 0)[k]):
            entry = (*draws.integers(21, size=3).tolist(), int(draws.integers(4)))
            table[entry] = float(draws.normal())
        team.append(Tables(draws.random((21, 5)), table))
    return team


def test_sparse_team_round_trip(tmp_path, sparse_team):
    path = tmp_path / TEAM_FILE
    save_team(tmp_path, sparse_team)
    again = [saved.tables for saved in load_saved(path, [1, 2, 3])]
    assert tables_equal(again, sparse_team)
    again[0].q_coord[0, 0, 0, 0] = 1.0  # it can be learned on
    with np.load(path) as file:
        shapes = {name: (file[name].shape, file[name].dtype) for name in file.files}
    rows = [len(pair.q_coord) for pair in sparse_team]
    assert {name: shape for name, shape in shapes.items() if name != "format"} == {
        **{f"q_star_{k}": ((21, 5), float) for k in (1, 2, 3)},
        **{f"q_coord_keys_{k}": ((rows[k - 1], 3), np.int32) for k in (1, 2, 3)},
        **{f"q_coord_rows_{k}": ((rows[k - 1], 4), float) for k in (1, 2, 3)},
        **{f"q_coord_unseen_{k}": ((), float) for k in (1, 2, 3)},
    }


def test_equal_tables_are_equal_bytes(team):
    data, again = (pack_tables({1: team[0], 2: team[1]}, counts={"step": 7}) for _ in range(2))
    assert data == again
    saved = unpack_saved(data, [1, 2], where="here")
    assert tables_equal([one.tables for one in saved], team)
    assert [one.counts for one in saved] == [{"step": 7}] * 2
    assert "here" in refusal(lambda: unpack_robot(data[:-40], 1, where="here"))


def test_the_order_of_learning_does_not_show_in_the_file(tmp_path, sparse_team):
    (q_star, table, _), *others = sparse_team
    turned = SparseTable(21, 3, 150.0)
    for key, row in zip(table.keys.tolist()[::-1], table.rows[::-1], strict=True):
        for action in range(4):
            turned[(*key, action)] = row[action]
    files = []
    for name, team in (("a", sparse_team), ("b", [Tables(q_star, turned), *others])):
        (tmp_path / name).mkdir()
        save_team(tmp_path / name, team)
        files.append((tmp_path / name / TEAM_FILE).read_bytes())
    assert files[0] == files[1]


def test_robots_files_apart(tmp_path, team):
    scenario = load_scenario("env1")
    for k, robot in enumerate(scenario.robots):
        counts = {"answered": k, "late": 0}
        robot_file(tmp_path, robot.name).write_bytes(pack_tables({k + 1: team[k]}, counts=counts))
    assert tables_equal(load_team(tmp_path, scenario), team)
    assert load_saved(robot_file(tmp_path, "robot_2"), [2])[0].counts == {"answered": 1, "late": 0}
    (tmp_path / "tables_robot_2.npz").unlink()
    message = refusal(load_team, tmp_path, scenario)
    assert f"{tmp_path}: neither tables.npz nor tables_robot_2.npz" in message
    assert "finished run" in message


def test_a_robot_that_is_not_in_the_file(tmp_path, team):
    save_team(tmp_path, team)
    message = refusal(load_team, tmp_path, load_scenario("env2-4r"))
    for words in (TEAM_FILE, "q_star_3", "run or train"):
        assert words in message


def test_another_format_is_one_line(tmp_path, team):
    save_team(tmp_path, team)
    with np.load(tmp_path / TEAM_FILE) as file:
        arrays = {**file, "format": np.array(2)}
    np.savez(tmp_path / TEAM_FILE, **arrays)
    message = refusal(load_saved, tmp_path / TEAM_FILE, [1])
    assert "is in format 2, this version reads format 1; update" in message


@pytest.mark.parametrize(("name", "learner"), [("env1", "coop"), ("env2-4r", "factored")])
def test_who_reads_tables_can_learn_on(tmp_path, name, learner):
    """All that the agent remembers is there: the bits of one that never stopped."""
    rule = learner_of(learner)
    often = {"conflict": "any_doorway", "epsilon": "constant:0.6", "max_steps": 20, "ask_cost": 0}
    scenario = rule.with_defaults(load_scenario(name, steps=1200, **often))
    whole = Learning(scenario, rule, 3)
    whole.advance(1000)
    state = whole.state()
    save_team(tmp_path, whole.tables, state.memories)
    saved = load_saved(tmp_path / TEAM_FILE, range(1, len(scenario.robots) + 1))
    assert tables_equal([one.tables for one in saved], whole.tables)
    assert learner == "coop" or all(len(one.tables.factors.states) > 1 for one in saved)
    again = Learning(scenario, rule, 3, state._replace(memories=[one.memory for one in saved]))
    for learning in (whole, again):
        learning.advance(1200)
    assert tables_equal(again.tables, whole.tables)
