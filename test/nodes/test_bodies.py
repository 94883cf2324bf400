# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team whose robots have bodies: the same lock step, the same bits, and poses in between."""

import re
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Twist,
    TwistStamped,
)
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from sparse_coord_ros.base.errors import RunError, SettingError
from sparse_coord_ros.core.game.actions import SOUTH
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.lockstep.bodies import BodyGoal, GoalReport, Goals
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.protocol.wire.status import RunStatus
from sparse_coord_ros.ros.driving.body import BodyNode
from sparse_coord_ros.ros.driving.driver import CmdVelDriverNode
from sparse_coord_ros.ros.nodes.body_messages import (
    goals_message,
    reached_message,
    read_goals,
    read_reached,
)
from sparse_coord_ros.ros.nodes.outputs import gather
from sparse_coord_ros.ros.nodes.ros_messages import messages_of
from sparse_coord_ros.ros.nodes.transforms import HeardTransforms

from .puppet import puppet

QUICK = {"speed": 2.0, "turn": 6.0}
"""Bodies that are fast for their ticks, so that a step takes few of them."""

ROBOTS = ("robot_1", "robot_2")


def with_bodies(bench, out, *, steps=8, body=None, driver=None, namespace="", **more):
    """Start a team with bodies on a bench, and return its world, robots, drivers and body."""
    more |= {
        "steps": steps,
        "out": str(out),
        "seed": 7,
        "namespace": namespace,
    }
    world = bench.world(bodies=True, **more)
    robots = bench.robots(out=str(out), namespace=namespace)
    place = {"context": bench.place()[0], "namespace": namespace}
    drivers = [
        bench.add(
            CmdVelDriverNode(
                name=f"{robot}_driver",
                values={"robot": robot, **QUICK, **(driver or {})},
                **place,
            )
        )
        for robot in ROBOTS
    ]
    return world, robots, drivers, bench.add(BodyNode(values=body or {}, **place))


def test_bodies_that_get_there_learn_what_the_grid_teaches(
    bench, tmp_path, simulate, assert_same_tables
):
    out = tmp_path / "out"
    world, *_, body = with_bodies(bench, out)
    poses = bench.observer().listen(PoseStamped, "robot_1/pose")
    bench.spin_until_done()
    gather(out, world.run.scenario, interrupted=False)
    assert_same_tables(out, simulate("env1", {"steps": 8}, seed=7))
    summary = world.summary()
    assert (summary["moves_failed"], summary["bodies_lost"]) == (0, 0)
    assert summary["body_seconds"] > 0
    assert len(poses) > 8 and poses[0].header.frame_id == "map"
    last = [body.pose[:2] for body in body.simulator.bodies]
    for cell, (x, y) in zip(world.lockstep.world.cells, last, strict=True):
        assert np.hypot(*np.subtract(world.topics.messages.centres[cell], (x, y))) < 0.5
    assert body.summary()["seconds"] >= summary["body_seconds"] - 1e-6


def test_with_a_rate_bodies_drive_at_once_and_the_step_that_is_late_does_not_wait(
    bench, tmp_path
):
    world, *_ = with_bodies(bench, tmp_path / "out", steps=400, rate=0.001)
    made = world.lockstep.world

    def there():
        return world.bodies.side.seconds > 0 and not world.bodies.side.waiting

    bench.spin_until(there, "they are there before the beat")
    assert made.transitions == 0
    world.beat()
    assert made.transitions == 1
    bench.spin_until(lambda: world.bodies.side.waiting, "they drive")
    world.beat()
    assert made.transitions == 1
    bench.spin_until(lambda: made.transitions == 2, "it is made when they are there")
    bench.spin_until(
        lambda: world.lockstep.complete and there(), "it waits for the next beat"
    )
    assert made.transitions == 2


@pytest.mark.parametrize("order", ["d1bw2e"])
def test_any_order(bench, tmp_path, order):
    context = bench.place()[0]

    def driver(robot):
        values = {"robot": robot, **QUICK}
        return CmdVelDriverNode(context=context, name=f"{robot}_driver", values=values)

    made = {
        "w": lambda: bench.world(bodies=True, steps=3),
        "1": lambda: bench.robot("robot_1"),
        "2": lambda: bench.robot("robot_2"),
        "d": lambda: bench.add(driver("robot_1")),
        "e": lambda: bench.add(driver("robot_2")),
        "b": lambda: bench.add(BodyNode(context=context, values={})),
    }
    for letter in order:
        made[letter]()
    bench.spin_until_done()


