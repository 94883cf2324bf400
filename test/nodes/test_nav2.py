# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Teams whose moves are goals of a stand-in for Nav2, over the real action.

The types of nav2_msgs are built first where there is a compiler, which takes two minutes; or the
variable SPARSE_COORD_TYPES names a folder in which `ros_types` has built them.
"""

import signal
import time
from collections import Counter
from pathlib import Path

import pytest
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from patience import PATIENCE_SECONDS
from std_srvs.srv import SetBool

from sparse_coord_ros.cli.main import main as sparse_coord
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.core.game.settings import parse_assignments
from sparse_coord_ros.lab.driving import nav2_driver as decisions
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.log.runlog.verify import verify
from sparse_coord_ros.ros.driving import nav2_driver, nav2_stand_in
from sparse_coord_ros.ros.driving.body import BodyNode
from sparse_coord_ros.ros.driving.driver import CmdVelDriverNode
from sparse_coord_ros.ros.driving.nav2_stand_in import SIMULATION_SECONDS
from sparse_coord_ros.ros.nodes.outputs import gather

from .faulty_nav2 import FaultyNav2

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

ROBOTS = ("robot_1", "robot_2")
NEVER = 0.0
PATIENT = {"step_seconds": PATIENCE_SECONDS, "pose_timeout": NEVER}
"""Limits of a driver that give up no move of a robot on a busy machine."""

SPEED = 20.0
AT_FIRST = "0.5,0.5"
"""Of the bases: metres a second, and their places."""


@pytest.fixture
def start_team(types, bench, tmp_path):
    """Return a function that starts a team with its drivers; and the servers, if requested."""

    def start(
        names=ROBOTS,
        *,
        steps=4000,
        served=True,
        driven=None,
        scenario="env1",
        recorder=False,
        world=None,
        **driver,
    ):
        out = tmp_path / "out"
        server = None
        if served:
            values = {
                "bases": list(names),
                "places": [AT_FIRST] * len(names),
                "speed": SPEED,
            }
            server = bench.add(
                FaultyNav2(context=bench.place("nav2")[0], values=values), "nav2"
            )
        given = {"scenario": scenario, "out": str(out), "seed": 7}
        given |= {"steps": steps, **(world or {})}
        if recorder:
            given["recorded"] = True
        made = bench.world(bodies=True, **given)
        bench.robots(len(names), out=str(out))
        if recorder:
            bench.recorder(out / "bag")
        driven = names if driven is None else driven
        return made, [make_driver(bench, name, **driver) for name in driven], server

    return start


def make_driver(bench, robot, **values):
    """Start the driver of a robot."""
    from sparse_coord_ros.ros.driving.nav2_driver import Nav2DriverNode

    values = {"robot": robot, **PATIENT, **values}
    context = bench.place()[0]
    return bench.add(
        Nav2DriverNode(context=context, name=f"{robot}_driver", values=values)
    )


@pytest.fixture
def late_answers(monkeypatch):
    """Let servers answer late, as they do on a busy machine."""
    for module in (decisions, nav2_driver):
        monkeypatch.setattr(module, "ANSWER_SECONDS", PATIENCE_SECONDS)


@pytest.fixture(autouse=True)
def busy_machine(monkeypatch):
    """Let poses and feedback come late, and no more often than one thread can take them in."""
    for name in ("SETTLE_SECONDS", "SILENCE_SECONDS"):
        monkeypatch.setattr(decisions, name, PATIENCE_SECONDS)
    monkeypatch.setattr(nav2_stand_in, "SIMULATION_SECONDS", 0.1)


def spin_for(bench, seconds):
    end = time.monotonic() + seconds
    bench.spin_until(
        lambda: time.monotonic() > end, "time passes", seconds=seconds + 60.0
    )


def moved(world, count):
    """Return whether so many steps were made."""
    return lambda: world.lockstep.world.transitions >= count


@pytest.mark.parametrize(
    ("scenario", "names", "steps"),
    [("env1", ROBOTS, 20), ("env2-4r", tuple(f"robot_{k}" for k in (1, 2, 3, 4)), 20)],
)
def test_a_team_that_nav2_drives_learns_what_the_grid_teaches(
    start_team,
    bench,
    tmp_path,
    simulate,
    assert_same_tables,
    late_answers,
    scenario,
    names,
    steps,
):
    world, drivers, server = start_team(
        names, steps=steps, scenario=scenario, recorder=True
    )
    bench.spin_until_done(but=server)
    out = tmp_path / "out"
    gather(out, world.run.scenario, interrupted=False)
    assert_same_tables(out, simulate(scenario, {"steps": steps}, seed=7))
    summary = world.summary()
    assert (summary["moves_failed"], summary["bodies_lost"]) == (0, 0)
    assert verify(out / "bag").same
    assert not server.driving
    for driver in drivers:
        assert driver.driver.counts["arrived"] > 0
        assert set(driver.driver.counts) == {"arrived"}


class Together:
    """Counts how often bodies come to be in one doorway at once, while they make moves."""

    def __init__(self, world, server):
        self.count = 0
        self._before = set()
        self._world = world
        self._server = server
        self._metric_map = MetricMap(world.run, 0.0)
        server.create_timer(nav2_stand_in.SIMULATION_SECONDS, self._look)

    def _look(self):
        doorways = self._world.run.scenario.map.doorways
        places = (base.pose[:2] for base in self._server.bases.values())
        within = Counter(self._metric_map.cell(*place) for place in places)
        now = {
            cell for cell, number in within.items() if number > 1 and cell in doorways
        }
        if not self._world.bodies.side.placing:
            self.count += len(now - self._before)
        self._before = now


@pytest.mark.parametrize(
    ("name", "training", "driving"),
    [("env1", ["penalty=-100", "steps=100000"], 100), ("office", [], 80)],
)
def test_what_was_learned_in_simulation_nav2_drives(
    start_team, bench, tmp_path, capfd, late_answers, name, training, driving
):
    scenario = name
    if name == "office":
        words = "--cell 0.5 --radius 0.2 --start -8,-5 -3,0.1 --goal 8,5 -8,-5".split()
        plan = Path(__file__).parents[2] / "examples" / "office.yaml"
        more = ["--set", "penalty=-100", "--out", str(tmp_path / "office")]
        assert sparse_coord(["import-map", str(plan), *words, *more]) == 0
        scenario = str(tmp_path / "office" / "office.yaml")
    learned = tmp_path / "learned"
    sets = [word for one in training for word in ("--set", one)]
    assert (
        sparse_coord(["train", scenario, *sets, "--seed", "1", "--out", str(learned)])
        == 0
    )
    settings = {**parse_assignments(training), "steps": driving, "starts": "fixed"}
    values = {"greedy": True, "tables": str(learned), **settings}
    world, drivers, server = start_team(scenario=scenario, recorder=True, world=values)
    together = Together(world, server)
    begun = time.monotonic()
    bench.spin_until(lambda: world.done, "the run's end", seconds=1500)
    seconds = time.monotonic() - begun
    bench.spin_until_done(but=server)
    game = world.lockstep.world
    at_once = together.count
    with capfd.disabled():
        counts = sum((driver.driver.counts for driver in drivers), Counter())
        print(
            f"\n{name}: {game.episode} episodes, {game.transitions} steps, {seconds:.0f} s; "
            f"{game.miscoordinations} steps end with both in a doorway, bodies were in one at "
            f"once {at_once} times; goals: {dict(counts)}"
        )
    found = verify(tmp_path / "out" / "bag")
    assert found.same
    history = world.lockstep.history.so_far
    assert history.arrived[:-1].all(), "whoever began an episode arrived"
    assert world.summary()["moves_failed"] == 0
    assert set(counts) == {"arrived"}
    assert game.miscoordinations <= at_once <= game.miscoordinations + 2


def test_learning_goes_on_in_steps_of_seconds_and_over_a_restart(
    start_team, bench, tmp_path, simulate, assert_same_tables, late_answers
):
    """Robots of unequal speed, without exploring; the world's deadlines are those of robots."""
    observer = bench.observer()
    steps = 6
    said = {"epsilon": "constant:0", "starts": "fixed"}
    step_timeout = 8.0
    values = {"step_timeout": step_timeout, "rate": 0.5}
    world, drivers, server = start_team(
        world={"steps": steps, **said, "checkpoint": 2, **values}
    )
    bench.spin_until(moved(world, 1), "under way")
    slow = server.bases["robot_1"]
    slow.speed = 0.1
    begun = time.monotonic()
    bench.spin_until(moved(world, 3), "slowly")
    assert time.monotonic() - begun > step_timeout
    slow.speed = 2.0
    bench.spin_until(moved(world, 4), "not as quickly as the other one")
    bench.destroy(world)
    bench.spin_until(lambda: not observer.count("run"), "it is gone")
    known = {"scenario": "", "out": str(tmp_path / "out"), "rate": 0.5}
    again = bench.world(bodies=True, **known)
    bench.spin_until(lambda: again.done, "the run's end")
    bench.spin_until_done(but=server)
    gather(tmp_path / "out", again.run.scenario, interrupted=False)
    assert_same_tables(
        tmp_path / "out", simulate("env1", {"steps": steps, **said}, seed=7)
    )
    summary = again.summary()
    assert (summary["timeouts"], summary["moves_failed"]) == (0, 0)


