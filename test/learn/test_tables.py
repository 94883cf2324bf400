# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables on disk: bits kept, broken files refused with a line, nothing half written."""

import contextlib
from pathlib import Path

import numpy as np
import pytest

from sparse_coord_ros.errors import TablesError
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.run_config import load_run
from sparse_coord_ros.learn.simulation import learn, tables_equal
from sparse_coord_ros.learn.sparse import SparseTable
from sparse_coord_ros.learn.tables import (
    TEAM_FILE,
    load_counts,
    load_tables,
    load_team,
    pack_tables,
    robot_file,
    save_tables,
    save_team,
    unpack_counts,
    unpack_robot,
    unpack_tables,
)


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
    again = load_tables(path, [1, 2, 3])
    assert tables_equal(again, sparse_team)
    again[0].q_coord[0, 0, 0, 0] = 1.0  # it can be learned on
    with np.load(path) as file:
        shapes = {name: (file[name].shape, file[name].dtype) for name in file.files}
    rows = [len(pair.q_coord) for pair in sparse_team]
    assert shapes == {
        "format": ((), np.int64),
        **{f"q_star_{k}": ((21, 5), float) for k in (1, 2, 3)},
        **{f"q_coord_keys_{k}": ((rows[k - 1], 3), np.int32) for k in (1, 2, 3)},
        **{f"q_coord_rows_{k}": ((rows[k - 1], 4), float) for k in (1, 2, 3)},
        **{f"q_coord_unseen_{k}": ((), float) for k in (1, 2, 3)},
    }


def test_equal_tables_are_equal_bytes(team):
    data, again = (pack_tables({1: team[0], 2: team[1]}, counts={"step": 7}) for _ in range(2))
    assert data == again
    assert tables_equal(unpack_tables(data, [1, 2], where="here"), team)
    assert unpack_counts(data) == {"step": 7}
    assert "here" in refusal(lambda: unpack_tables(data[:-40], [1], where="here"))


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


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("keys", np.array([[0, 1, 21]], dtype=np.int32)),
        ("keys", np.array([0, 1, 2], dtype=np.int32)),
        ("keys", np.array([[0.0, 1.0, 2.0]])),
        ("keys", np.array([[0, 1, 2], [0, 1, 2]], dtype=np.int32)),
        ("rows", np.zeros((1, 5))),
        ("rows", np.array([["a", "b", "c", "d"]])),
        ("unseen", np.array([1.0, 2.0])),
    ],
)
def test_spoiled_sparse_tables(tmp_path, name, array):
    arrays = {
        "q_star_1": np.zeros((21, 5)),
        "q_coord_keys_1": np.array([[0, 1, 2]], dtype=np.int32),
        "q_coord_rows_1": np.zeros((1, 4)),
        "q_coord_unseen_1": np.float64(0),
    }
    path = tmp_path / TEAM_FILE
    np.savez(path, **arrays)
    assert load_tables(path, [1])[0].q_coord.shape == (21, 21, 21, 4)
    np.savez(path, **arrays | {f"q_coord_{name}_1": array})
    assert "cannot be read as tables" in refusal(load_tables, path, [1])
    del arrays[f"q_coord_{name}_1"]
    np.savez(path, **arrays)
    assert "q_coord" in refusal(load_tables, path, [1])


def test_names_and_shapes_in_the_file(tmp_path, team):
    save_team(tmp_path, team)
    with np.load(tmp_path / TEAM_FILE) as file:
        shapes = {name: file[name].shape for name in file.files}
    assert shapes == {
        "format": (),
        **{f"q_star_{k}": (21, 5) for k in (1, 2)},
        **{f"q_coord_{k}": (21, 21, 4) for k in (1, 2)},
    }


def test_robots_files_apart(tmp_path, team):
    scenario = load_scenario("env1")
    for k, robot in enumerate(scenario.robots):
        counts = {"answered": k, "late": 0}
        save_tables(robot_file(tmp_path, robot.name), {k + 1: team[k]}, counts=counts)
    assert tables_equal(load_team(tmp_path, scenario), team)
    assert load_counts(robot_file(tmp_path, "robot_2")) == {"answered": 1, "late": 0}
    (tmp_path / "tables_robot_2.npz").unlink()
    message = refusal(load_team, tmp_path, scenario)
    assert "neither tables.npz nor tables_robot_2.npz" in message


