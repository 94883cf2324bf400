# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two small runs for all that shows runs; not to be changed."""

import pytest

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.scenario import load_scenario


@pytest.fixture(scope="session")
def bag(record):
    """Return the bag of a run of env1 with many questions, some of them refused."""
    settings = {"steps": 600, "perception": "probability:0.6"}
    return record(settings=settings, values={"checkpoint": 200}).bag


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """Return the directory of a run that `train` made: tables and history, no bag."""
    directory = tmp_path_factory.mktemp("shown") / "trained"
    scenario = load_scenario("env1").with_settings({"steps": 3000, "penalty": -100})
    train(scenario, "coop", 1, engine="python").save(directory)
    return directory


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """Return a directory of results: two conditions, two runs each."""
    directory = tmp_path_factory.mktemp("shown") / "results"
    conditions = [
        f"env1/{learner}/penalty=-20,steps=300" for learner in ("coop", "noncoop")
    ]
    few = ("--runs", "2", "--trials", "2", "--engine", "python", "--jobs", "1")
    assert main(["reproduce", *conditions, "--out", str(directory), *few]) == 0
    return directory
