# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An argument of a wrong kind is one line that names it, its value, and what is allowed."""

import time

import pytest
from patience import PATIENCE_SECONDS

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import RunError, SparseCoordError


def test_a_path_within_a_file_that_no_system_has(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text('name: a\nmap: "a\\0b"\nrobots: []\n')
    with pytest.raises(SparseCoordError, match="^(?!unexpected)"):
        sc.load_scenario(file)


@pytest.mark.parametrize("threads", ["0", "-2"])
def test_numba_without_threads(python, threads):
    """On the command line; in Python the same error is raised."""
    pytest.importorskip("numba")
    done = python(
        *("-m", "sparse_coord_ros.executables", "sparse_coord", "reproduce", "table1"),
        *("--engine", "numba", "--runs", "1", "--out", "none"),
        env={"NUMBA_NUM_THREADS": threads},
        code=2,
    )
    line = f"error: NUMBA_NUM_THREADS: value is '{threads}', allowed: a whole number from 1\n"
    assert done.stderr.endswith(line)


def test_a_scheduler_that_is_not_there_is_told_at_once(monkeypatch):
    pytest.importorskip("distributed")
    cluster = pytest.importorskip("sparse_coord_ros.core.engine.cluster")
    monkeypatch.setattr(cluster, "WAIT_SECONDS", 2 * PATIENCE_SECONDS)
    began = time.monotonic()
    with pytest.raises(RunError, match="scheduler tcp://127.0.0.1:1"):
        sc.train_many("env1", runs=1, scheduler="tcp://127.0.0.1:1")
    assert time.monotonic() - began < PATIENCE_SECONDS, "a worker would be waited for"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: sc.train("env1", steps=100),
            "train has no argument 'steps'; a setting is given with the scenario: "
            "load_scenario(..., steps=100)",
        ),
        (
            lambda: sc.train_many("env1", penalty=-5),
            "train_many has no argument 'penalty'; a setting is given with the scenario: "
            "load_scenario(..., penalty=-5)",
        ),
        (
            lambda: sc.train("env1", seeds=[1, 2]),
            "train has no argument 'seeds'; many runs are made by train_many",
        ),
        (lambda: sc.plot([sc.Runs()]), "results: value is [<Runs of 0>], allowed: "),
        (lambda: sc.plot([]), "results: value is [], allowed: results of sweep or"),
        (
            lambda: sc.Runs().plot(),
            "the runs have no learning history; give train_many",
        ),
        (lambda: sc.to_pandas(sc.Runs()), "(of train_many, draw runs.plot(), and use"),
    ],
)
def test_settings_and_runs_in_a_wrong_place_have_a_remedy(call, words):
    with pytest.raises(SparseCoordError) as caught:
        call()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
