# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A learner and a perception model of the user's own, in one file, in every verb."""

import json
from contextlib import chdir

import numpy as np
import pytest
import yaml
from teams import forgotten, memories_equal

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.runs.saved_tables import load_saved

MODULE = """
import numpy as np
import sparse_coord_ros as sc

coop_learn = sc.Coop.learn

class Eager(sc.Coop):
    def weights(self, scenario):
        return sc.RewardWeights(1, len(scenario.robots), 1)

    @staticmethod
    def learn(mind, task, k, now, after):
        coop_learn(mind, task, k, now, after)
        coop_learn(mind, task, k, now, after)

class Broken(sc.Coop):
    @staticmethod
    def learn(mind, task, k, now, after):
        raise KeyError("step")

@sc.perception_model
def fog(grid, p):
    return np.full((len(grid.cells),) * 2, p)
"""

SETTINGS = ("--steps", "200", "--seed", "4", "--set", "perception=my_code:fog:0.5")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a folder with the user's module."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "my_code.py").write_text(MODULE)
    return folder


@pytest.fixture(scope="module")
def verb(place, python):
    """Return a function that runs `sparse_coord ...` in that folder, in a process of its own."""

    def run(*arguments, code=0):
        # -P: the verbs have to find modules in the current directory by themselves.
        command = ("-P", "-m", "sparse_coord_ros.cli.main")
        done = python(*command, *arguments, cwd=place, code=code)
        return done.stdout if code == 0 else done.stderr

    return run


@pytest.fixture
def here(place, monkeypatch, capfd):
    """Return a function that does the same in this process."""
    monkeypatch.chdir(place)

    def run(*arguments, code=0):
        capfd.readouterr()
        assert main([str(argument) for argument in arguments]) == code
        said = capfd.readouterr()
        return said.out if code == 0 else said.err

    return run


LEARNER = "my_code:Eager"


@pytest.fixture(scope="module")
def runs(place):
    """Give the directories of runs: without ROS, and live; their learner is known meanwhile."""
    out = ["train", "live"]
    how = ("env1", "--learner", LEARNER, *SETTINGS, "--out")
    with forgotten():
        with chdir(place):
            plain = ("--engine", "python", "--trials", "0")
            assert main(["train", *how, out[0], *plain]) == 0
            assert main(["run", *how, out[1]]) == 0
        yield [place / directory for directory in out]


@pytest.mark.long
def test_each_node_in_its_own_process_learns_the_same(place, runs, verb):
    verb("run", "env1", "--learner", LEARNER, *SETTINGS, "--out", "far", "--processes")
    assert_equal([runs[0], place / "far"])


def test_all_ways_of_running_learn_the_same(runs):
    assert_equal(runs)


def assert_equal(runs):
    """Check that runs have learned the same, by the user's code."""
    saved = [load_saved(directory / "tables.npz", [1, 2]) for directory in runs]
    for team in saved[1:]:
        for one, other in zip(saved[0], team, strict=True):
            assert memories_equal(one.memory, other.memory)
    for directory in runs:
        said = yaml.safe_load((directory / "run.yaml").read_text())
        assert said["learner"] == LEARNER
        assert said["scenario"]["perception"] == "my_code:fog:0.5"


def test_it_is_evaluated_verified_and_explained(runs, here):
    trained, live = runs
    data = json.loads(here("evaluate", trained, "--trials", 3, "--json"))
    assert data["learner"] == LEARNER
    assert json.loads(here("verify", live, "--json"))["identical"] is True
    assert "robot_" in here("explain", live)


@pytest.mark.long
def test_reproduce_names_it_in_ids(place, verb):
    ids = [
        f"env1/{LEARNER}/penalty={penalty},perception=my_code:fog:0.5,steps=200"
        for penalty in (-20, -100)
    ]
    few = ("--runs", 2, "--trials", 3)
    found = [
        verb(
            "reproduce",
            *ids,
            *few,
            "--out",
            engine,
            "--engine",
            engine,
            "--json",
        )
        for engine in ("auto", "python")
    ]
    assert found[0].replace('"auto/', '"python/') == found[1]
    assert [one["id"] for one in json.loads(found[0])["conditions"]] == ids
    assert all((place / "auto/conditions" / f"{one}.json").is_file() for one in ids)
    again = verb("reproduce", *ids, *few, "--out", "auto", "--json")
    assert again == found[0]
    returns = json.loads(found[0])["conditions"][1]["returns"]
    assert np.isfinite(returns)


def test_where_it_fails_one_line_says_so(here, place):
    broken = ("--learner", "my_code:Broken", "--steps", 50)
    blame = "error: learner 'my_code:Broken' failed while learning: KeyError: "
    for arguments in (
        ("train", "env1", *broken, "--engine", "python", "--out", "broken"),
        ("run", "env1", *broken, "--out", "broken_live"),
        (
            "reproduce",
            "env1/my_code:Broken/penalty=-20",
            "--runs",
            2,
            "--engine",
            "python",
            "--out",
            "broken_r",
        ),
    ):
        error = here(*arguments, code=2)
        assert error.splitlines()[-1].startswith(blame), error
        assert "Traceback" not in error
    assert not (place / "broken").exists()