def test_a_driver_and_a_body_that_come_back_go_on(bench, tmp_path):
    world, _, drivers, body = with_bodies(bench, tmp_path / "out", steps=400)
    under_way = world.lockstep.world
    bench.spin_until(lambda: under_way.transitions > 1, "under way")
    bench.destroy(drivers[1])
    before = under_way.transitions
    context = bench.place()[0]
    values = {"robot": "robot_2", **QUICK}
    bench.add(CmdVelDriverNode(context=context, name="another", values=values))
    bench.spin_until(lambda: under_way.transitions > before + 2, "with another driver")
    assert world.summary()["bodies_lost"] == 0
    bench.destroy(body)
    before = under_way.transitions
    bench.add(BodyNode(context=context, values={}))
    bench.spin_until(lambda: under_way.transitions > before + 2, "with another body")


@pytest.mark.parametrize("slips", [True, False])
def test_verify_takes_where_bodies_got_to_as_it_is_logged(bench, tmp_path, slips):
    """A body may fail where a move of the grid does not: all that follows is computed again."""
    out = tmp_path / "out"
    late = {"step_seconds": 0.7}
    world, robots, *_ = with_bodies(
        bench, out, steps=12, driver=late, recorded=True, slips=slips
    )
    recorder = bench.recorder(out / "bag")
    bench.spin_until_done(world, *robots, recorder)
    assert world.summary()["moves_failed"] > 0
    found = verify(out / "bag")
    assert found.same, found.first
    assert found.steps == 12 and found.log.run.bodies and found.log.run.slips is slips


def test_drivers_that_are_missing_are_named(bench, tmp_path):
    bench.world(bodies=True, steps=3).startup_timeout = 0.4
    bench.robots()
    with pytest.raises(
        RunError, match="driver --ros-args -p robot:=robot_1, driver --ros"
    ):
        bench.spin_until(lambda: False)


@pytest.mark.long
def test_in_many_processes_the_same_bits_seconds_and_touches(
    start_node, tmp_path, simulate, assert_same_tables
):
    found = []
    for run in ("one", "two"):
        out = tmp_path / run
        nodes = [start_node("body", "body")]
        for name in ROBOTS:
            nodes.append(start_node("driver", f"{name}_driver", robot=name, **QUICK))
            nodes.append(start_node("robot", name, out=out))
        world = start_node(
            *("world_simulator", "world_simulator"),
            **{
                "scenario": "env1",
                "steps": 60,
                "seed": 7,
                "bodies": True,
                "out": out,
            },
        )
        assert [node.exit_code() for node in (world, *nodes)] == [0] * 6, world.output
        scenario = load_scenario("env1", steps=60)
        gather(out, scenario, interrupted=False)
        assert_same_tables(out, simulate("env1", {"steps": 60}, seed=7))
        found.append(re.search(r"bodies: (seconds .*)", nodes[0].output)[1])
    assert found[0] == found[1]


def test_without_its_driver_a_body_has_not_moved_and_the_world_goes_on(bench, tmp_path):
    world, _, drivers, _ = with_bodies(
        bench, tmp_path / "out", steps=400, body_timeout=0.3, slips=False
    )
    bench.spin_until(lambda: world.lockstep.world.transitions > 2, "under way")
    bench.destroy(drivers[1])
    before = world.lockstep.world.transitions
    bench.spin_until(
        lambda: (
            world.summary()["bodies_lost"] > 0
            and world.lockstep.world.transitions > before + 2
        ),
        "the world goes on",
    )


def hold(observer, paused):
    """Pause a team, or let it go on."""
    request = SetBool.Request(data=paused)
    assert observer.call(SetBool, "world_simulator/pause", request).success


def spin_for(bench, seconds):
    end = time.monotonic() + seconds
    bench.spin_until(
        lambda: time.monotonic() > end, "time passes", seconds=seconds + 60.0
    )


