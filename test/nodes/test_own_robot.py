# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot of examples/own_robot.py in a team with ours."""

import runpy
from pathlib import Path

from sparse_coord_ros.log.runlog.verify import verify

OWN_ROBOT = Path(__file__).parents[2] / "examples" / "own_robot.py"
NAME = ["--ros-args", "-r", "__node:=robot_1"]


def test_a_run_with_a_robot_of_ones_own(bench, tmp_path):
    """World, peer and recorder accept it; verify checks everything that the log contains."""
    kind = runpy.run_path(str(OWN_ROBOT))["OwnRobot"]
    world = bench.world(steps=150, out=str(tmp_path), recorded=True)
    recorder = bench.recorder(tmp_path / "bag")
    peer = bench.robot("robot_2")
    own = bench.add(kind(context=bench.place()[0], cli_args=NAME))
    bench.spin_until_done(world, peer)
    assert own.over and own.transitions == 150
    assert world.lockstep.timeouts == world.lockstep.stale == 0
    for node in (world, peer, own):
        bench.destroy(node)
    bench.spin_until_done(recorder)
    found = verify(tmp_path / "bag")
    assert found.undecided and found.steps == 150
    assert found.undecided.why.startswith("robot_1 publishes no tables")
