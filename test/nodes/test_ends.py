# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ends of nodes: exceptions, a closed terminal, a middleware that hangs."""

import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
import yaml
from patience import PATIENCE_SECONDS
from rcl_interfaces.msg import Log
from teams import tables_in

from sparse_coord_ros.base.errors import FaultError, NameTakenError, RunError
from sparse_coord_ros.core.game.settings import SettingTable
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.log.bags import open_bag
from sparse_coord_ros.ros.nodes import spin
from sparse_coord_ros.ros.nodes.parameters import ParameterNode
from sparse_coord_ros.ros.nodes.spin import ending, ros_context, run_node, signals
from sparse_coord_ros.ros.nodes.team import run_team


class Faulty(ParameterNode):
    """A node whose timer raises an unexpected error."""

    def __init__(self, context, error):
        super().__init__("faulty", SettingTable([]), context=context, values={})
        self.said = []
        self.create_timer(0.01, lambda: self._raise(error))

    def _raise(self, error):
        if self.count_subscribers("/rosout"):
            raise error

    def finish(self, *, interrupted):
        self.said.append(interrupted)


@pytest.mark.parametrize(
    ("error", "code", "text", "told"),
    [
        (
            KeyError("x"),
            1,
            "error: unexpected KeyError: 'x' (",
            "Traceback (most recent call",
        ),
        (
            RunError("no such thing"),
            2,
            "error: no such thing",
            "no such thing",
        ),
        (
            OSError(28, "No space left", "/a/b"),
            2,
            "error: /a/b: No space left; ",
            "/a/b: No",
        ),
    ],
)
def test_any_exception_saves_and_is_told(bench, capfd, error, code, text, told):
    """The error is one line, with an exit code, and on /rosout."""
    heard = bench.observer().listen(Log, "/rosout", latched=True)
    nodes = []

    def make(context):
        nodes.append(Faulty(context, error))
        return nodes[0]

    assert run_node(make, []) == code
    assert nodes[0].said == [True]
    line = capfd.readouterr().err.splitlines()[-1]
    assert line.startswith(text)
    bench.spin_until(
        lambda: any(m.msg.startswith(told) for m in heard), "/rosout tells it"
    )


def test_who_gives_way_to_another_node_of_its_name_saves_nothing():
    """Its run directory belongs to the other one."""
    done = []
    node = SimpleNamespace(failure=None, destroy_node=lambda: done.append("gone"))
    with pytest.raises(NameTakenError), ending([node], lambda: done.append("saved")):
        raise NameTakenError
    assert done == ["gone"]


def test_a_fault_of_one_robot_saves_the_tables_of_all(tmp_path, monkeypatch):
    learn = Agent.learn

    def fail_at_last(agent, step, *what):
        if agent.number == 1 and step > 20:
            raise ZeroDivisionError
        learn(agent, step, *what)

    monkeypatch.setattr(Agent, "learn", fail_at_last)
    out = tmp_path / "out"
    values = {"scenario": "env1", "out": str(out), "record": True}
    with (
        ros_context() as context,
        pytest.raises(FaultError, match="^unexpected ZeroDivisionErr"),
    ):
        run_team(values, context=context)
    assert len(tables_in(out)) == 2
    assert yaml.safe_load((out / "summary.yaml").read_text())["interrupted"] is True
    assert open_bag(out / "bag").finished


def test_a_closed_terminal_stops_a_node_but_not_one_under_nohup():
    with signals() as stop:
        os.kill(os.getpid(), signal.SIGHUP)
        assert stop.signal == signal.SIGHUP
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_node_that_cannot_be_taken_down_ends_with_a_word():
    code = f"import ctypes, {spin.__name__} as spin; spin.SHUTDOWN_SECONDS = 0.1\n"
    hangs = "ctypes.PyDLL(None).sleep(3600)"  # as rclpy does: nothing of Python runs meanwhile
    code += f"with spin.limited_shutdown(): {hangs}"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=PATIENCE_SECONDS,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("Timeout") and "in <module>" in done.stderr