@pytest.mark.parametrize(
    ("fault", "kind", "stays", "limit"),
    [
        ("abort", "aborted", True, {}),
        ("lie", "not there", True, {}),
        ("detour", "detours", True, {}),
        ("silent", "silent", True, {}),
        ("stuck", "out of time", True, {"step_seconds": 8.0}),
        ("take_away", "aborted", True, {}),
        ("reject", "rejected", False, {}),
        ("late", "late acceptances", False, {}),
        ("deaf", "unanswered", False, {}),
    ],
)
def test_each_fault_of_the_server_is_said_and_nothing_hangs_or_drives_on(
    start_team, bench, capfd, monkeypatch, fault, kind, stays, limit
):
    if fault == "silent":
        monkeypatch.setattr(decisions, "SILENCE_SECONDS", 1.0)
    world, drivers, server = start_team(**limit)
    bench.spin_until(moved(world, 2), "under way")
    robot = server.bases["robot_1"]
    driver = drivers[0]
    robot.faults += [fault]
    before = world.summary()["moves_failed"]
    bench.spin_until(lambda: not robot.faults, f"a goal to {fault}")
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 3), "the world goes on")
    bench.spin_until(lambda: driver.driver.counts[kind] >= 1, kind)
    assert (world.summary()["moves_failed"] > before) == stays
    if fault == "late":
        assert "accepted a goal too late: it is cancelled" in capfd.readouterr().err
    bench.spin_until(lambda: all([one.settled() for one in drivers]), "both stand")
    bench.spin_until(lambda: not server.driving, "a goal accepted late is over, too")


