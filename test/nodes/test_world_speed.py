# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed of a world and its waiting, measured with the test's own clock."""

from types import SimpleNamespace

from sparse_coord_ros.ros.nodes.world_speed import WorldSpeed


def test_speed_is_that_of_this_process_and_since_the_last_report():
    world = SimpleNamespace(transitions=100)
    speed = WorldSpeed(world, 0.0)
    assert speed.report(1.0)[1] is False, "the run has not begun"
    assert speed.summary() == {"seconds": 0.0, "steps_per_second": 0.0}
    speed.begin(2.0)
    world.transitions = 140
    rate, made = speed.report(4.0)
    assert (round(rate, 3), made) == (20.0, True)
    assert speed.report(5.0) == (0.0, False)
    world.transitions = 130  # the team went back to a checkpoint
    assert speed.report(6.0) == (0.0, True)
    speed.end(12.0)
    assert speed.summary() == {"seconds": 10.0, "steps_per_second": 3.0}
