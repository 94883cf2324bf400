# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results directories: resumed, never mixed."""

import errno
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from teams import untrained

from sparse_coord_ros.base.errors import ResultsError, SettingError
from sparse_coord_ros.base.version import FORMAT
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.engine.trained import Training
from sparse_coord_ros.core.game.scenario import scenario_from_dict
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.history import blank_history
from sparse_coord_ros.core.runs.measures import (
    TRIAL,
    TRIALS,
    Measures,
    by_run,
)
from sparse_coord_ros.studies import store as module
from sparse_coord_ros.studies.condition_result import collect, result_of_run
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.runner import compute
from sparse_coord_ros.studies.store import Plan, open_results

CONDITION = make_condition("env1", "coop", {"penalty": -20})
PLAN = Plan(seed=5, runs=3, trials=4)


def made_up(seed):
    """Return a run with made-up trials of two robots."""
    draw = np.random.default_rng(seed)
    shape = (PLAN.trials, 2)
    asked = np.zeros((2, 21))
    asked[0, 3] = (8 + seed) / PLAN.trials
    stays = np.zeros((2, 21))
    stays[1, 4] = (20 + seed) / PLAN.trials
    arrived = np.ones(PLAN.trials, dtype=bool)
    arrived[0] = seed != 6
    trials = Measures(
        source=TRIALS,
        unit=TRIAL,
        trials=PLAN.trials,
        returns=draw.normal(120, 10, shape),
        time_to_goal=draw.normal(10, 1, shape),
        miscoordinations=draw.normal(0.4, 0.1, PLAN.trials),
        asks=draw.normal(1, 0.1, shape),
        arrived=arrived,
        asked=asked,
        stays=stays,
    )
    scenario = CONDITION.scenario
    return Training(
        scenario,
        learner_of("coop"),
        seed,
        engine="python",
        tables=[untrained(scenario)] * 2,
        history=blank_history(0, 2),
        visited=np.array([40, 60 + seed]),
        transitions=scenario.steps,
        measures=trials,
    )


@pytest.fixture
def result():
    runs = (result_of_run(made_up(seed)) for seed in PLAN.seeds)
    return collect(CONDITION, PLAN.seed, runs)


def test_a_result_has_the_measures_of_its_runs(result):
    measures = result.measures
    assert measures == by_run(made_up(seed).measures for seed in PLAN.seeds)
    assert measures.arrived.tolist() == [1.0, 0.75, 1.0]
    assert measures.failed == 1
    assert measures.asked[0, 3] == pytest.approx((13 + 14 + 15) / 12)
    assert measures.stays.sum() == pytest.approx((25 + 26 + 27) / 12)
    assert result.to_dict().items() >= measures.to_dict().items()


def test_sparsity_and_what_it_is_compared_with(result):
    assert result.visited_share == pytest.approx(np.mean([52.5, 53, 53.5]) / 21**2)
    assert result.visited_bytes == pytest.approx(53 * 40)
    assert result.optimum == pytest.approx(121.89, abs=0.01)
    assert result.optimum_exact
    assert result.shortest_paths.mean("returns") == pytest.approx(119.68, abs=0.01)


@pytest.mark.parametrize(
    ("name", "settings"), [("crowd-3r", {"peers": "all"}), ("env1", {})]
)
def test_the_bytes_of_visited_rows_include_their_keys(name, settings):
    one = make_condition(name, "coop", {"steps": 300, **settings})
    runs = list(run_batch(one.scenario, "coop", [1, 2], trials=2, jobs=1))
    result = collect(one, 1, map(result_of_run, runs))
    assert result.joint_states == len(one.scenario.map.cells) ** one.scenario.perceived
    memories = [table.memory for run in runs for table in run.tables]
    sizes = [
        sum(one[f"q_coord_{part}"].nbytes for part in ("keys", "values"))
        for one in memories
    ]
    assert result.visited_bytes == pytest.approx(np.mean(sizes))


def test_a_result_reads_back_and_the_directory_is_gone_on_with(tmp_path, result):
    with open_results(tmp_path / "r", PLAN) as results:
        assert results.load(CONDITION) is None
        results.save(CONDITION, result)
    with open_results(tmp_path / "r", PLAN) as results:
        assert results.load(CONDITION) == result


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


