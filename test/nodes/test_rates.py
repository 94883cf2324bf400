# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameter `rate`: so many time steps a second."""

import random
import time

import pytest

from sparse_coord_ros.ros.nodes import world_simulator

RATES = [
    7,
    15,
    31,
    60,
    0.001,
    0.3,
    1e6,
    *(random.Random(1).uniform(0.1, 2000) for _ in range(33)),
]


def test_forty_rates_have_timers_of_their_period_which_stay(bench):
    """A timer that is made anew with each tick never fires."""
    world = bench.world()
    for rate in RATES:
        world.values["rate"] = rate
        world.keep_the_rate()
        timer = world.rate_timer
        world.keep_the_rate()
        assert world.rate_timer is timer
        assert timer.timer_period_ns == pytest.approx(1e9 / rate, rel=0.01)


def steps_a_second(bench, world, rate, steps):
    """Return how fast a team makes some transitions."""
    world.values["rate"] = rate
    begin = world.lockstep.world.transitions
    bench.spin_until(lambda: world.lockstep.world.transitions > begin)
    first = world.lockstep.world.transitions
    since = time.monotonic()
    bench.spin_until(lambda: world.lockstep.world.transitions >= first + steps)
    return (world.lockstep.world.transitions - first) / (time.monotonic() - since)


def test_a_team_makes_as_many_steps_a_second_as_wanted(bench):
    world = bench.world(rate=15.0)
    bench.robots()
    assert steps_a_second(bench, world, 15.0, 12) == pytest.approx(15, rel=0.1)


@pytest.mark.long
def test_ten_rates_one_after_the_other(bench):
    """Also those that are set while the team is under way."""
    world = bench.world(rate=15.0)
    bench.robots()
    for rate in (7, 15, 31, 60, 12.5, 3, 100, 41, 23, 77):
        made = steps_a_second(bench, world, float(rate), 2 * rate)
        assert made == pytest.approx(rate, rel=0.1)


def test_a_rate_that_cannot_be_kept_is_named(bench, monkeypatch, capfd):
    monkeypatch.setattr(world_simulator, "PROGRESS_SECONDS", 0.3)
    monkeypatch.setattr(world_simulator, "REPORT_SECONDS", 0.1)
    bench.world(rate=1e6)
    bench.robots()
    bench.spin_until(lambda: "rate 1e+06 cannot be kept: " in capfd.readouterr().err)


def test_a_robot_that_is_gone_is_named_and_not_the_rate(bench, monkeypatch, capfd):
    monkeypatch.setattr(world_simulator, "PROGRESS_SECONDS", 0.8)
    monkeypatch.setattr(world_simulator, "REPORT_SECONDS", 0.1)
    monkeypatch.setattr(world_simulator, "CLEARLY_LESS", 0.3)
    world = bench.world(rate=20.0, step_timeout=1.5)
    robot, _ = bench.robots()
    bench.spin_until(lambda: world.lockstep.world.transitions > 10)
    capfd.readouterr()
    bench.destroy(robot)
    said = []

    def gone():
        said.append(capfd.readouterr().err)
        return "robot_1 gone or silent" in "".join(said)

    bench.spin_until(gone)
    assert "cannot be kept" not in "".join(said)
