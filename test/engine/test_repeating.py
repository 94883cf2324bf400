# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command that `info` names computes the run again."""

import shlex
from dataclasses import replace

import pytest

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.repeating import repeating_command
from sparse_coord_ros.core.runs.run_config import load_run, make_run

FEW = {"steps": 20, "penalty": -100, "perception": "probability:0.6"}


@pytest.mark.parametrize("learner", ["coop", "voi"])
def test_the_command_makes_the_same_run(learner, tmp_path):
    scenario = load_scenario("env1").with_settings(FEW)
    run = make_run(scenario, {"seed": 7, "learner": learner})
    words = shlex.split(repeating_command(run))
    assert main([*words[1:], "--trials", "0", "--out", str(tmp_path / "again")]) == 0
    assert load_run(tmp_path / "again").digest == run.digest


def test_a_scenario_of_a_file_is_named_as_the_file():
    scenario = load_scenario("env1")
    run = make_run(replace(scenario, robots=scenario.robots[::-1]), {})
    assert repeating_command(run).startswith("sparse_coord train env1.yaml --learner")


def test_a_greedy_run_is_one_of_nodes():
    scenario = load_scenario("env1").with_settings({"steps": 20})
    run = make_run(scenario, {"greedy": True, "tables": "runs/a"})
    assert repeating_command(run) == (
        "sparse_coord run env1 --learner coop --seed 0 --tables runs/a --greedy --set steps=20"
    )


def test_real_bodies_cannot_be_repeated():
    assert repeating_command(make_run(load_scenario("env1"), {"bodies": True})) is None