def test_while_the_team_is_paused_all_bodies_stand(bench, tmp_path):
    """No time limit of a move runs meanwhile, neither the driver's nor the world's."""
    world, _, drivers, _ = with_bodies(
        bench, tmp_path / "out", steps=4000, body={"body_rate": 30.0}, body_timeout=1.0
    )
    made = world.lockstep.world
    bench.spin_until(lambda: made.transitions > 2, "under way")
    observer = bench.observer()
    commands = [observer.listen(Twist, f"{robot}/cmd_vel") for robot in ROBOTS]
    said = observer.listen(DiagnosticArray, "/diagnostics")
    hold(observer, True)
    stands = [Twist()] * 5  # commands of before may still be under way
    bench.spin_until(
        lambda: all(heard[-5:] == stands for heard in commands), "only these come"
    )
    for heard in [*commands, said]:
        heard.clear()
    before = made.transitions, world.summary()["moves_failed"]
    spin_for(bench, 1.3)  # longer than body_timeout
    assert (made.transitions, world.summary()["moves_failed"]) == before
    for heard in commands:
        assert len(heard) > 5, "a base that missed a command hears another one"
        assert all(command == Twist() for command in heard)
    doing = {one.name: one.message for message in said for one in message.status}
    for robot in ROBOTS:
        assert doing[f"{robot}_driver: driving"] == "paused: stands"
    bench.destroy(drivers[1])
    values = {"robot": "robot_2", **QUICK}
    context = bench.place()[0]
    late = bench.add(
        CmdVelDriverNode(context=context, name="robot_2_driver", values=values)
    )
    bench.spin_until(lambda: late.on_duty, "another driver is on duty")
    spin_for(bench, 0.5)
    assert late.held and made.transitions == before[0]
    assert all(command == Twist() for command in commands[1])
    hold(observer, False)
    bench.spin_until(lambda: made.transitions > before[0] + 2, "it goes on")


def test_for_a_single_step_bodies_move_and_then_stand_again(bench, tmp_path):
    world, _, drivers, _ = with_bodies(bench, tmp_path / "out", steps=400)
    made = world.lockstep.world
    bench.spin_until(lambda: made.transitions > 1, "under way")
    observer = bench.observer()
    hold(observer, True)
    bench.spin_until(
        lambda: world.lockstep.complete and all(one.held for one in drivers),
        "all stand",
    )
    before = made.transitions
    assert observer.call(Trigger, "world_simulator/step").success
    bench.spin_until(lambda: made.transitions == before + 1, "one step")
    bench.spin_until(lambda: all(one.held for one in drivers), "all stand again")
    observer.call(Trigger, "world_simulator/reset")
    hold(observer, False)
    bench.spin_until(lambda: made.transitions > before + 4, "it goes on")


def test_at_their_own_speed(bench, tmp_path):
    world, *_ = with_bodies(bench, tmp_path / "out", steps=5, body={"body_rate": 50.0})
    bench.spin_until_done()
    assert world.summary()["transitions"] == 5


@pytest.mark.parametrize("rate", [0.5, 3.0, 40.0, 1000.0])
def test_a_body_simulates_so_many_seconds_a_second(bench, rate, monkeypatch):
    """The parameter `body_rate`."""
    timers = []
    made = BodyNode.create_timer

    def create_timer(node, seconds, callback, *more, **how):
        timers.append((seconds, callback))
        return made(node, seconds, callback, *more, **how)

    monkeypatch.setattr(BodyNode, "create_timer", create_timer)
    body = BodyNode(context=bench.place()[0], values={"body_rate": rate})
    body.begin(make_run(load_scenario("env1"), {}))
    seconds, tick = timers[-1]
    before = body.simulator.seconds
    for _ in range(10):
        tick()
    assert (body.simulator.seconds - before) / (10 * seconds) == pytest.approx(rate)
    body.destroy_node()


def test_the_waiting_for_bodies_is_counted_from_their_goals(bench):
    """Else each step adds to it, and a moving team seems to have stopped."""
    world = bench.world(bodies=True)
    bodies = world.bodies
    waited = []
    world.remind = lambda reminder, for_whom: waited.append(reminder.due(bodies.now))
    bodies.side.made((Action(SOUTH, False, -1, False),) * 2)
    for bodies.now in (0.0, 100.0):
        bodies.look(bodies.now, held=False)
    bodies.send(Goals(1, 1, False, 0.0, (BodyGoal(0, 0, 1),)))
    bodies.look(bodies.now, held=False)
    assert waited == [0.0, 100.0, 0.0]


def test_goals_and_reports_travel(own_domain):
    run = make_run(load_scenario("env1"), {})
    messages = messages_of(run)
    goals = Goals(3, 17, False, 4.5, (BodyGoal(1, 4, 5),))
    assert read_goals(messages, goals_message(messages, goals)) == goals
    for reached in (
        GoalReport(0, 3, 5, True, 1.25, 0.0),
        GoalReport(0, 3, -1, False, 9.0, 0.0),
    ):
        assert (
            read_reached(messages, 0, reached_message(messages, 17, reached)) == reached
        )


