# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of waiting and timeouts, over ROS 2."""

import pytest

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.ros.nodes.robot import RobotNode

SET = {"steps": 100_000, "perception": "always"}


@pytest.fixture
def team(bench):
    """Return a function that starts a world and two robots; they are under way then."""

    def started(robot=None, **values):
        world = bench.world(**SET, **values)
        robots = bench.robots(**(robot or {}))
        bench.spin_until(
            lambda: world.lockstep.world.transitions > 20, "the team is under way"
        )
        return world, *robots

    return started


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"lost_robot": "end"}, r"lost_robot: step \d+: robot_2 gone or silent"),
        (
            {"lost_robot": "wait"},
            r"step \d+: the world has waited for 1 s for robot_2",
        ),
    ],
)
def test_a_world_ends_without_a_robot_as_it_is_told(bench, team, values, said):
    world, _, robot = team(**values)
    world.lost_timeout = 1.0
    bench.destroy(robot)
    with pytest.raises(RunError, match=said):
        bench.spin_until(lambda: world.done, "the world ends")
    assert world.lockstep.timeouts == 0


def test_a_world_goes_on_without_a_robot(bench, team):
    world, _, robot = team(lost_robot="go_on", step_timeout=10.0)
    bench.destroy(robot)
    then = world.lockstep.world.transitions + 50
    bench.spin_until(lambda: world.lockstep.world.transitions > then, "it goes on")
    assert world.lockstep.timeouts == 1


def test_a_robot_waits_for_its_world_for_a_time(bench, team, tmp_path, monkeypatch):
    out = tmp_path / "out"
    monkeypatch.setattr(RobotNode, "world_timeout", 1.0)
    world, *_ = nodes = team({"out": str(out)}, out=str(out))
    bench.destroy(world)
    bench.spin_until(lambda: all(one.done for one in nodes[1:]), "the robots leave")
    assert (out / "tables_robot_1.npz").exists()
