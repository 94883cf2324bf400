# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Teams whose moves are goals of a stand-in for Nav2, over the real action.

The types of nav2_msgs are built first where there is a compiler, which takes two minutes; the
variable SPARSE_COORD_TYPES names a folder in which `python -m tools.ros_types` has built them.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

from sparse_coord_ros.nodes.body import BodyNode
from sparse_coord_ros.nodes.driver import DriverNode
from sparse_coord_ros.nodes.outputs import gather
from sparse_coord_ros.runlog.verify import verify
from tools import ros_types

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

ROBOTS = ("robot_1", "robot_2")
STEP_SECONDS = 8.0


@pytest.fixture(scope="module")
def types(tmp_path_factory):
    """Return the folder with the types, which this process has loaded."""
    given = os.environ.get("SPARSE_COORD_TYPES")
    prefix = Path(given) if given else tmp_path_factory.mktemp("types")
    try:
        ros_types.build(prefix)
    except OSError as error:
        pytest.skip(f"the types of nav2_msgs cannot be built here: {error}")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in ros_types.environment(prefix).items():
            patch.setenv(name, value)
        patch.setattr(sys, "path", [*sys.path])
        ros_types.load(prefix)
        yield prefix


@pytest.fixture
def start_team(types, bench, tmp_path):
    """Return a function that starts a team with its drivers; and the servers, if asked for."""
    from nav2_server import FakeNav2

    from sparse_coord_ros.nodes.nav2_driver import Nav2DriverNode

    def start(
        names=ROBOTS,
        *,
        steps=4000,
        served=True,
        driven=None,
        scenario="env1",
        recorder=False,
        **driver,
    ):
        out = tmp_path / "out"
        server = None
        if served:
            server = FakeNav2(names, context=bench.place("nav2")[0])
            bench.add(server, "nav2")
        given = {"scenario": scenario, "set": [f"steps={steps}"], "out": str(out), "seed": 7}
        if recorder:
            given["recorded"] = True
        world = bench.world(bodies=True, step_timeout=60.0, **given)
        bench.robots(len(names), out=str(out))
        if recorder:
            bench.recorder(out / "bag")
        context = bench.place()[0]
        drivers = [
            bench.add(
                Nav2DriverNode(
                    context=context,
                    name=f"{name}_driver",
                    values={"robot": name, "step_seconds": STEP_SECONDS, **driver},
                )
            )
            for name in (names if driven is None else driven)
        ]
        return world, drivers, server

    return start


def moved(world, count):
    """Whether so many steps were made."""
    return lambda: world.lockstep.world.transitions >= count


@pytest.mark.parametrize(
    ("scenario", "names", "steps"),
    [("env1", ROBOTS, 40), ("env2-4r", tuple(f"robot_{k}" for k in (1, 2, 3, 4)), 20)],
)
def test_a_team_that_nav2_drives_learns_what_the_grid_teaches(
    start_team, bench, tmp_path, simulate, assert_same_tables, scenario, names, steps
):
    world, drivers, server = start_team(names, steps=steps, scenario=scenario, recorder=True)
    bench.spin_until_done()
    out = tmp_path / "out"
    gather(out, world.run.scenario, interrupted=False)
    assert_same_tables(out, simulate(scenario, {"steps": steps}, seed=7))
    summary = world.summary()
    assert (summary["moves_failed"], summary["bodies_lost"]) == (0, 0)
    assert verify(out / "bag").same
    assert not server.driving
    for driver in drivers:
        assert driver.navigator.counts["arrived"] > 0
        assert set(driver.navigator.counts) == {"arrived"}


@pytest.mark.parametrize(
    ("fate", "kind", "stays"),
    [
        ("abort", "aborted", True),
        ("lie", "not there", True),
        ("detour", "detours", True),
        ("silent", "silent", True),
        ("stuck", "out of time", True),
        ("take away", "aborted", True),
        ("reject", "rejected", False),
        ("late", "late acceptances", False),
        ("deaf", "unanswered", False),
    ],
)
def test_each_fault_of_the_server_is_said_and_nothing_hangs_or_drives_on(
    start_team, bench, capfd, fate, kind, stays
):
    world, drivers, server = start_team()
    bench.spin_until(moved(world, 2), "under way", seconds=60)
    robot, driver = server.robots["robot_1"], drivers[0]
    robot.fates += [fate]
    before = world.summary()["moves_failed"]
    bench.spin_until(lambda: not robot.fates, f"a goal to {fate}", seconds=60)
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 3), "the world goes on", seconds=60)
    bench.spin_until(lambda: driver.navigator.counts[kind] >= 1, kind, seconds=20)
    assert (world.summary()["moves_failed"] > before) == stays
    if fate == "late":
        assert "accepted a goal too late: it is cancelled" in capfd.readouterr().err
    bench.spin_until(lambda: all([one.settled() for one in drivers]), "both stand", seconds=5)
    assert not server.driving


