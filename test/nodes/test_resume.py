# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Live teams that are interrupted and continue: the bits of an unbroken run."""

import json
import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.lockstep.node_checkpoints import CheckpointStore
from sparse_coord_ros.protocol.wire.status import Order, Progress
from sparse_coord_ros.ros.nodes import follower, world_simulator
from sparse_coord_ros.ros.nodes.restart import Returning
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
STEPS = 3000
"""Of a team that is killed twice."""


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
    again = {"resume": True, "out": str(out)}
    board = MessageBoard()
    with ros_context() as context:
        summary = run_team(again, context=context, page=board)
    assert_same_tables(out, said)
    asks = load_history(out).asks.sum(axis=0)
    shown = np.array(board.get("asked")["robots"]).sum(axis=1)
    assert shown.tolist() == asks.tolist(), "a page counts from the run's beginning"
    assert asks.min() > 20
    assert (summary["transitions"], summary["timeouts"]) == (600, 0)
    assert summary["taken_back"] == 1
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
    markers = observer.listen(MarkerArray, "markers", latched=True)
    maps = observer.listen(OccupancyGrid, "robot_1/coordination_map", latched=True)
    said = observer.listen(DiagnosticArray, "/diagnostics")
    bench.world(resume=True, scenario="", out=str(out))
    bench.robot("robot_1", resume=True, out=str(out))
    bench.spin_until(
        lambda: len({one.status[0].name for one in said}) == 2, "both report"
    )
    assert markers == maps == []


def test_what_was_dropped_before_is_counted_on(bench, tmp_path):
    observer = bench.observer()
    world = bench.world(out=str(tmp_path))
    world.subscriber.drop("a topic", "does not fit")
    pause = SetBool.Request(data=True)
    observer.call(SetBool, "world_simulator/pause", pause)  # it says how it stands
    bench.destroy(world)
    bench.spin_until(lambda: not observer.count("run"), "it is gone")
    again = bench.world(out=str(tmp_path), resume=True, scenario="")
    observer.call(SetBool, "world_simulator/pause", pause)
    again.subscriber.drop("a topic", "does not fit")
    assert again.summary()["messages_dropped"] == 2


def test_another_run_is_refused(tmp_path):
    out = tmp_path / "out"
    with ros_context() as context:
        run_team(
            values(out, record=False),
            context=context,
            stop=lambda: len(saved(out)) >= 3,
        )
        with pytest.raises(RunError, match="holds another run .*seed 7"):
            run_team(values(out, resume=True, seed=8), context=context)


class Returned:
    """The rollback of a team, with stand-ins for side, store and node.

    Attributes:
        team: takes the team back.
        ears: the callbacks for the nodes' progress, by their names.
        lines: the warnings.
        gone_on: whether the team continues.
    """

    def __init__(self, *, recorded=False, held=True, returning="rollback"):
        self.ears = {}
        self.lines = []
        self.gone_on = False
        self.counted = {}
        world = SimpleNamespace(step=40, transitions=38)
        side = SimpleNamespace(
            held=held, lost=0, finished=False, world=world, start=lambda: None
        )
        run = make_run(load_scenario("env1"), {"recorded": recorded})
        output = SimpleNamespace(
            store=CheckpointStore(), node=self, count=self.counted.update
        )
        self.subscriber = self
        self.values = {"returning": returning}
        self.timeout = run.step_timeout
        self.team = Returning(run, side, output, self.changed)

    def listen(self, topic, then, owner, *, read):
        self.ears[owner] = then

    def get_logger(self):
        return SimpleNamespace(warning=self.lines.append)

    def changed(self):
        self.gone_on = True


def test_the_team_goes_on_when_all_listen_and_the_recorder_has_obeyed():
    made = Returned(recorded=True)
    team = made.team
    team.order = Order("an order", 0, 1)
    team.look(0.0, all_listen=lambda: True)
    made.ears["recorder"](Progress("life", 0, 0, obeyed="an order"))
    team.look(0.0, all_listen=lambda: False)
    assert not made.gone_on
    team.look(0.0, all_listen=lambda: True)
    assert made.gone_on


