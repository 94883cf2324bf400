# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make bench`: its tables."""

from types import SimpleNamespace

import pytest

from tools.bench import batch, environments
from tools.bench.__main__ import main


def test_batch_beside_plain_python():
    rates = {(batch.ENGINE, 2): [4.0, 6.0], (batch.PYTHON, 1): [0.1]}
    lines = batch.table("env1, Coop.", 0.25, rates).splitlines()
    assert lines[2].split()[3:] == ["threads", "5.00", "4.00", "to", "6.00", "25"]
    assert lines[-2].split()[-1] == "1"
    assert lines[-1].startswith("engine: ready in 0.2 s")


def test_environments_beside_each_other():
    rates = {"PettingZoo": [0.1, 0.3, 0.2], "in_observation, 9 games": [4.0]}
    lines = environments.table("env1", rates).splitlines()
    assert lines[2].split() == ["PettingZoo", "0.200", "0.100", "to", "0.300"]
    assert lines[3].split()[-4:] == ["4.000", "4.000", "to", "4.000"]


def test_only_whole_steps_of_robots_count(monkeypatch):
    """One second a call of ten games of two robots; a half step is no step."""
    clock = SimpleNamespace(perf_counter=iter(range(1000)).__next__)
    monkeypatch.setattr(environments, "time", clock)
    env = environments.VectorGame("env1", 10, asking="in_observation")
    assert environments.vector_rate(env, 5) == pytest.approx(20e-6)
    halves = environments.VectorGame("env1", 10)
    assert 5e-6 < environments.vector_rate(halves, 50) < 17e-6


@pytest.mark.long
def test_all_of_it(capfd):
    pytest.importorskip("rclpy")
    pytest.importorskip("pettingzoo")
    assert main(["--steps", "100", "--runs", "20", "--repeats", "1"]) == 0
    tables = 2 + len(batch.MEASURED) + len(environments.MEASURED)
    assert capfd.readouterr().out.count("range") == tables
