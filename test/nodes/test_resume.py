# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Live teams that are broken off and go on: the bits of an unbroken run."""

import json
import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from visualization_msgs.msg import MarkerArray

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.lockstep.node_checkpoints import CheckpointStore
from sparse_coord_ros.protocol.wire.status import (
    NO_ROLLBACK,
    Order,
    Progress,
    RunStatus,
    read_progress,
)
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.restart import Returning
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team

SEED = 7
SETTINGS = {"steps": 600, "perception": "probability:0.7"}
STEPS = 3000
"""Of a team that is killed twice."""
SETS = [f"{name}={value}" for name, value in SETTINGS.items()]


@pytest.fixture(scope="module")
def said(simulate):
    return simulate("env1", SETTINGS, seed=SEED)


def values(out, **more):
    base = {
        "scenario": "env1",
        "seed": SEED,
        "out": str(out),
        "set": SETS,
        "checkpoint": 150,
    }
    return {**base, "claim_window": 0.0, **more}


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
    again = {"resume": True, "out": str(out), "claim_window": 0.0}
    with ros_context() as context:
        summary = run_team(again, context=context)
    assert_same_tables(out, said)
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
    assert found.same, found.differences[:3]
    assert not saved(out)
    with ros_context() as context, pytest.raises(RunError, match="the run is finished"):
        run_team(again, context=context)


def test_who_comes_back_shows_nothing_before_it_knows_where_the_team_is(
    tmp_path, bench
):
    """What it shows would go into the bag of a recorder that was there all the time."""
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
    world = bench.world(resume=True, scenario="", out=str(out))
    robot = bench.robot("robot_1", resume=True, out=str(out))
    bench.spin_until(lambda: robot.member is not None, "the robot knows the run")

    def reported():
        world._report(1.0)
        robot.member.report()
        return len({one.status[0].name for one in said}) == 2

    bench.spin_until(reported, "both report")
    assert markers == maps == []


def test_what_was_dropped_before_is_counted_on(bench, tmp_path):
    observer = bench.observer()
    world = bench.world(out=str(tmp_path))
    bench.spin_until(lambda: world._output is not None, "it is open")
    bench.spin_until(
        lambda: observer.count("world_simulator/_claim"), "its name is known"
    )
    world.subscriber.drop("a topic", "does not fit")
    world._say()
    bench.destroy(world)
    bench.spin_until(
        lambda: not observer.count("world_simulator/_claim"), "its name is free"
    )
    again = bench.world(out=str(tmp_path), resume=True, scenario="")
    bench.spin_until(lambda: again._output is not None, "the other one is open")
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


def test_who_goes_back_listens_anew(bench, tmp_path):
    """What was under way to it is of the time that is taken back, under the same step numbers."""
    world = bench.world(rate=0.001, out=str(tmp_path))
    robots = bench.robots(out=str(tmp_path))
    bench.spin_until(lambda: world.lockstep.complete, "the first barrier")
    member = robots[0].member
    before = list(member._ears)
    member.world_said(RunStatus("", "", 0, 0, order=Order("an order", 0, 1)))
    member._on_state((1, 3))
    assert (member.joined, member.lockstep.newest[0]) == (False, 0)
    bench.spin_until(lambda: member.joined, "it listens again")
    assert not set(before) & set(member._ears)
    bench.spin_until(
        lambda: world.heard_by(world.topics.states[0], "robot_1"), "matched"
    )
    world.topics.state(0, 1, 3)
    bench.spin_until(lambda: member.lockstep.newest == (1, 3), "it hears the world")


def test_the_team_goes_on_when_all_listen_and_the_recorder_has_obeyed():
    gone_on = []
    logger = SimpleNamespace(warning=print)
    subscriber = SimpleNamespace(listen=lambda *what, **how: None)
    node = SimpleNamespace(subscriber=subscriber, get_logger=lambda: logger)
    side = SimpleNamespace(held=True, lost=0, start=lambda: None)
    run = make_run(load_scenario("env1"), {"recorded": True})
    team = Returning(
        run,
        side,
        SimpleNamespace(store=CheckpointStore(), node=node),
        lambda: gone_on.append(True),
    )
    team.order = Order("an order", 0, 1)
    team.look(0.0, all_listen=lambda: True)
    team._on_recorder(Progress("life", 0, 0, obeyed="an order"))
    team.look(0.0, all_listen=lambda: False)
    assert not gone_on
    team.look(0.0, all_listen=lambda: True)
    assert gone_on


