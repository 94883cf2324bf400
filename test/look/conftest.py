# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One small run, learned without ROS and with its log, for every picture."""

import importlib.util
from pathlib import Path

import pytest

from sparse_coord_ros.engine.training import train
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.run_config import make_run

ROOT = Path(__file__).parents[2]
FIXTURES = ROOT / "test/fixtures/0.1.0"

_spec = importlib.util.spec_from_file_location("recordings", ROOT / "test/runlog/conftest.py")
_recordings = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_recordings)

ASKING = {"epsilon": "constant:0.3", "perception": "probability:0.7", "steps": 900}
"""Settings with which robots ask often, and are answered or refused."""


@pytest.fixture(scope="session")
def bag(tmp_path_factory):
    """Return the bag of a run of env1 with many questions, some refused."""
    directory = tmp_path_factory.mktemp("shown") / "talk" / "bag"
    directory.parent.mkdir()
    run = make_run(load_scenario("env1").with_settings(ASKING), {"seed": 3, "checkpoint": 100})
    _recordings.Recording(directory, run)
    return directory


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """Return the directory of a run that `train` made: tables and history, no bag."""
    directory = tmp_path_factory.mktemp("shown") / "trained"
    scenario = load_scenario("env1").with_settings({"steps": 3000, "penalty": -100})
    train(scenario, "coop", 1, engine="python").save(directory)
    return directory
