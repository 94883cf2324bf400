# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord run` around its nodes: one team a domain, a world that all robots have left."""

from types import SimpleNamespace

import pytest

from sparse_coord_ros.cli import live
from sparse_coord_ros.errors import RunError


def test_of_two_teams_in_a_domain_one_is_refused(monkeypatch):
    with live.sole_team():
        with pytest.raises(RunError, match=r"^ROS domain \d+: another process runs a team in it"):
            live.sole_team()
        monkeypatch.setenv("ROS_DOMAIN_ID", "101")
        with live.sole_team():
            pass
    with live.sole_team():
        pass


def test_a_world_that_all_robots_have_left_is_ended(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(live, "ALONE_SECONDS", 0.0)
    ended = []
    monkeypatch.setattr(live, "_end", ended.extend)
    left, there = (SimpleNamespace(poll=lambda code=code: code) for code in (0, None))
    processes = {"world_simulator": there, "robot_1": left, "robot_2": left}
    assert live._wait(processes, tmp_path / "bag", False)
    assert ended == list(processes.values())
    assert "all robots have left" in capsys.readouterr().err