def test_a_killed_server_and_one_that_comes_back(start_team, serve, bench):
    process = serve(*ROBOTS)
    world, drivers, _ = start_team(served=False, pose_timeout=1.0)
    bench.spin_until(moved(world, 2), "under way")
    process.send_signal(signal.SIGKILL)
    process.exit_code()
    bench.spin_until(
        lambda: any(one.driver.counts["poses lost"] for one in drivers), "lost"
    )
    serve(*ROBOTS)
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 3), "it goes on")


@pytest.fixture
def serve(start_node):
    """Return a function that starts a stand-in as a process."""

    def serve(*bases):
        values = {
            "bases": list(bases),
            "places": [AT_FIRST] * len(bases),
            "speed": SPEED,
        }
        process = start_node("nav2_stand_in", "nav2_stand_in", **values)
        process.wait_for("in place of Nav2: ")
        return process

    return serve


NAMES = "/nav2_stand_in, /other"


@pytest.fixture
def serve_twice(start):
    """Return a function that starts a second server of a robot's action."""

    def serve(robot):
        words = ["--ros-args", "-r", "__node:=other", "-p", f"bases:=[{robot}]"]
        process = start("nodes.nav2_stand_in", *words)
        process.wait_for("in place of Nav2: ")
        return process

    return serve


