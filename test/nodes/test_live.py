# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord run` around its nodes: one team a domain, a world that all robots have left."""

import os
import signal
import subprocess

import pytest
import yaml

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
    # whatever else runs here
    monkeypatch.setattr(os, "getuid", lambda: f"test_{os.getpid()}")
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


class Started:
    """Stands for a process of a team.

    Args:
        ends: whether it has ended by itself.
    """

    def __init__(self, *, ends):
        self.returncode = 0 if ends else None
        self.signals = []

    def poll(self):
        return self.returncode

    def send_signal(self, number):
        self.signals.append(number)
        self.returncode = 0

    def wait(self, seconds):
        return self.returncode


@pytest.fixture
def started(monkeypatch, tmp_path):
    """Return a function that runs a team without a recorder, none of whose processes is real."""

    def run(stop, **ends):
        made = {}

        def start(command, **options):
            name = command[-1].removeprefix("__node:=")
            made[name] = Started(ends=ends[name])
            return made[name]

        monkeypatch.setattr(subprocess, "Popen", start)
        values = {"scenario": "env1", "out": str(tmp_path / "out"), "record": False}
        return live.run(values, processes=True, stop=stop), made

    return run


def test_a_world_that_all_robots_have_left_is_ended(started, monkeypatch, capsys):
    monkeypatch.setattr(live, "ALONE_SECONDS", 0.0)
    summary, made = started(Stop(), world_simulator=False, robot_1=True, robot_2=True)
    assert summary["interrupted"]
    assert made["world_simulator"].signals == [signal.SIGINT]
    assert made["robot_1"].signals == []
    assert "all robots are gone" in capsys.readouterr().err


@pytest.mark.parametrize("signalled", [False, True])
def test_a_signal_that_all_processes_heard_is_an_interrupt(started, signalled):
    """They may have ended by themselves before the check."""
    stop = Stop()
    if signalled:
        stop.handle(signal.SIGINT, None)
    summary, _ = started(stop, world_simulator=True, robot_1=True, robot_2=True)
    assert summary["interrupted"] is signalled


def test_the_summary_says_the_result_and_how_to_repeat_it(start, tmp_path):
    out = tmp_path / "out"
    words = ["env1", "--steps", "300", "--seed", "7", "--no-record", "--out", str(out)]
    process = start("cli.main", "run", *words)
    assert process.exit_code() == 0, process.output
    summary = yaml.safe_load((out / "summary.yaml").read_text())
    assert summary["repeat"] == (
        "sparse_coord train env1 --learner coop --seed 7 --set steps=300"
    )
    assert list(summary)[:2] == ["result", "verdict"]
    result = summary["result"]
    assert result["source"] == "exact" and "returns_error" not in result
    assert list(result)[-3:] == ["shortest_paths", "best_asking_team", "optimum"]
    assert summary["result"]["optimum"] == pytest.approx(120.56, abs=0.01)
