# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each setting of a driver does what its help says, whatever legal value it has."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.lab.driving.body_simulator import BodySimulator, Noise
from sparse_coord_ros.lab.driving.cmd_vel_driver import CmdVelDriver
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.trials import DRIVE_SETTINGS, limits_of
from sparse_coord_ros.protocol.lockstep.bodies import BodyGoal, Goals

RUN = make_run(load_scenario("env1"), {})
CELLS = RUN.scenario.map.number
START, END = CELLS[0, 0], CELLS[1, 0]


def driven(most=4000, **values):
    """Drive a body one cell to the south; return its map, commands, report and last pose."""
    values = DRIVE_SETTINGS.defaults() | values
    metric_map = MetricMap(RUN, values["radius"])
    simulator = BodySimulator(metric_map, 1, 1, Noise(0.0, 0.0))
    body = simulator.bodies[0]
    body.put(*metric_map.place(0, START))
    commands = []
    limits = limits_of(values, metric_map.side)
    driver = CmdVelDriver(metric_map, limits, 0, commands.append)
    driver.take(Goals(1, 5, False, -9.0, (BodyGoal(0, START, END),)))
    for _ in range(most):
        driver.sees(simulator.seconds, body.pose)
        report = driver.next(0.0)
        if report is not None:
            return metric_map, commands, report, body.pose
        body.command = commands[-1]
        simulator.tick()
    raise AssertionError("it never reports")


def radius(value):
    metric_map, *_ = driven(radius=value)
    assert metric_map.radius == value


def speed(value):
    _, commands, report, _ = driven(speed=value, step_seconds=100.0)
    assert report.there
    assert 0.8 * value < max(command.ahead for command in commands) <= value


def turn(value):
    _, commands, report, _ = driven(turn=value, step_seconds=100.0)
    assert report.there
    assert max(abs(command.turn) for command in commands) == pytest.approx(value)


def near(value):
    metric_map, _, report, pose = driven(near=value, speed=0.2, step_seconds=100.0)
    missing = math.dist(pose[:2], metric_map.place(0, END))
    a_tick = 0.2 * 0.1
    assert report.there and value - a_tick - 1e-6 <= missing <= value


def step_seconds(value):
    *_, report, _ = driven(step_seconds=value, speed=0.01)
    assert not report.there
    assert abs(report.seconds - value) < 0.2


LEGAL = {
    radius: st.floats(0.05, 0.4),
    speed: st.floats(0.05, 1),
    turn: st.floats(0.2, 5),
    near: st.floats(0.03, 0.4),
    step_seconds: st.floats(1, 20),
}
"""For each setting, by the function that checks its effect, some of its legal values."""


def test_no_setting_is_forgotten():
    """`slips` is the world's: test_driving.py."""
    assert {effect.__name__ for effect in LEGAL} == {*DRIVE_SETTINGS} - {"slips"}


@pytest.mark.parametrize("effect", LEGAL, ids=lambda effect: effect.__name__)
@settings(max_examples=5)
@given(data=st.data())
def test_a_setting_does_what_its_help_says(effect, data):
    effect(data.draw(LEGAL[effect]))