@pytest.fixture
def start_driver(start):
    """Return a function that starts a driver as a process."""

    def begin(robot):
        words = ["--ros-args", "-r", f"__node:={robot}_driver", "-p", f"robot:={robot}"]
        return start("nodes.nav2_driver", *words)

    return begin


def test_no_goal_is_sent_before_one_of_two_servers_is_gone(
    start_team, serve_twice, start_driver, bench
):
    """A killed one stays in the graph for a while."""
    second = serve_twice("robot_2")
    world, [driver], server = start_team(driven=ROBOTS[:1])
    bench.spin_until(lambda: driver.on_duty, "on duty")
    process = start_driver("robot_2")
    waits = "waiting for a single server: Nav2's action /robot_2/navigate_to_pose has 2 servers, "
    bench.spin_until(lambda: waits + NAMES in process.output, "it says why")
    assert server.bases["robot_2"].goals == 0 and world.doing == "waiting"
    second.send_signal(signal.SIGINT)
    bench.spin_until(moved(world, 2), "one is left: it goes on")
    assert process.running()


def test_a_second_server_that_appears_later_is_reported_and_nothing_crashes(
    start_team, serve_twice, start_driver, bench
):
    process = start_driver("robot_1")
    world, _, server = start_team(driven=ROBOTS[1:], steps=100_000)
    bench.spin_until(moved(world, 2), "under way")
    second = serve_twice("robot_1")
    wanted = f"Nav2's action /robot_1/navigate_to_pose has 2 servers, {NAMES}; "
    bench.spin_until(lambda: wanted in process.output, "it is reported")
    base = server.bases["robot_1"]
    begun = base.goals
    bench.spin_until(
        lambda: not process.running() or base.goals > begun + 60, "goals go to both"
    )
    assert process.running(), process.output
    second.send_signal(signal.SIGINT)
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 3), "it goes on")
    process.send_signal(signal.SIGINT)
    bench.spin_until(lambda: not process.running(), "it ends")
    assert process.exit_code() == 0


def test_paused_the_goals_are_cancelled_and_then_sent_again(start_team, bench):
    world, drivers, server = start_team(steps=100_000)
    bench.spin_until(moved(world, 2), "under way")
    bases = server.bases.values()
    for base in bases:
        base.faults += ["stuck"]
    bench.spin_until(lambda: len(server.driving) == 2, "both have a goal")
    observer = bench.observer()

    def hold(paused):
        request = SetBool.Request(data=paused)
        assert observer.call(SetBool, "world_simulator/pause", request).success

    hold(True)
    bench.spin_until(
        lambda: all(driver.doing == "paused: stands" for driver in drivers),
        "they say so",
    )
    assert not server.driving
    goals = [base.goals for base in bases]
    spin_for(bench, 1.0)
    assert [base.goals for base in bases] == goals
    hold(False)
    made = world.lockstep.world.transitions
    failed = world.summary()["moves_failed"]
    bench.spin_until(moved(world, made + 3), "it goes on")
    assert world.summary()["moves_failed"] == failed


