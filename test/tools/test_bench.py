# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make bench`: its tables, and what it says where something is missing."""

import json

import pytest

from sparse_coord_ros.engine import batch as engine
from tools.bench import batch
from tools.bench.__main__ import main
from tools.c_loop import loop


def test_batch_beside_the_c_loop():
    rates = [
        {"way": batch.ENGINE, "threads": 2, "agent_steps_per_second": [4e6, 6e6]},
        {"way": batch.C_LOOP, "threads": 2, "agent_steps_per_second": [10e6]},
        {"way": batch.PYTHON, "threads": 1, "agent_steps_per_second": [1e5]},
    ]
    found = {"title": "env1, Coop.", "steps": 9, "runs": 2, "rates": rates}
    lines = batch.table({**found, "ready_seconds": 0.25, "missing": []}).splitlines()
    assert (
        lines[2].split()[3:] == ["2", "threads", "5.00", "4.00", "to", "6.00", "2.50", "50%"][1:]
    )
    assert lines[-2].split()[-1] == "-"
    assert lines[-1].startswith("engine: ready in 0.2 s")


def test_without_numba_and_a_compiler(monkeypatch):
    monkeypatch.setattr(engine, "has_numba", lambda: False)
    monkeypatch.setattr(loop, "COMPILER", "no_such_compiler")
    found = batch.measure_here("env1", "coop", steps=100, runs=1, repeats=1)
    numba, compiler = found["missing"]
    assert "numba" in numba and "there is no C compiler (no_such_compiler)" in compiler
    assert [one["way"] for one in found["rates"]] == [batch.PYTHON]


@pytest.mark.long
def test_all_of_it(capsys):
    pytest.importorskip("rclpy")
    assert main(["--steps", "100", "--runs", "2", "--repeats", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found) == 2 + len(batch.MEASURED)
    assert all(rates[0] > 0 for rates in found["live"].values())