def test_another_format_of_the_manifest_is_refused(tmp_path):
    with open_results(tmp_path, PLAN):
        pass
    manifest = tmp_path / "results.json"
    manifest.write_text(
        manifest.read_text().replace(f'"format": {FORMAT}', '"format": 5')
    )
    words = f"results.json: is in format 5, this version reads format {FORMAT}; make it anew"
    with pytest.raises(ResultsError, match=words), open_results(tmp_path, PLAN):
        pass


def test_another_version_of_the_software_goes_on(tmp_path, result, monkeypatch):
    with open_results(tmp_path, PLAN) as results:
        results.save(CONDITION, result)
    monkeypatch.setattr(module, "__version__", "99.0")
    with open_results(tmp_path, PLAN) as results:
        assert results.load(CONDITION) == result


def test_the_digest_covers_what_affects_the_computation_and_no_more():
    def digest(text, learner="coop", **settings):
        scenario = scenario_from_dict(yaml.safe_load(text), where="here", name="mine")
        return module.computation_digest(
            SimpleNamespace(learner=learner, scenario=scenario)
        )

    text = yaml.safe_dump(CONDITION.scenario.to_dict())
    same = digest(text)
    assert "Two rooms" in text
    assert digest(text.replace("Two rooms", "2 rooms")) == same
    assert digest(text.replace("name: env1", "name: other")) == same
    assert digest(text, "noncoop") != same
    assert digest(text.replace("penalty: -20.0", "penalty: -20.5")) != same
    assert digest(text.replace("1.#.2", "..#12")) != same


def test_another_protocol_is_refused_and_nothing_is_lost(tmp_path, result, monkeypatch):
    with open_results(tmp_path, PLAN) as results:
        results.save(CONDITION, result)
        before = results.path(CONDITION).read_bytes()
        monkeypatch.setattr(module, "computation_digest", lambda condition: "0" * 16)
        with pytest.raises(ResultsError, match="not merged"):
            results.load(CONDITION)
        assert results.path(CONDITION).read_bytes() == before


@pytest.mark.parametrize(
    "damage", ["", "[1]", "{", f'{{"format": {FORMAT}, "seed": 1e999}}']
)
def test_a_damaged_manifest_is_an_error(tmp_path, damage):
    (tmp_path / "results.json").write_text(damage)
    with (
        pytest.raises(ResultsError, match="results.json: "),
        open_results(tmp_path, PLAN),
    ):
        pass


def test_a_directory_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("dear to me")
    with (
        pytest.raises(ResultsError, match="holds other files"),
        open_results(tmp_path, PLAN),
    ):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_an_interrupted_first_call_leaves_nothing_in_the_way(tmp_path):
    (tmp_path / "results.json.partial").write_text('{"form')
    with open_results(tmp_path, PLAN) as results:
        assert results.load(CONDITION) is None
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


@pytest.mark.parametrize("when", ["open", "replace"])
def test_what_cannot_be_written_leaves_no_part(tmp_path, monkeypatch, result, when):
    real = Path.open

    def refuse(first, *mode, **__):
        if when == "open":
            real(
                first, *mode
            ).close()  # a full disk takes the name and not what is in it
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with open_results(tmp_path, PLAN) as results:
        monkeypatch.setattr(os if when == "replace" else Path, when, refuse)
        with pytest.raises(OSError, match="No space left on device"):
            results.save(CONDITION, result)
        monkeypatch.undo()
        assert list(results.path(CONDITION).parent.iterdir()) == []
        results.save(CONDITION, result)
        assert results.load(CONDITION) == result


def test_the_last_run_s_seed_is_below_2_to_the_63():
    assert Plan(2**63 - 3, 3, 4).seeds[-1] == 2**63 - 1
    with pytest.raises(SettingError, match="setting seed.*3 runs"):
        Plan(2**63 - 2, 3, 4)


def test_one_process_at_a_time(tmp_path):
    with (
        open_results(tmp_path, PLAN),
        pytest.raises(ResultsError, match="another process"),
        open_results(tmp_path, PLAN),
    ):
        pass


class Backwards:
    """Stands in for a cluster: a task a run, the last one's results come first."""

    def shares(self, seeds, steps, runs):
        return [[seed] for seed in seeds]

    def results(self, work, given):
        for number in reversed(range(len(given))):
            yield number, work(*given[number])


def test_runs_that_come_in_any_order_are_kept_in_that_of_their_seeds():
    one = make_condition("env1", "coop", {"steps": 300})
    here, there = (compute([one], PLAN, cluster=c) for c in (None, Backwards()))
    assert here == there