@pytest.mark.parametrize(
    ("values", "kind", "thing"),
    [
        ({"robot": "robot_9"}, RunError, "robot 'robot_9'"),
        ({"robot": "robot_1", "radius": 3.0}, SettingError, "radius: value is 3"),
    ],
)
def test_a_driver_that_does_not_fit_the_run_ends(bench, values, kind, thing):
    bench.world(bodies=True)
    bench.add(CmdVelDriverNode(context=bench.place()[0], values=values))
    with pytest.raises(kind, match=thing):
        bench.spin_until(lambda: False)


@pytest.mark.parametrize(
    ("pose_type", "kind"),
    [("pose_with_covariance", PoseWithCovarianceStamped), ("odometry", Odometry)],
)
def test_poses_of_other_types(bench, pose_type, kind):
    world = bench.world(bodies=True)
    values = {"robot": "robot_2", "pose_type": pose_type, "map_frame": "here"}
    driver = bench.add(CmdVelDriverNode(context=bench.place()[0], values=values))
    observer = bench.observer()
    publisher = observer.create_publisher(kind, "robot_2/pose", 10)
    bench.spin_until(lambda: driver.presence is not None, "the run is known")
    message = kind()
    message.header.frame_id = "here"
    message.header.stamp.sec = 3
    message.pose.pose.position.x = 1.5
    message.pose.pose.orientation.z = 1.0
    message.pose.pose.orientation.w = 0.0
    observer.say(
        publisher, message, lambda: driver.driver.pose is not None, "the pose is there"
    )
    assert driver.driver.pose == pytest.approx((1.5, 0.0, np.pi))
    assert world.run.scenario.name == "env1"


def transforms(*links):
    """Return the content of a TFMessage, whose class is not in the wheels.

    Args:
        links: (parent, child, x in metres, seconds) of each transform.
    """
    found = []
    for parent, child, x, seconds in links:
        stamp = SimpleNamespace(sec=seconds, nanosec=0)
        header = SimpleNamespace(frame_id=parent, stamp=stamp)
        place = SimpleNamespace(x=x, y=0.0)
        turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        there = SimpleNamespace(translation=place, rotation=turn)
        one = SimpleNamespace(header=header, child_frame_id=child, transform=there)
        found.append(one)
    return SimpleNamespace(transforms=found)


def test_poses_from_transforms():
    heard = HeardTransforms("map", "robot_1/base_link")
    base = transforms(("odom", "robot_1/base_link", 2.0, 7))
    assert heard.read(base, static=False) is None, "nobody has said where odom is"
    other = transforms(("map", "robot_2/odom", 5.0, 7))
    assert heard.read(other, static=False) is None
    odom = transforms(("map", "odom", 1.0, 0))
    assert heard.read(odom, static=True) == (7.0, (3.0, 0.0, 0.0))
    assert heard.read(other, static=False) is None, "it says nothing of this body"


def test_transforms_need_their_package(bench, monkeypatch):
    monkeypatch.setitem(sys.modules, "tf2_msgs", None)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    bench.world(bodies=True)
    with pytest.raises(RunError, match="tf needs the package tf2_msgs"):
        values = {"robot": "robot_1", "pose_type": "tf"}
        bench.add(CmdVelDriverNode(context=bench.place()[0], values=values))
        bench.spin_until(lambda: False)


def test_a_body_whose_poses_stop_is_stopped(bench):
    """And poses outside of the map are dropped."""
    context = bench.place()[0]
    world = bench.world(bodies=True, steps=5)
    driver = bench.add(
        CmdVelDriverNode(
            context=context, values={"robot": "robot_1", "pose_timeout": 0.2}
        )
    )
    observer = bench.observer()
    commands = observer.listen(Twist, "robot_1/cmd_vel")
    poses = observer.create_publisher(PoseStamped, "robot_1/pose", 10)
    bench.spin_until(lambda: driver.presence is not None, "the run is known")
    pose = PoseStamped()
    pose.header.frame_id = "odom"
    pose.header.stamp.sec = 1
    observer.say(
        poses, pose, lambda: driver.subscriber.total > 0, "another frame is dropped"
    )
    x, y = world.topics.messages.centres[0]
    pose.header.frame_id = "map"
    pose.pose.orientation.w = 1.0
    pose.pose.position.x = x
    pose.pose.position.y = y
    observer.say(
        poses, pose, lambda: driver.driver.pose is not None, "the pose is there"
    )
    world.bodies.send(
        Goals(
            1,
            1,
            False,
            0.0,
            (BodyGoal(0, 0, int(world.run.scenario.map.next_cell[0, 1])),),
        )
    )
    bench.spin_until(lambda: len(commands) >= 2, "it drives and is stopped")
    assert commands[0].angular.z or commands[0].linear.x
    assert (commands[-1].linear.x, commands[-1].angular.z) == (0.0, 0.0)


