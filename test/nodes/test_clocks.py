# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time bases: displayed messages have the time of their viewers' clock."""

import time

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock
from visualization_msgs.msg import MarkerArray

from sparse_coord_ros.log.bags import open_bag
from sparse_coord_ros.log.runlog.verify import verify
from sparse_coord_ros.ros.driving.body import BodyNode
from sparse_coord_ros.ros.driving.driver import CmdVelDriverNode
from sparse_coord_ros.ros.nodes.outputs import gather

FLEETS = ("a", "b")
ROBOTS = ("robot_1", "robot_2")


def seconds(stamp):
    return stamp.sec + stamp.nanosec * 1e-9


def stamps(arrays):
    """Return the times of the markers of some arrays."""
    return [seconds(one.header.stamp) for array in arrays for one in array.markers]


@pytest.mark.parametrize("clock", ["own", "none"])
def test_what_is_shown_has_the_time_of_the_clock_that_others_follow(
    bench, tmp_path, simulate, assert_same_tables, clock
):
    """With another clock, markers of the run's time would be long past.

    A foreign clock then runs beside; the log has none.
    """
    out = tmp_path / "out"
    own = clock == "own"
    observer = bench.observer()
    heard = [
        observer.listen(MarkerArray, f"world_simulator/{name}", latched=True)
        for name in ("markers", "scene")
    ]
    said = observer.listen(DiagnosticArray, "/diagnostics")
    others = None if own else observer.create_publisher(Clock, "/clock", 10)
    begun = time.time()
    bench.recorder(out / "bag")
    world = bench.world(out=str(out), steps=40, recorded=True, clock=clock, rate=60.0)
    bench.robots(out=str(out))

    def told():
        if others is not None:
            others.publish(Clock(clock=Time(sec=1000 * len(said))))
        return world.lockstep.world.transitions > 20

    bench.spin_until(told, "the run is under way")
    assert observer.count("/clock") == 1, "the world's, or that of the others"
    bench.spin_until_done()
    end = world.lockstep.world.step * world.run.step_period
    earliest, latest = (0.0, end) if own else (begun, time.time())
    for arrays in heard:
        assert arrays
        assert all(earliest <= one <= latest for one in stamps(arrays))
    headers = [message.header for message in said]
    assert {header.frame_id for header in headers} == {""}
    assert all(abs(header.stamp.sec - time.time()) < 300 for header in headers)
    gather(out, world.run.scenario, interrupted=False)
    assert_same_tables(out, simulate("env1", {"steps": 40}))
    assert ("/clock" in open_bag(out / "bag").topics) == own
    assert verify(out / "bag").same


@pytest.fixture
def fleets(bench, tmp_path):
    """Start two fleets, each in a namespace, with bodies or without; return their worlds."""

    def start(*, bodies):
        worlds = []
        for name in FLEETS:
            out = str(tmp_path / name)
            steps = 150 if name == "b" and not bodies else 12
            more = {"steps": steps, "bodies": bodies, "rate": 40.0}
            more["clock"] = "none" if bodies else "own"
            worlds.append(bench.world(namespace=name, out=out, **more))
            bench.robots(out=out, namespace=name)
            place = {"context": bench.place()[0], "namespace": name}
            for robot in ROBOTS if bodies else ():
                values = {"robot": robot, "pose_type": "tf", "speed": 2.0, "turn": 6.0}
                bench.add(
                    CmdVelDriverNode(name=f"{robot}_driver", values=values, **place)
                )
            if bodies:
                bench.add(BodyNode(values={}, **place))
        return worlds

    return start


def within(clock, found):
    """Return whether times are within a clock's published ones, except the newest, in flight."""
    said = [seconds(one.clock) for one in clock]
    return min(said) <= min(found) and max(found) <= max(said)


def test_each_of_two_fleets_has_its_own_time(bench, fleets):
    observer = bench.observer()
    heard = {}
    for name in FLEETS:
        clock = observer.listen(Clock, f"{name}/clock")
        heard[name] = (
            clock,
            observer.listen(MarkerArray, f"{name}/world_simulator/scene"),
        )
    fleets(bodies=False)
    bench.spin_until_done()
    for clock, scenes in heard.values():
        assert within(clock, [one for one in stamps(scenes) if one > 0])
    longest = [max(stamps(scenes)) for _, scenes in heard.values()]
    assert longest[1] > 10 * longest[0], "they are unlike"


@pytest.mark.long
@pytest.mark.parametrize("bodies", [False, True])
def test_two_fleets_beside_a_robot_of_the_system_s_time_do_not_share_tf(
    types, bench, fleets, bodies
):
    """Three clocks: of two fleets and of the system; each topic has the transforms of one."""
    from tf2_msgs.msg import TFMessage

    observer = bench.observer()
    of_all = observer.listen(TFMessage, "/tf")
    heard = {
        name: (
            observer.listen(Clock, f"{name}/clock"),
            observer.listen(TFMessage, f"{name}/tf"),
        )
        for name in FLEETS
    }
    fleets(bodies=bodies)
    bench.spin_until_done()
    assert of_all == []
    for name, (clock, transforms) in heard.items():
        links = [one for message in transforms for one in message.transforms]
        assert {one.child_frame_id.partition("/")[0] for one in links} == {name}
        assert within(clock, [seconds(one.header.stamp) for one in links])


@pytest.mark.long
def test_without_a_clock_of_the_run_transforms_have_the_system_s_time(types, bench):
    from tf2_msgs.msg import TFMessage

    transforms = bench.observer().listen(TFMessage, "/tf")
    begun = time.time()
    world = bench.world(steps=60, clock="none", rate=60.0)
    bench.robots()
    bench.spin_until_done(world)
    links = [one for message in transforms for one in message.transforms]
    assert {one.child_frame_id for one in links} == {
        f"{name}/base_link" for name in ROBOTS
    }
    assert all(begun <= seconds(one.header.stamp) <= time.time() for one in links)