def test_saving_replaces_the_file_as_a_whole(tmp_path, team):
    path = tmp_path / TEAM_FILE
    save_tables(path, {1: team[0]})
    save_tables(path, {1: team[1]})
    assert [p.name for p in tmp_path.iterdir()] == [TEAM_FILE]
    assert tables_equal(load_tables(path, [1]), team[1:])


def test_no_tables_at_all(tmp_path):
    message = refusal(load_team, tmp_path, load_scenario("env1"))
    for words in (str(tmp_path), "tables.npz", "tables_robot_1.npz", "finished run"):
        assert words in message


def test_a_robot_that_is_not_in_the_file(tmp_path, team):
    save_team(tmp_path, team)
    message = refusal(load_team, tmp_path, load_scenario("env2-4r"))
    for words in (TEAM_FILE, "q_star_3", "run or train"):
        assert words in message


def test_numbers_beside_the_tables_that_are_spoiled(tmp_path, team):
    """Whatever byte is wrong: refused or without effect, by each function that reads them."""
    whole = pack_tables({1: team[0]}, counts={"late": 3, "step": 7})
    path, refused = tmp_path / "tables_robot_1.npz", 0
    places = [*range(whole.index(b"count_late"), whole.index(b"q_star_1"))]
    for place in places + [*range(whole.rindex(b"count_late") - 46, len(whole), 3)]:
        data = whole[:place] + bytes([whole[place] ^ 0x2B]) + whole[place + 1 :]
        path.write_bytes(data)
        try:
            tables, counts = unpack_robot(data, 1, where="here")
            assert tables_equal([tables], team[:1])
            assert {"late": 3, "step": 7}.items() >= counts.items() == load_counts(path).items()
        except TablesError as error:
            assert "\n" not in str(error)
            refused += 1
            with contextlib.suppress(TablesError):
                load_counts(path)
    assert refused > 50
    path.unlink()
    assert "cannot be read as tables" in refusal(load_counts, path)


@pytest.mark.parametrize("number", [np.array([1, 2]), np.array(["x"]), np.float64(1.5)])
def test_a_count_that_is_no_number(tmp_path, number):
    np.savez(tmp_path / "odd.npz", count_late=number)
    assert "count_late is no whole number" in refusal(load_counts, tmp_path / "odd.npz")


@pytest.mark.parametrize("content", [b"", b"just text", b"PK\x03\x04 no zip"])
def test_not_a_tables_file(tmp_path, content):
    path = tmp_path / TEAM_FILE
    path.write_bytes(content)
    message = refusal(load_team, tmp_path, load_scenario("env1"))
    assert f"{path}: cannot be read as tables" in message


def test_an_array_file_is_no_tables_file(tmp_path):
    with (tmp_path / TEAM_FILE).open("wb") as file:
        np.save(file, np.zeros(3))
    assert "cannot be read as tables" in refusal(load_team, tmp_path, load_scenario("env1"))


@pytest.mark.parametrize("array", [np.array([None]), np.array(["x"])])
def test_entries_that_are_no_numbers(tmp_path, array):
    np.savez(tmp_path / TEAM_FILE, q_star_1=array, q_coord_1=array)
    assert "cannot be read as tables" in refusal(load_tables, tmp_path / TEAM_FILE, [1])


def test_a_truncated_file(tmp_path, team):
    save_team(tmp_path, team)
    path = tmp_path / TEAM_FILE
    whole = path.read_bytes()
    for length in (10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        assert "cannot be read as tables" in refusal(load_tables, path, [1, 2])


def test_a_spoiled_byte_is_refused_or_without_effect(tmp_path, team):
    """Whatever byte is wrong: never a traceback, never other numbers (a zip has checksums)."""
    save_team(tmp_path, team)
    path = tmp_path / TEAM_FILE
    whole = path.read_bytes()
    refused = 0
    for place in range(0, len(whole), 89):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            assert tables_equal(load_tables(path, [1, 2]), team)
        except TablesError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > 100


def test_files_of_0_1_0_and_of_later_versions(tmp_path, team):
    old = Path(__file__).parents[1] / "fixtures/0.1.0/train_noncoop"
    run = load_run(old)
    assert tables_equal(load_team(old, run.scenario), learn(run.scenario, run.learner, run.seed))
    with np.load(old / TEAM_FILE) as file:
        assert "format" not in file.files
        arrays = {**file, "format": np.int64(3)}
    np.savez(tmp_path / "later.npz", **arrays)
    with pytest.raises(TablesError, match="later.npz: is in format 3, this version reads .* 2"):
        load_tables(tmp_path / "later.npz", [1])
