# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord bench`: tables, JSON, what is missing."""

import json
import sys

import pytest

import sparse_coord_ros.bench as package
from sparse_coord_ros.bench import batch
from sparse_coord_ros.cli import bench
from sparse_coord_ros.compiling import has_numba

SHORT = ("--steps", 100, "--runs", 2, "--repeats", 1)


@pytest.fixture
def in_this_process(monkeypatch):
    """Measure batches here, where tests can change things, and without compiling numba's loops."""

    def measure(name, *, steps, runs, repeats):
        return batch.measure_here(name, steps, runs, repeats)

    monkeypatch.setattr(batch, "measure", measure)
    monkeypatch.setattr(batch, "has_numba", lambda: False)


@pytest.fixture
def live(monkeypatch):
    """Replace the live measurement by known figures."""
    names = [
        f"{where}, {what}"
        for where in ("one process", "processes")
        for what in ("bare rclpy nodes", "learning", "learning and recording")
    ]
    found = {name: [100.0 * (i + 1), 300.0] for i, name in enumerate(names)}
    monkeypatch.setattr(bench, "_measure_live", lambda steps, repeats: (found, 240 * steps))
    monkeypatch.setattr(bench, "_measure_teams", lambda steps, repeats: {2: [70.0], 32: [9.0]})
    return found


@pytest.mark.skipif(not has_numba(), reason="numba is not installed")
def test_batch_in_its_own_process(sparse_coord):
    code, out, err = sparse_coord("bench", "batch", *SHORT, "--json")
    data = json.loads(out)
    assert (code, err, data["steps"]) == (0, "", 100)
    assert "steps_per_second" not in data
    found = data["batch"]
    assert found["ready_seconds"] > 0
    assert 10e6 < found["peak_memory"] < 10e9
    names = {figure["name"] for figure in found["figures"]}
    assert names == {batch.ENGINE, batch.PYTHON}
    for figure in found["figures"]:
        assert figure["missing"] == ""
        assert len(figure["agent_steps_per_second"]) == 1
        assert figure["agent_steps_per_second"][0] > 0


def test_batch_without_numba(sparse_coord, in_this_process):
    code, out, err = sparse_coord("bench", "batch", *SHORT)
    assert (code, err) == (0, "")
    assert "env1, Coop., 2 runs of 100 steps" in out
    assert out.count("engine (numba): numba is not installed") == 1
    assert out.endswith("engine (numba): numba is not installed\n")
    (row,) = [line for line in out.splitlines() if line.startswith("plain Python")]
    assert float(row.split()[-1]) > 0
    assert "C loop" not in out
    assert "peak memory" not in out
    data = json.loads(sparse_coord("bench", "batch", *SHORT, "--json")[1])["batch"]
    assert data["ready_seconds"] is data["peak_memory"] is None


def test_all_prints_all_tables(sparse_coord, live, in_this_process):
    code, out, err = sparse_coord("bench", *SHORT)
    assert (code, err) == (0, "")
    first, teams, second = out.split("\n\n")
    assert "of bare nodes" in first
    assert "processes, learning" in first
    assert teams.splitlines()[-1].split() == ["32", "9", "9", "to", "9", "288"]
    assert "M agent-steps/s" in second
    data = json.loads(sparse_coord("bench", *SHORT, "--json")[1])
    assert data["steps_per_second"] == live
    assert set(data) == {"scenario", "steps", "steps_per_second", "bag_bytes", "teams", "batch"}


def test_live_only(sparse_coord, live, monkeypatch):
    monkeypatch.setattr(batch, "measure", None)
    code, out, err = sparse_coord("bench", "live")
    assert (code, err) == (0, "")
    assert "M agent-steps/s" not in out
    last = out.split("\n\n")[0].splitlines()[-1]  # medians are (100 i + 300) / 2 with i from 1
    assert last.startswith("with recording 120% of the speed without in one process, 112% in many")
    assert last.endswith("240 bytes a time step")


@pytest.mark.long
def test_teams_of_a_generated_building(monkeypatch):
    monkeypatch.setattr(bench, "TEAMS", (2, 4))
    found = bench._measure_teams(100, 1)
    assert [len(found[robots]) for robots in (2, 4)] == [1, 1]
    assert all(rates[0] > 0 for rates in found.values())


def test_live_without_ros(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "sparse_coord_ros.bench.ceiling", None)
    monkeypatch.delattr(package, "ceiling", raising=False)
    message = refused("bench", "live")
    assert "ROS 2 is not there" in message
    assert "sparse_coord bench batch" in message


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--steps", "99"], ["steps", "from 100 to"]),
        (["batch", "--runs", "0"], ["runs", "from 1 to"]),
        (["live", "--repeats", "many"], ["repeats", "'many'"]),
    ],
)
def test_bad_input(refused, arguments, words):
    message = refused("bench", *arguments)
    assert [word for word in words if word not in message] == []