def test_deactivated_a_body_stands_and_activated_it_goes_on(bench, tmp_path):
    world, *_ = with_bodies(bench, tmp_path / "out", steps=400)
    bench.spin_until(lambda: world.lockstep.world.transitions > 1, "under way")
    observer = bench.observer()

    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return observer.call(
            ChangeState, "robot_1_driver/change_state", request
        ).success

    commands = observer.listen(Twist, "robot_1/cmd_vel")
    bench.spin_until(lambda: commands, "commands are heard")
    assert change(Transition.TRANSITION_DEACTIVATE)
    bench.spin_until(lambda: commands and commands[-1] == Twist(), "zero velocity")
    assert not change(Transition.TRANSITION_DEACTIVATE), (
        "it is inactive; and the node lives"
    )
    before = world.lockstep.world.transitions
    assert change(Transition.TRANSITION_ACTIVATE)
    bench.spin_until(
        lambda: world.lockstep.world.transitions > before + 2, "it goes on"
    )


def test_a_body_that_is_there_already_is_reported_when_the_world_hears_it(bench):
    """A report is sent once; before the subscription it would be lost."""
    world = bench.world(bodies=True)
    values = {"robot": "robot_1"}
    driver = puppet(CmdVelDriverNode)(context=bench.place()[0], values=values)
    observer = bench.observer()
    observer.listen(Twist, "robot_1/cmd_vel")
    heard = observer.listen(JointState, "robot_1/reached")
    messages = messages_of(world.run)
    goals = Goals(1, 1, True, 0.0, (BodyGoal(0, 0, 0),))
    pose = PoseStamped()
    pose.header.frame_id = "map"
    pose.header.stamp.sec = 1
    x, y = messages.centres[0]
    pose.pose.position.x = x
    pose.pose.position.y = y
    pose.pose.orientation.w = 1.0
    run = observer.listen(String, "run", latched=True)
    bench.spin_until(lambda: run, "the run is announced")
    driver.hear("run", run[0])
    driver.tick()
    driver.world_said(RunStatus(world.run.id, RunState.LEARNING, 1, 0))
    driver.hear("goals", goals_message(messages, goals))
    driver.hear("robot_1/pose", pose)

    def reported():
        driver.tick()
        return heard

    bench.spin_until(reported, "it is reported")
    driver.destroy_node()


@pytest.mark.parametrize(
    ("frames", "frame"),
    [({"frame_prefix": "a_"}, "a_robot_1/base_link"), ({"base_frame": "hull"}, "hull")],
)
def test_an_inactive_driver_waits_for_its_activation(bench, frames, frame):
    bench.world(bodies=True, steps=5)
    values = {"robot": "robot_1", "stamped": True, **frames}
    driver = bench.add(CmdVelDriverNode(context=bench.place()[0], values=values))
    driver.trigger_deactivate()
    observer = bench.observer()
    poses = observer.create_publisher(PoseStamped, "robot_1/pose", 10)
    commands = observer.listen(TwistStamped, "robot_1/cmd_vel")
    bench.spin_until(lambda: driver.presence is not None, "the run is known")
    pose = PoseStamped()
    pose.header.frame_id = "map"
    pose.header.stamp.sec = 1
    pose.pose.orientation.w = 1.0
    observer.say(
        poses, pose, lambda: driver.driver.pose is not None, "the pose is there"
    )
    assert not driver.on_duty and not driver.active
    driver.trigger_activate()
    bench.spin_until(lambda: driver.on_duty, "it reports for duty")
    driver.stop()
    bench.spin_until(lambda: commands, "a stamped command")
    assert commands[0].header.frame_id == frame
    assert commands[0].header.stamp.sec > 0 and commands[0].twist == Twist()