def test_a_killed_server_and_one_that_comes_back(start_team, bench, tmp_path):
    def serve():
        program = Path(__file__).parents[1] / "nav2_server.py"
        process = subprocess.Popen(
            [sys.executable, program, *ROBOTS],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        assert process.stdout.readline() == "serving\n"
        return process

    process = serve()
    try:
        world, drivers, _ = start_team(served=False)
        bench.spin_until(moved(world, 2), "under way", seconds=60)
        process.send_signal(signal.SIGKILL)
        process.wait()
        bench.spin_until(
            lambda: any(one.navigator.counts["poses lost"] for one in drivers), "lost", seconds=30
        )
        process = serve()
        made = world.lockstep.world.transitions
        bench.spin_until(moved(world, made + 3), "it goes on", seconds=60)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_a_killed_driver_s_goal_ends_when_it_is_started_again(start_team, start_node, bench):
    def drive():
        return start_node(
            *("nav2_driver", "robot_1_driver"), robot="robot_1", step_seconds=STEP_SECONDS
        )

    process = drive()
    world, _, server = start_team(driven=ROBOTS[1:])
    bench.spin_until(moved(world, 2), "under way", seconds=60)
    robot = server.robots["robot_1"]
    robot.fates += ["stuck"]
    bench.spin_until(lambda: robot.fate == "stuck" and robot.active, "stuck", seconds=60)
    before = len(robot.ended)
    process.send_signal(signal.SIGKILL)
    process.exit_code()
    assert robot.active is not None
    process = drive()
    bench.spin_until(lambda: robot.ended[before:] == ["canceled"], "it is cancelled", seconds=20)
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 3), "it goes on", seconds=60)
    robot.fates += ["stuck"]
    bench.spin_until(lambda: robot.fate == "stuck" and robot.active, "stuck", seconds=60)
    process.send_signal(signal.SIGTERM)
    bench.spin_until(lambda: not process.running(), "it ends", seconds=10)
    assert process.exit_code() == 0 and robot.active is None


def test_deactivated_it_cancels_and_activated_it_goes_on(start_team, bench):
    world, drivers, server = start_team()
    bench.spin_until(moved(world, 2), "under way", seconds=60)
    observer = bench.observer()

    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return observer.call(ChangeState, "robot_1_driver/change_state", request).success

    robot = server.robots["robot_1"]
    robot.fates += ["stuck"]
    bench.spin_until(lambda: robot.fate == "stuck" and robot.active, "stuck", seconds=60)
    assert change(Transition.TRANSITION_DEACTIVATE)
    bench.spin_until(lambda: robot.active is None, "cancelled", seconds=5)
    assert not change(Transition.TRANSITION_DEACTIVATE)  # and the node lives
    begin, goals = time.monotonic(), robot.goals
    bench.spin_until(lambda: time.monotonic() > begin + 0.5, "a while")
    assert robot.goals == goals
    assert change(Transition.TRANSITION_ACTIVATE)
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 3), "it goes on", seconds=60)


def test_lost_poses_cancel_and_a_lifted_robot_is_lost_and_found(start_team, bench):
    world, drivers, server = start_team(pose_timeout=0.3)
    bench.spin_until(moved(world, 2), "under way", seconds=60)
    robot = server.robots["robot_1"]
    robot.lost = True
    bench.spin_until(lambda: drivers[0].navigator.counts["poses lost"] >= 1, "blind", seconds=60)
    bench.spin_until(lambda: robot.active is None, "cancelled", seconds=5)
    robot.place, robot.lost = (50.0, 50.0), False
    robot.fates += ["detour"] * 2
    bench.spin_until(lambda: world.summary()["bodies_lost"] >= 1, "lost", seconds=60)
    robot.place, robot.fates = (0.5, 0.5), []
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 5), "found", seconds=60)


def test_with_transforms_for_poses_the_same_bits(
    types, bench, tmp_path, simulate, assert_same_tables
):
    from tf2_msgs.msg import TFMessage

    out, place = tmp_path / "out", {"context": bench.place()[0], "namespace": "fleet"}
    given = {"set": ["steps=8"], "out": str(out), "seed": 7, "namespace": "fleet"}
    world = bench.world(bodies=True, **given)
    bench.robots(out=str(out), namespace="fleet")
    for name in ROBOTS:
        values = {"robot": name, "pose_type": "tf", "speed": 2.0, "turn": 6.0}
        bench.add(DriverNode(name=f"{name}_driver", values=values, **place))
    bench.add(BodyNode(values={}, **place))
    transforms = bench.observer().listen(TFMessage, "/tf")
    bench.spin_until_done()
    gather(out, world.run.scenario, interrupted=False)
    assert_same_tables(out, simulate("env1", {"steps": 8}, seed=7))
    assert world.summary()["moves_failed"] == 0
    links = {(t.header.frame_id, t.child_frame_id) for one in transforms for t in one.transforms}
    assert ("map", "fleet/robot_1/odom") in links
    assert ("fleet/robot_1/odom", "fleet/robot_1/base_link") in links and len(links) == 4
