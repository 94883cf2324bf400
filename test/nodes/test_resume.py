# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Live teams that are interrupted and continue: the bits of an unbroken run."""

import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from visualization_msgs.msg import MarkerArray

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.lockstep.node_checkpoints import CheckpointStore
from sparse_coord_ros.protocol.wire.status import NO_ATTEMPT, Progress
from sparse_coord_ros.ros.nodes import follower, world_simulator
from sparse_coord_ros.ros.nodes.restart import Restart
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team
from sparse_coord_ros.show.page.message_board import MessageBoard

SEED = 7
SETTINGS = {
    "steps": 600,
    "perception": "probability:0.7",
    "ask_cost": 0,
    "epsilon": "constant:0.5",
}


@pytest.fixture(scope="module")
def said(simulate):
    return simulate("env1", SETTINGS, seed=SEED)


def values(out, **more):
    base = {
        "scenario": "env1",
        "seed": SEED,
        "out": str(out),
        **SETTINGS,
        "checkpoint": 150,
    }
    return {**base, **more}


def saved(out):
    folder = Path(out) / "checkpoint"
    return (
        {path.name for path in folder.glob("*_[0-9]*.npz")}
        if folder.exists()
        else set()
    )


def test_a_team_that_was_stopped_goes_on_from_its_last_step(
    tmp_path, said, assert_same_tables
):
    out = tmp_path / "out"
    with ros_context() as context:
        stop = lambda: len(saved(out)) >= 3  # noqa: E731
        first = run_team(values(out), context=context, stop=stop)
    assert first["interrupted"]
    steps = [
        {int(name[:-4].rpartition("_")[2]) for name in saved(out) if n in name}
        for n in "12w"
    ]
    assert max(set.intersection(*steps)) == max(set.union(*steps)), (
        "all ended at one step"
    )
    again = {"out": str(out)}
    board = MessageBoard()
    with ros_context() as context:
        summary = run_team(again, context=context, page=board)
    assert_same_tables(out, said)
    asks = load_history(out).asks.sum(axis=0)
    shown = np.array(board.get("asked")["robots"]).sum(axis=1)
    assert shown.tolist() == asks.tolist(), "a page counts from the run's beginning"
    assert asks.min() > 20
    assert (summary["transitions"], summary["timeouts"]) == (600, 0)
    made = summary["steps_per_second"] * summary["seconds"]
    assert made == pytest.approx(600 - first["transitions"], abs=2), (
        "not those before it"
    )
    assert sorted(path.name for path in (out / "bag").iterdir()) == [
        "bag_0.mcap",
        "bag_1.mcap",
        "metadata.yaml",
    ]
    found = verify(out)
    assert found.same, found.first
    assert not saved(out)
    with ros_context() as context, pytest.raises(RunError, match="the run is finished"):
        run_team(again, context=context)


def test_who_comes_back_shows_nothing_before_it_knows_where_the_team_is(
    tmp_path, bench, monkeypatch
):
    """Its display messages would go into the bag of a recorder that has run all the time."""
    for module in (follower, world_simulator):
        monkeypatch.setattr(module, "REPORT_SECONDS", 0.1)
    out = tmp_path / "out"
    with ros_context() as context:
        run_team(
            values(out, record=False),
            context=context,
            stop=lambda: len(saved(out)) >= 3,
        )
    observer = bench.observer()
    scenes = observer.listen(MarkerArray, "world_simulator/scene", latched=True)
    maps = observer.listen(OccupancyGrid, "robot_1/coordination_map", latched=True)
    said = observer.listen(DiagnosticArray, "/diagnostics")
    bench.world(scenario="", out=str(out))
    bench.robot("robot_1", out=str(out))
    bench.spin_until(
        lambda: len({one.status[0].name for one in said}) == 2, "both report"
    )
    assert scenes == maps == []


def test_a_slow_team_has_checkpoints_by_time(tmp_path, bench, monkeypatch):
    """All nodes save at the same steps, and the bits are the same."""
    monkeypatch.setattr(world_simulator, "CHECKPOINT_SECONDS", 0.2)
    monkeypatch.setattr(world_simulator, "AHEAD_SECONDS", 0.05)
    out = tmp_path / "out"
    slow = {"steps": 60, "rate": 60.0, "checkpoint": 1000}
    world = bench.world(out=str(out), **slow)
    bench.robots(out=str(out))
    bench.spin_until(lambda: len(saved(out)) >= 6, "two checkpoints of all three")
    steps = Counter(int(name[:-4].rpartition("_")[2]) for name in saved(out))
    assert sorted(steps.values())[-2:] == [3, 3]
    bench.spin_until_done()
    assert world.lockstep.timeouts == 0


def test_another_run_is_refused(tmp_path):
    out = tmp_path / "out"
    with ros_context() as context:
        run_team(
            values(out, record=False),
            context=context,
            stop=lambda: len(saved(out)) >= 3,
        )
        with pytest.raises(RunError, match="holds another run .*seed 7"):
            run_team(values(out, seed=8), context=context)


class Under:
    """The world's orders to begin, with stand-ins for side and node.

    Attributes:
        ears: the callbacks for the nodes' progress, by their names.
        lines: the warnings.
        gone_on: whether the team continues.
    """

    def __init__(self):
        self.ears = {}
        self.lines = []
        self.gone_on = False
        side = SimpleNamespace(
            held=False,
            finished=False,
            world=SimpleNamespace(transitions=39),
            go_on_from=lambda state: setattr(side, "held", True),
            start=lambda: setattr(side, "held", False),
        )
        run = make_run(load_scenario("env1"), {"recorded": True})
        self.timeout = run.step_timeout
        self.subscriber = self
        output = SimpleNamespace(store=CheckpointStore(), node=self)
        self.restart = Restart(run, side, output, lambda: None)
        self.side = side
        for node in self.ears:
            self.says(node, NO_ATTEMPT)
        assert self.restart.begin_when_complete() == [*self.ears]
        for node in self.ears:
            self.says(node)
        assert self.restart.begin_when_complete() == []

    def listen(self, topic, then, owner, *, read):
        self.ears[owner] = then

    def get_logger(self):
        return SimpleNamespace(warning=self.lines.append)

    def says(self, node, attempt=None):
        """Let a node say the attempt that it has begun; by default the last one."""
        last = self.restart.order.attempt
        self.ears[node](Progress((0,), last if attempt is None else attempt))

    def look(self, now=0.0, *, listen=True):
        self.restart.look(now, all_listen=lambda: listen)
        return not self.side.held


def test_the_team_goes_on_when_all_have_begun_again_and_listen():
    made = Under()
    first = made.restart.order
    made.says("robot_2", NO_ATTEMPT)
    assert made.restart.order.attempt != first.attempt
    assert made.lines == [
        "robot_2 came back at step 39: the run begins anew, as there is no later checkpoint of "
        "all nodes"
    ]
    for node in ("robot_1", "recorder"):
        made.says(node)
        assert not made.look()
    made.says("robot_2")
    assert not made.look(listen=False)
    assert made.look()


def test_the_team_goes_on_without_who_does_not_begin_in_time():
    made = Under()
    made.says("robot_2", NO_ATTEMPT)
    for node in ("robot_1", "recorder"):
        made.says(node)
    since = time.monotonic()
    assert not made.look(since + made.timeout - 1.0)
    assert made.look(since + made.timeout, listen=False)
    assert made.lines[1:] == ["robot_2 did not begin again; continuing without"]
