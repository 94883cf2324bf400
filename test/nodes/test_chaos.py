# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs over ROS 2 in which anything happens to any process: see tools/chaos.py."""

import subprocess
import sys
from pathlib import Path

import pytest

from tools.chaos import DELETE, KILL, LIE, NODES, STOP, VISIT, plan_of


def test_a_seed_draws_a_run():
    plans = [plan_of(seed) for seed in range(200)]
    assert plans == [plan_of(seed) for seed in range(200)]
    faults = [fault for plan in plans for fault in plan.faults]
    assert {fault.who for fault in faults} == {NODES, *((name,) for name in NODES)}
    assert {fault.what for fault in faults} == {KILL, STOP, DELETE, VISIT, LIE}
    assert {plan.returning for plan in plans} == {"rollback", "continue"}
    for plan in plans:  # the last fault comes before the run's end
        assert sum(fault.step for fault in plan.faults) < plan.steps


@pytest.mark.long
def test_fifty_runs(tmp_path):
    command = [sys.executable, "-m", "tools.chaos", "--runs", "50", "--keep", str(tmp_path)]
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=1700)
    assert done.returncode == 0, done.stdout + done.stderr
