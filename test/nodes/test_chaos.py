# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs over ROS 2 with any fault in any process: see chaos.py."""

import subprocess
import sys

import chaos
import pytest
import yaml
from chaos import KILL, NODES, STOP, every_kind, plan_of
from live_teams import odd_counts

from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.lockstep.robot_side import ASKS
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team


def test_a_seed_draws_a_run():
    plans = [plan_of(seed) for seed in range(200)]
    assert plans == [plan_of(seed) for seed in range(200)]
    faults = [fault for plan in plans for fault in plan.faults]
    assert {fault.who for fault in faults} == {NODES, *((name,) for name in NODES)}
    assert {fault.what for fault in faults} == {KILL, STOP}
    for plan in plans:  # the last fault comes before the run's end
        assert sum(fault.step for fault in plan.faults) < plan.steps


def test_counts_that_contradict_one_another_are_named(tmp_path):
    out = tmp_path / "out"
    values = {
        "scenario": "env1",
        "out": str(out),
        "steps": 120,
    }
    with ros_context() as context:
        run_team({**values, "record": True}, context=context)
    found = verify(out)
    assert odd_counts(out, found) == []
    path = out / "summary.yaml"
    right = yaml.safe_load(path.read_text())
    for change, named in (
        (
            {"miscoordinations": 99},
            ["miscoordinations, and those", "miscoordinations, in summ"],
        ),
        (
            {"asks": {"robot_1": dict.fromkeys(ASKS, 99)}},
            ["how often robot_1 asked, and history"],
        ),
    ):
        path.write_text(yaml.safe_dump({**right, **change}))
        odd = odd_counts(out, found)
        assert [
            one[: len(words)] for one, words in zip(odd, named, strict=True)
        ] == named


@pytest.mark.long
def test_every_kind_of_fault(tmp_path):
    seeds = map(str, every_kind(50))
    command = [sys.executable, chaos.__file__, "--keep", str(tmp_path), "--seeds"]
    done = subprocess.run([*command, *seeds], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