def test_a_recorder_has_obeyed_when_it_finds_the_robots(bench, tmp_path):
    """Else what a robot says first misses a log that begins there, and `verify` says so."""
    bench.world(recorded=True)
    recorder = bench.recorder(tmp_path / "bag")
    bench.spin_until(lambda: recorder.recording is not None, "it has begun")
    observer = bench.observer()
    told = observer.listen(ros_topics.PROGRESS.type, "recorder/_progress", latched=True)
    recorder.recording.world_said(
        RunStatus("", "", 0, 0, order=Order("an order", NO_ROLLBACK, 1))
    )
    for robot in ("robot_1", "robot_2"):
        recorder.recording.go_on(time.monotonic())
        assert recorder.recording._untold
        action = ros_topics.ACTION
        observer.create_publisher(action.type, action.of(robot), action.qos)
    bench.spin_until(lambda: told, "it says so")
    assert read_progress(told[0]).obeyed == "an order"


@pytest.mark.long
@pytest.mark.parametrize("who", ["robot_2", "world_simulator"])
def test_who_goes_on_shows_nothing_of_the_time_before(bench, tmp_path, who):
    """It knows its checkpoint; the recorder was there all the time, and wrote later things."""
    out = tmp_path / "out"
    alone = {"returning": "continue", "out": str(out)}
    world = bench.world(
        set=["steps=90"], checkpoint=20, recorded=True, rate=100.0, **alone
    )
    bench.recorder(out / "bag")
    robots = bench.robots(out=str(out))
    observer = bench.observer()
    bench.spin_until(lambda: world.lockstep.world.step > 50, "between two checkpoints")
    bench.destroy(world if who == "world_simulator" else robots[1])
    bench.spin_until(lambda: not observer.count(f"{who}/_claim"), "its name is free")
    if who == "world_simulator":
        bench.world(scenario="", resume=True, **alone)
    else:
        bench.robot(who, resume=True, out=str(out))
    bench.spin_until_done()
    found = verify(out)
    assert found.cannot_tell, found.differences
    assert found.broke_off[0].startswith(("robot_2", "the world"))
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
    assert {one.quantity for one in found.differences} <= {
        "recording"
    }  # it may lack what is lost


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


@pytest.mark.parametrize(("its_step", "lost"), [(30, 10), (40, 0), (41, 0)])
def test_what_a_robot_has_lost_that_goes_on_alone_is_counted(its_step, lost):
    """It may have worked off a state that the world, too, was about to count."""
    lines = []
    counted = {}
    subscriber = SimpleNamespace(listen=lambda *what, **how: None)
    node = SimpleNamespace(
        subscriber=subscriber,
        values={"returning": "continue"},
        get_logger=lambda: SimpleNamespace(warning=lines.append),
    )
    world = SimpleNamespace(step=40, transitions=38)
    side = SimpleNamespace(held=False, finished=False, world=world)
    output = SimpleNamespace(store=CheckpointStore(), node=node, count=counted.update)
    team = Returning(make_run(load_scenario("env1"), {}), side, output, lambda: None)
    team.begin(0.0)
    team._on_progress(1, Progress("life 1", 0, 0))
    team._on_progress(1, Progress("life 2", its_step, its_step, resumed=True))
    assert counted["robot_steps_lost"] == lost
    assert (
        f"until step {its_step}: the team goes on, {lost} time steps of robot_2 are"
        in lines[0]
    )


def test_the_team_goes_on_without_who_does_not_obey_in_time():
    lines = []
    gone_on = []
    subscriber = SimpleNamespace(listen=lambda *what, **how: None)
    logger = SimpleNamespace(warning=lines.append)
    node = SimpleNamespace(subscriber=subscriber, get_logger=lambda: logger)
    side = SimpleNamespace(held=True, lost=0, start=lambda: None)
    run = make_run(load_scenario("env1"), {"recorded": True})
    output = SimpleNamespace(store=CheckpointStore(), node=node)
    team = Returning(run, side, output, lambda: gone_on.append(True))
    team.begin(100.0)
    team.order = Order("an order", 0, 1)
    team.waiting = {1}
    team.look(100.0 + run.step_timeout - 0.1, all_listen=lambda: True)
    assert not gone_on
    team.look(100.0 + run.step_timeout, all_listen=lambda: False)
    assert gone_on
    assert lines == ["robot_2 did not obey; going on without"]
