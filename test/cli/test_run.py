# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord run`: bad input, refused before any node starts."""

import sys

import pytest


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["env11"], ["scenario 'env11'", "did you mean 'env1'"]),
        (["env1", "--set", "penalti=-5"], ["unknown setting 'penalti'", "did you mean 'penalty'"]),
        (["env1", "--penalty", "5"], ["setting penalty: value is '5'", "from -1e+09 to 0"]),
        (["env1", "--steps", "0"], ["setting steps: value is '0'", "from 1 to"]),
        (["env1", "--seed", "-1"], ["setting seed: value is '-1'", "from 0"]),
        (["env1", "--rate", "fast"], ["rate: value is 'fast'", "a number"]),
        (["env1", "--greedy"], ["--greedy needs --tables DIR"]),
    ],
)
@pytest.mark.parametrize("processes", [[], ["--processes"]])
def test_bad_input(refused, arguments, words, processes):
    message = refused("run", *arguments, *processes, "--out", "out")
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize("processes", [[], ["--processes"]])
def test_existing_directory_is_not_touched(refused, folder, processes):
    (folder / "out").mkdir()
    (folder / "out" / "tables.npz").write_text("precious")
    message = refused("run", "env1", "--steps", 5, "--out", "out", *processes)
    assert "output directory out: exists already, nothing is overwritten" in message


def test_without_ros_it_says_what_to_do(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    message = refused("run", "env1", "--out", "out")
    for words in ("ROS 2 is not there", "source a ROS 2 Jazzy", "'.[ros]'", "sparse_coord train"):
        assert words in message


def test_a_run_whose_tables_could_not_be_saved_is_not_said_to_be_unfinished(
    sparse_coord, folder, monkeypatch
):
    def run(values, **more):
        (folder / "out" / "checkpoint").mkdir(parents=True)
        return {"interrupted": False, "transitions": 5}

    monkeypatch.setattr("sparse_coord_ros.cli.live.run", run)
    code, printed, error = sparse_coord("run", "env1", "--steps", 5, "--out", "out")
    assert code == 2
    assert "not finished" not in printed and "tables.npz" not in printed
    assert error == (
        "error: out: not all tables could be saved there (see above); make room, then: "
        "sparse_coord run --resume out\n"
    )
