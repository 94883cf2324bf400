# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord evaluate`: the measures beside paper and optimum, and bad input."""

import json
from dataclasses import replace

import pytest
import yaml
from teams import tables_in

from sparse_coord_ros.cli import evaluate as module
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.evaluation import TRIALS, play
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.solve.exact import evaluate_exact


@pytest.fixture
def trained(sparse_coord):
    """Return a function that makes a short run and returns its directory's name."""

    def train(*arguments):
        short = ("--steps", 1000, "--trials", 0, "--out", "a")
        assert sparse_coord("train", *arguments, *short)[0] == 0
        return "a"

    return train


def test_table(sparse_coord, trained):
    trained("env1", "--penalty", -20, "--learner", "indiv")
    code, out, err = sparse_coord("evaluate", "a", "--trials", 50)
    assert (code, err) == (0, "")
    for words in (
        "env1, penalty -20",
        "  50 trials\n",
        "  paper\n",
        "119.50",
    ):
        assert words in out
    assert "exact joint optimum" in out
    assert "121.89" in out


def test_means_of_trials_have_a_standard_error_and_exact_ones_have_none(
    sparse_coord, trained
):
    trained("env1", "--learner", "indiv", "--seed", 2)
    found = json.loads(sparse_coord("evaluate", "a", "--trials", 50, "--json")[1])
    said = "{returns:.2f} ± {returns_error:.2f}".format(**found)
    assert found["returns_error"] > 0
    out = sparse_coord("evaluate", "a", "--trials", 50)[1]
    assert said in out and "\n±: standard error (s.e.)\n" in out
    assert "±" not in sparse_coord("evaluate", "a")[1]


def test_spreads_have_their_own_columns_where_they_are_asked_for(sparse_coord, trained):
    trained("env1", "--learner", "indiv", "--set", "penalty=-20")
    out = sparse_coord("evaluate", "a", "--spread")[1]
    head, _, ours, papers, *_ = out.splitlines()
    assert "s.d. of return" in head and "±" not in out
    spread = json.loads(sparse_coord("evaluate", "a", "--json")[1])["returns_spread"]
    assert f"  {spread:.2f}  " in ours
    assert "paper" in papers and papers.split()[-4] == "12.50"


def test_json_holds_the_numbers_of_the_core(sparse_coord, trained, folder):
    trained("env1", "--penalty", -20, "--learner", "noncoop", "--seed", "3")
    code, out, err = sparse_coord(
        "evaluate", "a", "--trials", 40, "--seed", 9, "--json"
    )
    assert (code, err) == (0, "")
    data = json.loads(out)
    scenario = load_scenario("env1", penalty=-20)
    result = play(scenario, tables_in(folder / "a"), trials=40, seed=9)
    assert data.items() >= result.to_dict().items()
    assert data["robots"] == result.by_robot()
    assert (data["scenario"], data["learner"]) == ("env1", "noncoop")
    assert data["paper"]["returns"] == [119.3, 12.2]
    assert data["optimum"] == pytest.approx(121.89, abs=0.01)
    assert data["optimum_exact"] is True


@pytest.mark.parametrize(
    "setting", ["goal_reward=9", "move_success=0.5", "interactions=swap", "horizon=50"]
)
def test_another_game_is_not_compared_with_the_paper(sparse_coord, trained, setting):
    trained("env1", "--penalty", -20, "--set", setting)
    out = sparse_coord("evaluate", "a", "--trials", 5)[1]
    assert "paper" not in out


def test_robots_that_saw_their_peers_are_named_so(sparse_coord, trained):
    """The paper's learned from answers alone."""
    trained("env1", "--penalty", -20, "--set", "peers_seen=while_learning")
    out = sparse_coord("evaluate", "a", "--trials", 5)[1]
    assert "\ncoop, peers seen while learning" in out and "paper" not in out
    data = json.loads(sparse_coord("evaluate", "a", "--trials", 5, "--json")[1])
    assert data["peers_seen"] == "while_learning"


def test_another_penalty_is_not_compared_with_the_paper(sparse_coord, trained):
    trained("env1")
    data = json.loads(sparse_coord("evaluate", "a", "--trials", 5, "--json")[1])
    assert data["paper"] == {}
    assert data["optimum"] == pytest.approx(120.6, abs=0.1)
    out = sparse_coord("evaluate", "a", "--trials", 5)[1]
    assert "env1, penalty -100" in out
    assert "paper" not in out


