# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`run.yaml` and output directories: nothing lost, nothing overwritten, bad ones refused."""

from dataclasses import replace

import pytest
import yaml

from sparse_coord_ros.base.errors import (
    RunError,
    ScenarioError,
    SettingError,
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
        "step_period": 0.05,
        "resolution": 0.25,
        "step_timeout": 7,
        "percept_timeout": 1 / 3,
        "recorded": "yes",
    }
    return make_run(scenario, values)


def refusal(text, error):
    with pytest.raises(error) as refused:
        run_from_yaml(text, where="d/run.yaml")
    assert "d/run.yaml" in str(refused.value) or error is SettingError
    assert "\n" not in str(refused.value)
    return str(refused.value)


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


def test_missing_and_unknown_fields(run):
    assert "unknown field 'colour'" in refusal(spoiled(run, colour="red"), RunError)
    assert "unknown field 1" in refusal(spoiled(run) + "1: 2\n", RunError)
    assert "did you mean 'learner'?" in refusal(spoiled(run, lerner="coop"), RunError)
    assert "field 'versions' is missing" in refusal(
        spoiled(run, versions=None), RunError
    )
    read = run_from_yaml(spoiled(run, checkpoint=None, recorded=None), where="here")
    assert (read.checkpoint, read.recorded) == (10_000, False)


def test_formats_of_run_yaml(run):
    assert "format: 2" in run.to_yaml()
    for other in (None, 0, 1, 3, "two", True):
        said = f"is in format {other!r}, this version reads format 2; "
        remedy = "update sparse_coord_ros" if other == 3 else "make it anew"
        assert said + remedy in refusal(spoiled(run, format=other), RunError)


def test_the_digest_of_a_run(run):
    same = run.digest
    assert replace(run, step_timeout=9.0, recorded=True, versions={}).digest == same
    assert replace(run, scenario=replace(run.scenario, paper={})).digest == same
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


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("scenario: [\n", ScenarioError, "line 2"),
        ("", ScenarioError, "'key: value'"),
        ("just text", ScenarioError, "is str"),
        ("format: 2\nseed: 1\n", RunError, "scenario"),
    ],
)
def test_malformed_run_yaml(text, error, words):
    assert words in refusal(text, error)


def test_bad_values_in_run_yaml(run):
    assert "seed: value is -1" in refusal(spoiled(run, seed=-1), SettingError)
    assert "allowed: coop, noncoop, indiv" in refusal(
        spoiled(run, learner="best"), SettingError
    )
    assert "not a run.yaml" in refusal(spoiled(run, scenario="env1"), RunError)
    scenario = {**run.scenario.to_dict(), "penalty": 20.0}
    assert "(scenario): setting penalty" in refusal(
        spoiled(run, scenario=scenario), ScenarioError
    )


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"seed": "-1"}, "setting seed: value is '-1', allowed: a whole number from 0"),
        ({"seed": "1.5"}, "setting seed"),
        ({"learner": "indi"}, "did you mean 'indiv'?"),
        ({"sed": 1}, "unknown setting 'sed' (did you mean 'seed'?)"),
        ({"step_period": 0}, "from 0.001 to 60"),
        (
            {"percept_timeout": 5},
            "percept_timeout: value is 5, allowed: less than step_timeout (5)",
        ),
        (
            {"step_timeout": 1},
            "percept_timeout: value is 2, allowed: less than step_timeout (1)",
        ),
    ],
)
def test_bad_run_settings(values, words):
    with pytest.raises(SettingError) as error:
        make_run(load_scenario("env1"), values)
    assert words in str(error.value)


def test_defaults():
    run = make_run(load_scenario("env1"), {})
    due = RUN_SETTINGS.defaults() | {
        "resolution": 1.0
    }  # 0: that of the map, which has none
    assert {name: getattr(run, name) for name in RUN_SETTINGS} == due


def test_output_that_cannot_be_a_directory(tmp_path):
    (tmp_path / "file").write_text("precious")
    for out, error in (("file", SparseCoordError), ("file/below", NotADirectoryError)):
        with pytest.raises(error, match=str(tmp_path / out)):
            create_output(tmp_path / out)
    assert (tmp_path / "file").read_text() == "precious"