def test_a_killed_driver_s_goal_ends_when_it_is_started_again(
    start_team, start_node, bench, monkeypatch
):
    """The driver is a process of its own, with the limits of a quiet machine."""
    monkeypatch.setattr(nav2_stand_in, "SIMULATION_SECONDS", SIMULATION_SECONDS)

    def drive():
        return start_node(
            *("nav2_driver", "robot_1_driver"),
            robot="robot_1",
            **PATIENT,
        )

    process = drive()
    world, _, server = start_team(driven=ROBOTS[1:])
    bench.spin_until(moved(world, 2), "under way")
    robot = server.bases["robot_1"]
    robot.faults += ["stuck"]
    bench.spin_until(lambda: robot.fault == "stuck" and robot.active, "stuck")
    before = len(robot.ended)
    process.send_signal(signal.SIGKILL)
    process.exit_code()
    assert robot.active is not None
    process = drive()
    cancelled = [GoalStatus.STATUS_CANCELED]
    bench.spin_until(lambda: robot.ended[before:] == cancelled, "it is cancelled")
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 3), "it goes on")
    robot.faults += ["stuck"]
    bench.spin_until(lambda: robot.fault == "stuck" and robot.active, "stuck")
    process.send_signal(signal.SIGTERM)
    bench.spin_until(lambda: not process.running(), "it ends")
    assert process.exit_code() == 0 and robot.active is None


def test_deactivated_it_cancels_and_activated_it_goes_on(start_team, bench):
    world, drivers, server = start_team()
    bench.spin_until(moved(world, 2), "under way")
    observer = bench.observer()

    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return observer.call(
            ChangeState, "robot_1_driver/change_state", request
        ).success

    robot = server.bases["robot_1"]
    robot.faults += ["stuck"]
    bench.spin_until(lambda: robot.fault == "stuck" and robot.active, "stuck")
    assert change(Transition.TRANSITION_DEACTIVATE)
    bench.spin_until(lambda: robot.active is None, "cancelled")
    assert not change(Transition.TRANSITION_DEACTIVATE)  # and the node lives
    begin = time.monotonic()
    goals = robot.goals
    bench.spin_until(lambda: time.monotonic() > begin + 0.5, "a while")
    assert robot.goals == goals
    assert change(Transition.TRANSITION_ACTIVATE)
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 3), "it goes on")


def test_lost_poses_cancel_and_a_lifted_robot_is_lost_and_found(start_team, bench):
    world, drivers, server = start_team(pose_timeout=0.3)
    bench.spin_until(moved(world, 2), "under way")
    robot = server.bases["robot_1"]
    robot.lost = True
    bench.spin_until(lambda: drivers[0].driver.counts["poses lost"] >= 1, "blind")
    bench.spin_until(lambda: robot.active is None, "cancelled")
    robot.pose = Pose(50.0, 50.0, 0.0)
    robot.lost = False
    robot.faults += ["detour"] * 2
    bench.spin_until(lambda: world.summary()["bodies_lost"] >= 1, "lost")
    robot.pose = Pose(0.5, 0.5, 0.0)
    robot.faults = []
    made = world.lockstep.world.transitions
    bench.spin_until(moved(world, made + 5), "found")


def test_with_transforms_for_poses_the_same_bits(
    types, bench, tmp_path, simulate, assert_same_tables
):
    from tf2_msgs.msg import TFMessage

    out = tmp_path / "out"
    place = {"context": bench.place()[0], "namespace": "fleet"}
    given = {"steps": 8, "out": str(out), "seed": 7, "namespace": "fleet"}
    world = bench.world(bodies=True, **given)
    bench.robots(out=str(out), namespace="fleet")
    for name in ROBOTS:
        values = {"robot": name, "pose_type": "tf", "speed": 2.0, "turn": 6.0}
        values["pose_timeout"] = NEVER
        bench.add(CmdVelDriverNode(name=f"{name}_driver", values=values, **place))
    bench.add(BodyNode(values={}, **place))
    transforms = bench.observer().listen(TFMessage, "/fleet/tf")
    bench.spin_until_done()
    gather(out, world.run.scenario, interrupted=False)
    assert_same_tables(out, simulate("env1", {"steps": 8}, seed=7))
    assert world.summary()["moves_failed"] == 0
    links = {
        (t.header.frame_id, t.child_frame_id)
        for one in transforms
        for t in one.transforms
    }
    assert ("map", "fleet/robot_1/odom") in links
    assert ("fleet/robot_1/odom", "fleet/robot_1/base_link") in links and len(
        links
    ) == 4