@pytest.mark.parametrize(("its_step", "lost"), [(30, 10), (40, 0), (41, 0)])
def test_what_a_robot_has_lost_that_goes_on_alone_is_counted(its_step, lost):
    """It may have processed a state that the world, too, was about to count."""
    made = Returned(held=False, returning="continue")
    made.team.begin(0.0)
    made.ears["robot_2"](Progress("life 1", 0, 0))
    made.ears["robot_2"](Progress("life 2", its_step, its_step, resumed=True))
    assert made.counted["robot_steps_lost"] == lost
    [line] = made.lines
    assert f"up to step {its_step}: the team continues, {lost} time steps" in line


def test_the_team_goes_on_without_who_does_not_obey_in_time():
    made = Returned(recorded=True)
    team = made.team
    team.begin(100.0)
    team.order = Order("an order", 0, 1)
    team.waiting = {1}
    team.look(100.0 + made.timeout - 0.1, all_listen=lambda: True)
    assert not made.gone_on
    team.look(100.0 + made.timeout, all_listen=lambda: False)
    assert made.gone_on
    assert made.lines == ["robot_2 did not obey; continuing without them"]


@pytest.mark.long
@pytest.mark.parametrize("who", ["robot_2", "world_simulator"])
def test_who_goes_on_shows_nothing_of_the_time_before(bench, tmp_path, who):
    """It knows its checkpoint; the recorder ran all the time, and has later messages."""
    out = tmp_path / "out"
    alone = {"returning": "continue", "out": str(out)}
    world = bench.world(steps=90, checkpoint=20, recorded=True, rate=100.0, **alone)
    bench.recorder(out / "bag")
    robots = bench.robots(out=str(out))
    observer = bench.observer()
    bench.spin_until(lambda: world.lockstep.world.step > 50, "between two checkpoints")
    bench.destroy(world if who == "world_simulator" else robots[1])
    topic = "run" if who == "world_simulator" else f"{who}/action"
    bench.spin_until(lambda: not observer.count(topic), "it is gone")
    if who == "world_simulator":
        bench.world(scenario="", resume=True, **alone)
    else:
        bench.robot(who, resume=True, out=str(out))
    bench.spin_until_done()
    found = verify(out)
    assert found.undecided, found.first
    summary = yaml.safe_load((out / "summary.yaml").read_text())
    assert summary["transitions"] == 90
    missing = 90 - int(load_history(out).length.sum())
    assert (summary["taken_back"], summary["transitions_lost"]) == (0, missing)
    robot = who == "robot_2"
    assert (summary["robot_steps_lost"] > 0, missing > 0) == (robot, not robot)
    assert (summary["returned_robots"], summary["replaced_robots"]) == (robot, 0)


@pytest.mark.long
@pytest.mark.parametrize(
    "processes", [[], ["--processes"]], ids=["one process", "many"]
)
def test_kill_9_of_everything(start, tmp_path, processes, assert_same_tables, simulate):
    """Twice, then it ends with the bits of an unbroken run; a second resume at once is refused."""
    out = tmp_path / "out"
    settings = {"steps": STEPS, "perception": "probability:0.7"}
    sets = [
        text
        for name, value in settings.items()
        for text in ("--set", f"{name}={value}")
    ]
    run = [
        "run",
        "env1",
        "--seed",
        "7",
        "--checkpoint",
        "300",
        "--out",
        str(out),
        *sets,
    ]
    process = start("cli.main", *run, *processes)
    for k in range(2):
        known = saved(out)
        while len(saved(out) - known) < 3:
            assert process.running(), process.output
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGKILL)
        for pid in _of(out):
            os.kill(pid, signal.SIGKILL)
        process.exit_code()
        process = start("cli.main", "run", "--resume", str(out), "--json", *processes)
        if k:
            process.wait_for("", 1)
    assert process.exit_code() == 0, process.output
    said = simulate("env1", settings, seed=7)
    assert_same_tables(out, said)
    assert (
        json.loads(process.output[process.output.index("{") :])["transitions"] == STEPS
    )
    found = verify(out)
    # it may lack what is lost
    assert found.difference is None


def _of(out):
    """Return the processes that were started for a run."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            words = (path / "cmdline").read_bytes().decode().split("\0")
            if "sparse_coord_ros.executables" in words and any(
                str(out) in one for one in words
            ):
                yield int(path.name)
        except OSError:
            continue
