# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time bases: what is shown has the time of the clock that its viewers follow."""

import time

import pytest
from rosgraph_msgs.msg import Clock
from visualization_msgs.msg import MarkerArray

from sparse_coord_ros.log.runlog.verify import verify
from sparse_coord_ros.ros.nodes.body import BodyNode
from sparse_coord_ros.ros.nodes.driver import DriverNode

FLEETS = ("a", "b")
ROBOTS = ("robot_1", "robot_2")


def seconds(stamp):
    return stamp.sec + stamp.nanosec * 1e-9


def stamps(arrays):
    """Return the times of the markers of some arrays."""
    return [seconds(one.header.stamp) for array in arrays for one in array.markers]


@pytest.mark.parametrize("clock", ["own", "none"])
def test_markers_have_the_run_s_time_only_where_it_is_that_of_the_clock(
    bench, tmp_path, clock
):
    """Where the clock is others', time steps of some seconds would be long gone."""
    out = tmp_path / "out"
    observer = bench.observer()
    heard = [
        observer.listen(MarkerArray, name, latched=True)
        for name in ("markers", "scene")
    ]
    begun = time.time()
    bench.recorder(out / "bag")
    world = bench.world(
        out=str(out), set=["steps=150"], recorded=True, clock=clock, rate=150.0
    )
    bench.robots(out=str(out))
    bench.spin_until_done()
    end = world.lockstep.world.step * world.run.step_period
    earliest, latest = (0.0, end) if clock == "own" else (begun, time.time())
    for arrays in heard:
        assert len(arrays) > 1
        assert all(earliest <= one <= latest for one in stamps(arrays))
    assert verify(out / "bag").same


@pytest.fixture
def fleets(bench, tmp_path):
    """Start two fleets, each in a namespace, with bodies or without; return their worlds."""

    def start(*, bodies):
        worlds = []
        for name in FLEETS:
            out = str(tmp_path / name)
            # Time steps of unlike length: the fleets' clocks do not agree.
            period = 0.1 if name == "a" else 7.0
            more = {
                "set": ["steps=12"],
                "bodies": bodies,
                "step_period": period,
                "rate": 40.0,
            }
            more["clock"] = "none" if bodies else "own"
            worlds.append(bench.world(namespace=name, out=out, **more))
            bench.robots(out=out, namespace=name)
            place = {"context": bench.place()[0], "namespace": name}
            for robot in ROBOTS if bodies else ():
                values = {"robot": robot, "pose_type": "tf", "speed": 2.0, "turn": 6.0}
                bench.add(DriverNode(name=f"{robot}_driver", values=values, **place))
            if bodies:
                bench.add(BodyNode(values={"body_clock": True}, **place))
        return worlds

    return start


def within(clock, found):
    """Whether times lie in those that a clock has said, but for the newest, under way."""
    said = [seconds(one.clock) for one in clock]
    return min(said) <= min(found) and max(found) <= max(said)


def test_each_of_two_fleets_has_its_own_time(bench, fleets):
    observer = bench.observer()
    heard = {}
    for name in FLEETS:
        clock = observer.listen(Clock, f"{name}/clock")
        heard[name] = clock, observer.listen(MarkerArray, f"{name}/scene")
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
    world = bench.world(set=["steps=60"], clock="none", rate=60.0)
    bench.robots()
    bench.spin_until_done(world)
    links = [one for message in transforms for one in message.transforms]
    assert {one.child_frame_id for one in links} == {
        f"{name}/base_link" for name in ROBOTS
    }
    assert all(begun <= seconds(one.header.stamp) <= time.time() for one in links)
