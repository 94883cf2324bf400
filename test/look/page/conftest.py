# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs, made without middleware, for the page's sources."""

import importlib.util
from pathlib import Path

import pytest

from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.run_config import make_run

ROOT = Path(__file__).parents[3]
_spec = importlib.util.spec_from_file_location("recordings", ROOT / "test/runlog/conftest.py")
_recordings = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_recordings)


@pytest.fixture(scope="session")
def recordings():
    """Return the module that makes bags of whole runs."""
    return _recordings


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Return a function that records a run in which robots often ask, and returns its bag."""

    def record(name="env1", steps=600, seed=7, **options):
        settings = {"steps": steps, "perception": "probability:0.6", **_recordings.OFTEN}
        run = make_run(
            load_scenario(str(name)).with_settings(settings), {"seed": seed, "checkpoint": 200}
        )
        bag = tmp_path_factory.mktemp("watched") / "bag"
        _recordings.Recording(bag, run, **options)
        return bag

    return record


@pytest.fixture(scope="session")
def bag(recorded):
    """Return the bag of a run of env1, a third of whose percepts fail; not to be changed."""
    return recorded()
