# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord run` around its nodes: one team a domain, a world that all robots have left."""

import os
import signal
from types import SimpleNamespace

import pytest

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.cli import live
from sparse_coord_ros.ros.nodes.environment import DOMAIN, ros_domain
from sparse_coord_ros.ros.nodes.spin import Stop


def test_of_two_teams_in_a_domain_one_is_refused(monkeypatch):
    with live.sole_team():
        with pytest.raises(
            RunError, match=r"^ROS domain \d+: another process runs a team in it"
        ):
            live.sole_team()
        monkeypatch.setenv("ROS_DOMAIN_ID", "101")
        with live.sole_team():
            pass
    with live.sole_team():
        pass


@pytest.mark.parametrize("value", [None, "", " ", "0", " 0 "])
def test_an_empty_domain_is_domain_0(monkeypatch, value):
    """ROS takes it so: two teams, one with "" and one with "0", would enter the same domain."""
    monkeypatch.setenv(DOMAIN, value or "")
    if value is None:
        monkeypatch.delenv(DOMAIN)
    assert ros_domain() == 0
    monkeypatch.setattr(
        os, "getuid", lambda: f"test_{os.getpid()}"
    )  # whatever else runs here
    with live.sole_team():
        monkeypatch.setenv(DOMAIN, "0")
        with pytest.raises(
            RunError, match="^ROS domain 0: another process runs a team in it"
        ):
            live.sole_team()


@pytest.mark.parametrize(
    "value", ["233", "-1", "x", "010", "0x1", "1.0", "\u0661", "7 7"]
)
def test_a_domain_that_dds_has_not_is_refused(monkeypatch, value):
    monkeypatch.setenv(DOMAIN, value)
    with pytest.raises(
        RunError, match=f"^{DOMAIN} is .*, allowed: a whole number from 0 to 232"
    ):
        live.sole_team()


def test_a_world_that_all_robots_have_left_is_ended(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(live, "ALONE_SECONDS", 0.0)
    ended = []
    monkeypatch.setattr(live, "_end", ended.extend)
    left, there = (SimpleNamespace(poll=lambda code=code: code) for code in (0, None))
    processes = {"world_simulator": there, "robot_1": left, "robot_2": left}
    assert live._wait(processes, tmp_path / "bag", False)
    assert ended == list(processes.values())
    assert "all robots have left" in capsys.readouterr().err


def test_a_signal_that_all_processes_heard_is_an_interrupt(tmp_path):
    """They may have ended by themselves before anybody looks."""
    ended = {
        name: SimpleNamespace(poll=lambda: 0) for name in ("world_simulator", "robot_1")
    }
    stop = Stop()
    assert live._wait(ended, tmp_path, stop) is False
    stop.handle(signal.SIGINT, None)
    assert live._wait(ended, tmp_path, stop) is True
