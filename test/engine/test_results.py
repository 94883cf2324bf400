# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results directories: resumed, never mixed."""

import json
import math

import numpy as np
import pytest

from sparse_coord_ros.core.agent import initial_tables
from sparse_coord_ros.core.evaluation import Trials
from sparse_coord_ros.engine import results as module
from sparse_coord_ros.engine.batch import Run
from sparse_coord_ros.engine.cells import make_cell
from sparse_coord_ros.engine.results import Plan, collect, open_results
from sparse_coord_ros.errors import ResultsError

CELL = make_cell("env1", "coop", {"penalty": -20})
PLAN = Plan(seed=5, runs=3, trials=4)


def made_up(seed):
    """Return a run with made-up trials of two robots."""
    draw = np.random.default_rng(seed)
    shape = (PLAN.trials, 2)
    asked = np.zeros((2, 21), dtype=np.int64)
    asked[0, 3] = 8 + seed
    arrived = np.ones(shape, dtype=bool)
    arrived[0, 1] = seed != 6
    trials = Trials(
        reward=draw.normal(120, 10, shape),
        time_to_goal=draw.normal(10, 1, shape),
        asks=draw.normal(1, 0.1, shape),
        arrived=arrived,
        miscoordinations=draw.normal(0.4, 0.1, PLAN.trials),
        asked=asked,
    )
    tables = [initial_tables(CELL.scenario, "coop")] * 2
    return Run(seed, tables, np.array([40, 60 + seed]), trials)


@pytest.fixture
def result():
    return collect(CELL, PLAN.trials, map(made_up, PLAN.seeds))


def test_mean_spread_and_standard_error(result):
    rewards = np.stack([made_up(seed).trials.reward for seed in PLAN.seeds])
    measure = result.measure("reward")
    assert measure.mean == pytest.approx(rewards.mean())
    assert measure.spread == pytest.approx(rewards.std())
    runs = rewards.mean(axis=(1, 2))
    assert measure.standard_error == pytest.approx(runs.std(ddof=1) / math.sqrt(3))
    conflicts = np.stack([made_up(seed).trials.miscoordinations for seed in PLAN.seeds])
    assert result.measure("miscoordinations").spread == pytest.approx(conflicts.std())


def test_arrival_sparsity_and_where_robots_asked(result):
    assert result.not_arrived == [0, 1, 0]
    assert result.arrived == pytest.approx(11 / 12)
    assert result.failed_teams == 1
    assert result.visited_share == pytest.approx(np.mean([52.5, 53, 53.5]) / 21**2)
    assert result.visited_bytes == pytest.approx(53 * 32)
    assert result.asked[0][3] == pytest.approx((13 + 14 + 15) / 12)
    assert np.array(result.asked).shape == (2, 21)
    assert result.optimum == pytest.approx(121.89, abs=0.01)
    assert result.optimum_exact
    assert result.reference["reward"] == pytest.approx(119.68, abs=0.01)


def test_a_result_reads_back_and_the_directory_is_gone_on_with(tmp_path, result):
    with open_results(tmp_path / "r", PLAN) as results:
        assert results.load(CELL) is None
        results.save(CELL, result)
    with open_results(tmp_path / "r", PLAN) as results:
        assert results.load(CELL) == result


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (Plan(6, 3, 4), "seed 5, this is seed 6"),
        (Plan(5, 2, 4), "runs 3, this is runs 2"),
        (Plan(5, 3, 9), "trials 4, this is trials 9"),
    ],
)
def test_other_plans_are_refused(tmp_path, plan, words):
    with open_results(tmp_path, PLAN):
        pass
    with pytest.raises(ResultsError, match=words), open_results(tmp_path, plan):
        pass


def test_another_version_is_refused(tmp_path, monkeypatch):
    with open_results(tmp_path, PLAN):
        pass
    monkeypatch.setattr(module, "__version__", "99.0")
    with pytest.raises(ResultsError, match="99.0.*--out"), open_results(tmp_path, PLAN):
        pass


def test_another_protocol_is_refused_and_nothing_is_lost(tmp_path, result, monkeypatch):
    with open_results(tmp_path, PLAN) as results:
        results.save(CELL, result)
        before = results.path(CELL).read_bytes()
        monkeypatch.setattr(module, "digest", lambda cell: "0" * 16)
        with pytest.raises(ResultsError, match="nothing is mixed"):
            results.load(CELL)
        assert results.path(CELL).read_bytes() == before


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b"null", b"\xff\xfe", b'{"id": 3}'])
def test_a_damaged_result_is_put_aside_and_open_again(tmp_path, result, damage):
    with open_results(tmp_path, PLAN) as results:
        results.save(CELL, result)
        path = results.path(CELL)
        path.write_bytes(damage)
        assert results.load(CELL) is None
        assert path.with_name(path.name + ".broken").read_bytes() == damage
        results.save(CELL, result)
        assert results.load(CELL) == result


@pytest.mark.parametrize("field", ["means", "not_arrived", "visited", "asked"])
def test_a_result_with_a_part_missing_is_put_aside(tmp_path, result, field):
    with open_results(tmp_path, PLAN) as results:
        results.save(CELL, result)
        path = results.path(CELL)
        data = json.loads(path.read_text())
        del data[field]
        path.write_text(json.dumps(data))
        assert results.load(CELL) is None


@pytest.mark.parametrize("damage", ["", "[1]", "{"])
def test_a_damaged_manifest_is_an_error(tmp_path, damage):
    (tmp_path / "results.json").write_text(damage)
    with pytest.raises(ResultsError, match="not readable as JSON"), open_results(tmp_path, PLAN):
        pass


def test_a_directory_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("dear to me")
    with pytest.raises(ResultsError, match="holds other files"), open_results(tmp_path, PLAN):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_file_as_directory(tmp_path):
    (tmp_path / "f").write_text("")
    with pytest.raises(ResultsError, match="cannot be used"), open_results(tmp_path / "f", PLAN):
        pass


def test_one_process_at_a_time(tmp_path):
    with (
        open_results(tmp_path, PLAN),
        pytest.raises(ResultsError, match="another process"),
        open_results(tmp_path, PLAN),
    ):
        pass
