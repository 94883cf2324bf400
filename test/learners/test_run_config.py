# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`run.yaml` and output directories: nothing lost, nothing overwritten, bad ones refused."""

from dataclasses import replace

import pytest
import yaml

from sparse_coord_ros.base.errors import (
    ScenarioError,
    SparseCoordError,
)
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import (
    RUN_SETTINGS,
    create_output,
    make_run,
    run_from_yaml,
)


@pytest.fixture
def run():
    """Return a run none of whose settings is a default."""
    scenario = load_scenario("env1").with_settings(
        {"perception": "probability:0.123456789"}
    )
    values = {
        "seed": str(2**63 - 1),
        "learner": "noncoop",
        "greedy": True,
        "step_timeout": 7,
        "recorded": "yes",
    }
    return make_run(scenario, values)


def test_round_trip(run):
    assert run.seed == 2**63 - 1
    assert run_from_yaml(run.to_yaml(), where="text") == run


def test_versions_say_what_computed_it(run):
    assert set(run.versions) >= {
        "sparse_coord_ros",
        "numpy",
        "python",
        "mcap",
        "PyYAML",
    }


def spoiled(run, **changes):
    """Return the run's text with fields changed; None removes one."""
    data = {**yaml.safe_load(run.to_yaml()), **changes}
    return yaml.safe_dump(
        {key: value for key, value in data.items() if value is not None}
    )


def test_fields_that_later_versions_added_have_their_defaults(run):
    read = run_from_yaml(spoiled(run, checkpoint=None, recorded=None), where="here")
    assert (read.checkpoint, read.recorded) == (10_000, False)


def test_a_bad_setting_of_its_scenario_is_named(run):
    scenario = {**run.scenario.to_dict(), "penalty": 20.0}
    with pytest.raises(ScenarioError, match="run.yaml .scenario.: setting penalty"):
        run_from_yaml(spoiled(run, scenario=scenario), where="run.yaml")


def test_the_digest_of_a_run(run):
    same = run.digest
    assert replace(run, step_timeout=9.0, recorded=True, versions={}).digest == same
    assert replace(run, seed=run.seed + 1).digest != same
    assert replace(run, learner="indiv").digest != same
    driven = replace(run, bodies=True)
    assert replace(driven, slips=False).digest != driven.digest != same
    assert replace(run, slips=False).digest == same, (
        "without bodies nothing depends on it"
    )
    assert (
        replace(run, scenario=run.scenario.with_settings({"penalty": -3})).digest
        != same
    )


def test_defaults():
    run = make_run(load_scenario("env1"), {})
    assert {
        name: getattr(run, name) for name in RUN_SETTINGS
    } == RUN_SETTINGS.defaults()
    assert (run.resolution, run.percept_timeout) == (1.0, 2.0)


def test_output_that_cannot_be_a_directory(tmp_path):
    (tmp_path / "file").write_text("precious")
    for out, error in (("file", SparseCoordError), ("file/below", NotADirectoryError)):
        with pytest.raises(error, match=str(tmp_path / out)):
            create_output(tmp_path / out)
    assert (tmp_path / "file").read_text() == "precious"
