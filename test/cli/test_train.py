# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord train`: the tables of `core.simulation.learn`, and bad input."""

import json

import pytest

from sparse_coord_ros.core.run_config import load_run
from sparse_coord_ros.core.scenario import load_scenario
from sparse_coord_ros.core.simulation import learn, tables_equal
from sparse_coord_ros.core.tables import load_team

BAD_SCENARIOS = [
    ("map: env1\nrobots: {r: {start: 1\nsteps: 3\n", ["f.yaml, line 3", "not YAML"]),
    ("map: env1\nrobots: {}\n", ["f.yaml", "no robot", "e.g. robot_1"]),
    ("map: env1\nrobots: {r: {start: [0, 2], goal: 1}}\n", ["robot r: start [0, 2] is a wall"]),
    ("map: env1\nrobots: {r: {start: 1, goal: [9, 9]}}\n", ["robot r: goal [9, 9] is outside"]),
    ("map: env3\nrobots: {r: {start: 1, goal: 2}}\n", ["map 'env3'", "did you mean 'env2'"]),
    ("map: m.txt\nrobots: {r: {start: 1, goal: 2}}\n", ["m.txt, line 4", "1 symbols"]),
    ("map: cut.txt\nrobots: {r: {start: 1, goal: 2}}\n", ["robot r", "cannot be reached"]),
    ("map: env1\nrobots: {r: {start: 1, goal: 2}}\nstep: 3\n", ["field 'step'", "'steps'"]),
    ("map: env1\nrobots: {r: {start: 1, goal: 2}}\nsteps: 0\n", ["setting steps", "from 1 to"]),
]


@pytest.mark.parametrize("learner", ["coop", "noncoop", "indiv"])
def test_train(sparse_coord, folder, learner):
    arguments = ("--learner", learner, "--steps", 300, "--seed", 4, "--set", "max_steps=40")
    code, out, err = sparse_coord("train", "env1", *arguments, "--out", "runs/a")
    assert (code, err) == (0, "")
    assert out.split() == ["tables", "runs/a/tables.npz", "run", "runs/a/run.yaml"]
    directory = folder / "runs" / "a"
    assert sorted(path.name for path in directory.iterdir()) == ["run.yaml", "tables.npz"]
    run = load_run(directory)
    assert (run.learner, run.seed, run.scenario.steps, run.scenario.max_steps) == (
        learner,
        4,
        300,
        40,
    )
    scenario = load_scenario("env1").with_settings({"steps": 300, "max_steps": 40})
    assert run.scenario == scenario
    assert tables_equal(load_team(directory, scenario), learn(scenario, learner, 4))


def test_default_directory_is_named_after_the_scenario(sparse_coord, folder):
    code, out, _ = sparse_coord("train", "env1", "--steps", 5, "--json")
    (directory,) = (folder / "runs").iterdir()
    assert code == 0
    assert directory.name.startswith("env1_")
    expected = {"directory": f"runs/{directory.name}", "learner": "coop", "seed": 0}
    assert json.loads(out) == expected


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["env11"], ["scenario 'env11'", "did you mean 'env1'", "one of: cit"]),
        (["env1", "--set", "penalti=-5"], ["unknown setting 'penalti'", "did you mean 'penalty'"]),
        (["env1", "--set", "penalty"], ["'penalty'", "key=value"]),
        (["env1", "--set", "perception=range"], ["setting perception", "range:CELLS"]),
        (["env1", "--penalty", "5"], ["setting penalty: value is '5'", "at most 0"]),
        (["env1", "--steps", "0"], ["setting steps: value is '0'", "from 1 to"]),
        (["env1", "--steps", "many"], ["setting steps: value is 'many'", "whole number"]),
        (["env1", "--seed", "-1"], ["setting seed: value is '-1'", "from 0"]),
    ],
)
def test_bad_input(refused, arguments, words):
    message = refused("train", *arguments, "--out", "out")
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize(("text", "words"), BAD_SCENARIOS)
def test_bad_scenario_files(refused, folder, text, words):
    (folder / "f.yaml").write_text(text)
    (folder / "m.txt").write_text("title: m\n---\n1.2\n.\n")
    (folder / "cut.txt").write_text("---\n1#2\n")
    message = refused("train", "f.yaml", "--out", "out")
    assert [word for word in words if word not in message] == []


def test_the_largest_seed(sparse_coord, folder):
    seed = 2**63 - 1
    assert sparse_coord("train", "env1", "--steps", 5, "--seed", seed, "--out", "a")[0] == 0
    assert load_run(folder / "a").seed == seed


def test_existing_directory_is_not_touched(refused, folder):
    (folder / "out").mkdir()
    (folder / "out" / "tables.npz").write_text("precious")
    message = refused("train", "env1", "--steps", 5, "--out", "out")
    assert "output directory out: exists already, nothing is overwritten" in message


def test_output_below_a_file(refused, folder):
    (folder / "file").write_text("precious")
    assert "output directory file/out: cannot be created" in refused(
        "train", "env1", "--steps", 5, "--out", "file/out"
    )