@pytest.mark.parametrize(
    ("left", "verb"), [("checkpoint", "run"), ("checkpoint.npz", "train")]
)
def test_a_run_that_is_not_finished(sparse_coord, trained, folder, left, verb):
    trained("env1")
    (folder / "a" / left).touch()
    code, _, err = sparse_coord("evaluate", "a", "--trials", 10)
    assert (
        code == 0
        and "a: the run is not finished, its tables are those of a checkpoint" in err
    )
    remedy = f"; continue with: sparse_coord {verb} --resume a\n"
    assert err.endswith(remedy)
    summary = folder / "a" / "summary.yaml"
    whole = summary.read_text()
    steps = load_run(folder / "a").scenario.steps
    summary.write_text(f"transitions: {steps}\n")  # of nodes that were started by hand
    _, out, err = sparse_coord("evaluate", "a", "--trials", 10)
    assert "not finished" not in err
    completed = yaml.safe_load(summary.read_text())
    assert list(completed) == ["result", "verdict", "transitions"]
    assert "returns" in completed["result"]
    assert completed["verdict"] == out.splitlines()[-1]
    summary.write_text(whole)
    (folder / "a" / "tables.npz").unlink()
    code, _, err = sparse_coord("evaluate", "a", "--trials", 10)
    assert code == 2
    assert err == f"error: a: the run is not finished and has no tables yet{remedy}"


def test_exact(sparse_coord, trained, folder):
    trained("env1")
    code, out, err = sparse_coord("evaluate", "a")
    assert (code, err) == (0, "")
    assert out.splitlines()[2].startswith("coop ") and "  exact\n" in out
    assert "trials" not in out
    assert "best asking team found" in out
    assert "118.51" in out
    data = json.loads(sparse_coord("evaluate", "a", "--json")[1])
    scenario = load_scenario("env1").with_settings({"penalty": -100})
    found = evaluate_exact(scenario, tables_in(folder / "a"))
    assert data.items() >= found.to_dict().items()
    assert (data["source"], data["returns_error"]) == ("exact", 0)
    assert data["best_asking_team"] == pytest.approx(118.5092, abs=1e-4)


def test_several_runs_side_by_side(sparse_coord, folder, monkeypatch):
    monkeypatch.setattr(module, "TRIALS", replace(TRIALS, default=30))
    short = ("--steps", 300, "--trials", 0)
    for out, *arguments in (
        ("a", "env1"),
        ("b", "env1", "--learner", "noncoop"),
        ("c", "env2-4r", "--penalty", -20, "--seed", 4),
    ):
        assert sparse_coord("train", *arguments, *short, "--out", out)[0] == 0
    code, out, err = sparse_coord("evaluate", "a", "b", "c", "--json")
    assert (code, err) == (0, "")
    runs = json.loads(out)["runs"]
    assert [
        (one["directory"], one["scenario"], one["learner"], one["seed"]) for one in runs
    ] == [
        ("a", "env1", "coop", 0),
        ("b", "env1", "noncoop", 0),
        ("c", "env2-4r", "coop", 4),
    ]
    assert [one["source"] for one in runs] == ["exact", "exact", "trials"]
    assert (
        runs[1]["returns"]
        == json.loads(sparse_coord("evaluate", "b", "--json")[1])["returns"]
    )
    alike = sparse_coord("evaluate", "a", "b", "a")[1].splitlines()[2:5]
    named = [line.split("  ")[0] for line in alike]
    assert named == ["a: coop", "noncoop", "a: coop"]
    env1, env2 = sparse_coord("evaluate", "a", "b", "c")[1].split("\n\n")
    assert [line.split("  ")[0] for line in env1.splitlines()[2:]] == [
        "coop",
        "noncoop",
        "fixed shortest paths",
        "best asking team found",
        "exact joint optimum",
    ]
    sources = [line.rsplit("  ")[-1] for line in env2.splitlines()[2:4]]
    assert sources == ["30 trials", "paper"]
    assert env2.count("bound (robots alone)") == 1
    by_trials = sparse_coord("evaluate", "a", "b", "--trials", 20)[1]
    assert by_trials.count("  20 trials\n") == 2
