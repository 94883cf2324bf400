# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of a team: topics, services, QoS and values, as documented."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from nav_msgs.srv import GetPlan
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from teams import memories_equal
from visualization_msgs.msg import MarkerArray

from sparse_coord_ros.base.palette import robot_colour
from sparse_coord_ros.base.share import share_file
from sparse_coord_ros.core.runs.run_config import run_from_yaml
from sparse_coord_ros.core.runs.saved_tables import load_saved, robot_file
from sparse_coord_ros.protocol.wire.status import values_of
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.show.layouts import foxglove_layout

SETTINGS = {"steps": 2000, "perception": "probability:0.5", "epsilon": "constant:1"}
SEED = 11
PERIOD = 0.1
RESOLUTION = 1.0
NAMES = ("robot_1", "robot_2")

TEAM = {
    "run": ("std_msgs/msg/String", True),
    "status": ("diagnostic_msgs/msg/DiagnosticStatus", True),
    "world_simulator/map": ("nav_msgs/msg/OccupancyGrid", True),
    "world_simulator/markers": ("visualization_msgs/msg/MarkerArray", True),
    "world_simulator/scene": ("visualization_msgs/msg/MarkerArray", True),
    "diagnostics": ("diagnostic_msgs/msg/DiagnosticArray", False),
}
ROBOT = {
    "local_state": ("geometry_msgs/msg/PoseStamped", True),
    "reward": ("sensor_msgs/msg/JointState", True),
    "action": ("sensor_msgs/msg/JointState", True),
    "percept": ("nav_msgs/msg/Path", True),
    "coordination_map": ("nav_msgs/msg/OccupancyGrid", True),
    "_progress": ("diagnostic_msgs/msg/DiagnosticStatus", True),
    "tables": ("std_msgs/msg/UInt8MultiArray", True),
}
"""Type of every topic, and whether it is kept for late readers, by the design."""

TOPICS = TEAM | {f"{name}/{topic}": of for name in NAMES for topic, of in ROBOT.items()}


@pytest.fixture(scope="module")
def team(module_bench, tmp_path_factory):
    """Return a paused team, observed for a while."""
    bench = module_bench
    observer = bench.observer()
    seen = SimpleNamespace(
        bench=bench,
        observer=observer,
        out=tmp_path_factory.mktemp("team"),
        diagnostics=observer.listen(DiagnosticArray, "diagnostics"),
        states={n: observer.listen(PoseStamped, f"{n}/local_state") for n in NAMES},
        rewards={n: observer.listen(JointState, f"{n}/reward") for n in NAMES},
        actions={n: observer.listen(JointState, f"{n}/action") for n in NAMES},
        percepts={n: observer.listen(Path, f"{n}/percept") for n in NAMES},
    )
    world = bench.world(rate=100.0, out=str(seen.out), seed=SEED, **SETTINGS)
    bench.spin_until(
        lambda: all(observer.count(topic) for topic in TEAM), "world found"
    )
    assert observer.call(
        SetBool, "world_simulator/pause", SetBool.Request(data=True)
    ).success
    robots = bench.robots(out=str(seen.out))
    bench.spin_until(
        lambda: all(observer.count(topic) for topic in TOPICS), "all found"
    )
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    assert observer.call(
        SetBool, "world_simulator/pause", SetBool.Request(data=False)
    ).success
    bench.spin_until(
        lambda: all(len(paths) >= 6 for paths in seen.percepts.values()), "percepts"
    )
    seen.diagnostics.clear()
    bench.spin_until(
        lambda: len({m.status[0].name for m in seen.diagnostics}) == 3, "reports"
    )
    assert observer.call(
        SetBool, "world_simulator/pause", SetBool.Request(data=True)
    ).success
    bench.spin_until(lambda: world.lockstep.complete, "barrier complete")
    newest = round(world.lockstep.world.step * PERIOD * 1e9)
    arrived = dict(zip(NAMES, world.lockstep.world.arrived, strict=True))
    acting = [seen.actions[name] for name in NAMES if not arrived[name]]
    bench.spin_until(
        lambda: all(ns(m[-1].header.stamp) == newest for m in acting),
        "last actions",
    )
    seen.world = world
    seen.robots = robots
    seen.run = run_from_yaml(world.run.to_yaml(), where="here")
    return seen


def ns(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def xy(pose):
    return (pose.position.x, pose.position.y)


@pytest.mark.parametrize("topic", TOPICS)
def test_topic_has_its_type_and_qos(team, topic):
    kind, kept = TOPICS[topic]
    name = team.observer.resolve_topic_name(topic)
    infos = team.observer.get_publishers_info_by_topic(name)
    assert {info.topic_type for info in infos} == {kind}
    assert len(infos) == (3 if topic == "diagnostics" else 1)
    wanted = DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE
    for info in infos:
        assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert info.qos_profile.durability == wanted


def test_no_other_topics(team):
    standard = {"/parameter_events", "/rosout"}
    names = {name for name, _ in team.observer.get_topic_names_and_types()}
    wanted = {team.observer.resolve_topic_name(topic) for topic in TOPICS}
    assert names == wanted | standard


def test_services(team):
    services = dict(team.observer.get_service_names_and_types())
    assert services["/world_simulator/pause"] == ["std_srvs/srv/SetBool"]
    assert services["/world_simulator/reset"] == ["std_srvs/srv/Trigger"]
    for name in NAMES:
        assert services[f"/{name}/active_perception"] == ["nav_msgs/srv/GetPlan"]
        assert services[f"/{name}/save"] == ["std_srvs/srv/Trigger"]
    for node in ("world_simulator", *NAMES):
        assert services[f"/{node}/set_parameters"] == [
            "rcl_interfaces/srv/SetParameters"
        ]


def test_nobody_reads_another_robots_topics(team):
    """A robot's knowledge of a peer comes from active_perception."""
    for name in NAMES:
        for topic in ROBOT:
            infos = team.observer.get_subscriptions_info_by_topic(f"/{name}/{topic}")
            assert {info.node_name for info in infos} <= {
                name,
                "world_simulator",
                "observer",
            }


def test_a_late_subscriber_gets_what_is_latched(team):
    late = team.bench.observer()
    got = {
        "run": late.listen(String, "run", latched=True),
        "status": late.listen(DiagnosticStatus, "status", latched=True),
        "map": late.listen(OccupancyGrid, "world_simulator/map", latched=True),
        "markers": late.listen(MarkerArray, "world_simulator/markers", latched=True),
        "coordination": late.listen(
            OccupancyGrid, "robot_1/coordination_map", latched=True
        ),
    }
    team.bench.spin_until(lambda: all(got.values()), "latched messages")
    assert run_from_yaml(got["run"][0].data, where="run") == team.run
    assert got["status"][0].message == "paused"
    assert got["status"][0].name == "env1"
    assert int(values_of(got["status"][0])["step"]) > 1
    info = got["map"][0].info
    assert (info.width, info.height, info.resolution) == (5, 5, RESOLUTION)
    assert got["map"][0].data.count(100) == 4
    assert {one.ns for one in got["markers"][0].markers} == {"doorways", "goals"}
    coordination = np.array(got["coordination"][0].data)
    assert set(coordination.tolist()) <= {-1, 0, 100}
    assert np.count_nonzero(coordination == -1) == 4


def test_diagnostics_come_from_everybody(team):
    by_name = {m.status[0].name: m.status[0] for m in team.diagnostics}
    assert set(by_name) == {
        "world_simulator: run",
        *(f"{name}: agent" for name in NAMES),
    }
    world = values_of(by_name["world_simulator: run"])
    assert world["budget"] == "2000"
    rates = [
        float(values_of(m.status[0])["steps_per_second"])
        for m in team.diagnostics
        if m.status[0].name == "world_simulator: run"
    ]
    assert max(rates) > 0
    assert world["timeouts"] == "0"
    robot = values_of(by_name["robot_1: agent"])
    assert int(robot["asks_answered"]) + int(robot["asks_refused"]) > 0
    assert robot["epsilon"] == "1.0000"
    assert robot["transitions_dropped"] == "0"


def ask(team, name, request):
    return team.observer.call(GetPlan, f"{name}/active_perception", request).plan


def test_a_person_gets_the_present_pose(team):
    for name in NAMES:
        plan = ask(team, name, GetPlan.Request())
        last = team.states[name][-1]
        assert [xy(stamped.pose) for stamped in plan.poses] == [xy(last.pose)]
        assert plan.header.stamp == last.header.stamp
        assert plan.header.frame_id == "map"


def request_of(team, asker, steps_ago=0, name=None):
    request = GetPlan.Request()
    request.start = team.states[asker][-1 - steps_ago]
    request.goal.header.frame_id = asker if name is None else name
    return request


def test_an_asker_that_is_no_robot_is_refused(team):
    plan = ask(team, "robot_1", request_of(team, "robot_2", name="robot_9"))
    assert not plan.poses


def test_pause_stops_and_resumes(team):
    """The team is paused; it makes one step a time with the pause lifted for it."""
    observer = team.observer
    bench = team.bench
    world = team.world
    status = observer.listen(DiagnosticStatus, "status", latched=True)
    bench.spin_until(lambda: status, "status")
    assert status[-1].message == "paused"
    transitions = world.lockstep.world.transitions
    before = len(team.diagnostics)
    bench.spin_until(
        lambda: len(team.diagnostics) >= before + 6, "two seconds of nothing"
    )
    assert world.lockstep.world.transitions == transitions
    response = observer.call(
        SetBool, "world_simulator/pause", SetBool.Request(data=False)
    )
    assert (response.success, response.message) == (True, "learning")
    bench.spin_until(lambda: status[-1].message == "learning", "status learning")
    bench.spin_until(
        lambda: world.lockstep.world.transitions > transitions, "it goes on"
    )
    response = observer.call(
        SetBool, "world_simulator/pause", SetBool.Request(data=True)
    )
    assert (response.success, response.message) == (True, "paused")


def test_save_writes_the_tables(team):
    path = robot_file(team.out, "robot_1")
    response = team.observer.call(Trigger, "robot_1/save")
    assert response.success
    assert str(path) in response.message
    saved = load_saved(path, [1])[0].memory
    assert memories_equal(saved, team.robots[0].lockstep.agent.memory())
    assert np.count_nonzero(saved["q_star"]) > 0
    assert not robot_file(team.out, "robot_2").exists()


RVIZ_READS = {
    "rviz_default_plugins/Map": OccupancyGrid,
    "rviz_default_plugins/MarkerArray": MarkerArray,
    "rviz_default_plugins/Pose": PoseStamped,
}
"""The subscriptions of RViz's displays (rviz_default_plugins/plugins_description.xml)."""


def displays(part):
    for one in part.get("Displays", []):
        yield one
        yield from displays(one)


def headers(message):
    return [m.header for m in getattr(message, "markers", [message])]


def test_rviz_gets_what_its_file_subscribes_to(team):
    """Every display gets a message, by its QoS, in the fixed frame, with the namespaces it names.

    Other QoS than the publisher's would match nobody; a namespace that is not listed is shown all
    the same, one that is listed and never comes is a slip.
    """
    manager = yaml.safe_load(share_file("rviz", "team.rviz").read_text())[
        "Visualization Manager"
    ]
    frame = manager["Global Options"]["Fixed Frame"]
    assert manager["Views"]["Current"]["Target Frame"] == frame
    rviz = team.bench.observer()
    got = {}
    for display in displays(manager):
        kind = RVIZ_READS.get(display["Class"])
        if kind is None:
            assert display["Class"] in ("rviz_common/Group", "rviz_default_plugins/TF")
            continue
        if kind is PoseStamped:  # not latched, and the team is paused
            continue
        wanted = display["Topic"]
        qos = QoSProfile(
            depth=wanted["Depth"],
            history=HistoryPolicy[wanted["History Policy"].upper().replace(" ", "_")],
            reliability=ReliabilityPolicy[wanted["Reliability Policy"].upper()],
            durability=DurabilityPolicy[
                wanted["Durability Policy"].upper().replace(" ", "_")
            ],
        )
        found = got[display["Name"]] = []
        rviz.create_subscription(
            kind, wanted["Value"], lambda m, found=found: found.append(m), qos
        )
    team.bench.spin_until(lambda: all(got.values()), "a message for every display")
    for display in displays(manager):
        for message in got.get(display["Name"], []):
            assert {header.frame_id for header in headers(message)} == {frame}
            if "Namespaces" in display:
                assert {m.ns for m in message.markers} == set(display["Namespaces"])
    shown = {
        display["Topic"]["Value"] for display in displays(manager) if "Topic" in display
    }
    assert shown == {
        *(f"/world_simulator/{shown}" for shown in ("map", "markers", "scene")),
        *(f"/{n}/coordination_map" for n in NAMES),
        *(f"/{n}/local_state" for n in NAMES),
    }


def panels(tree):
    if isinstance(tree, str):
        return [tree]
    assert set(tree) == {"direction", "first", "second", "splitPercentage"}
    assert tree["direction"] in ("row", "column") and 0 < tree["splitPercentage"] < 100
    return panels(tree["first"]) + panels(tree["second"])


def test_foxglove_finds_what_its_layout_names(team):
    """Topics, their types and frames, and the numbers that are plotted, in a running team."""
    layout = json.loads(share_file("foxglove", "team.json").read_text())
    assert json.loads(foxglove_layout(NAMES, "")) == layout
    keys = {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    assert set(layout) == keys
    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])
    types = {name: kinds for name, kinds in team.observer.get_topic_names_and_types()}
    shows = {"3D": [], "Plot": [], "DiagnosticSummary": []}
    for name, config in layout["configById"].items():
        shows[name.partition("!")[0]].append(config)
    drawable = {"nav_msgs/msg/OccupancyGrid": OccupancyGrid}
    drawable["visualization_msgs/msg/MarkerArray"] = MarkerArray
    drawable["geometry_msgs/msg/PoseStamped"] = PoseStamped
    got = {}
    for scene in shows["3D"]:
        # fmt: skip
        assert set(scene["topics"]) == {
            *(f"/world_simulator/{shown}" for shown in ("map", "markers", "scene")),
            *(f"/{n}/coordination_map" for n in NAMES),
            *(f"/{n}/local_state" for n in NAMES),
        }
        for topic in scene["topics"]:
            [kind] = types[topic]
            if drawable[kind] is not PoseStamped:  # the team is paused
                got[topic] = team.observer.listen(drawable[kind], topic, latched=True)
        team.bench.spin_until(lambda: all(got.values()), "all that is drawn")
        for messages in got.values():
            frames = {h.frame_id for message in messages for h in headers(message)}
            assert frames == {scene["followTf"]}
    heard = {f"/{n}/action": team.actions[n] for n in NAMES}
    heard |= {f"/{n}/reward": team.rewards[n] for n in NAMES}
    plotted = set()
    for path in (path for plot in shows["Plot"] for path in plot["paths"]):
        topic, _, field = path["value"].rpartition(".")
        assert types[topic] == ["sensor_msgs/msg/JointState"]
        name, place = field.removesuffix("]").split("[")
        message = heard[topic][-1]
        assert np.isfinite(getattr(message, name)[int(place)])
        plotted.add((topic, message.name[int(place)]))
        assert path["label"] == topic.split("/")[1]
        assert path["color"].upper() == robot_colour(NAMES.index(path["label"]))
    wanted = {f"/{n}/reward": "total" for n in NAMES} | {
        f"/{n}/action": "coordinate" for n in NAMES
    }
    assert plotted == set(wanted.items())
    for summary in shows["DiagnosticSummary"]:
        assert types[summary["topicToRender"]] == [
            "diagnostic_msgs/msg/DiagnosticArray"
        ]


def test_a_recorder_gets_what_is_kept_for_late_subscribers():
    for topic in (ros_topics.RUN, ros_topics.TABLES, ros_topics.ACTION):
        assert ros_topics.recorder_qos(topic).durability == topic.qos.durability


def test_step_makes_one_step_and_holds(bench):
    """In a running team."""
    observer = bench.observer()
    world = bench.world(rate=50.0)
    bench.robots()
    status = observer.listen(DiagnosticStatus, "status", latched=True)
    bench.spin_until(lambda: world.lockstep.world.transitions > 3, "under way")
    bench.spin_until(lambda: world.lockstep.complete, "all have acted")
    before = world.lockstep.world.transitions
    while not observer.call(Trigger, "world_simulator/step").success:
        pass
    made = world.lockstep.world.transitions
    assert made > before
    bench.spin_until(lambda: status and status[-1].message == "paused", "it is said")
    beats = []
    timer = observer.create_timer(0.05, lambda: beats.append(True))
    bench.spin_until(lambda: len(beats) >= 6, "time passes")
    observer.destroy_timer(timer)
    assert world.lockstep.world.transitions == made
    said = observer.call(Trigger, "world_simulator/step")
    assert (said.success, said.message) == (True, f"paused after {made + 1} steps")
    assert world.lockstep.world.transitions == made + 1


def test_a_finished_run_has_no_new_episode(bench):
    observer = bench.observer()
    world = bench.world(steps=20)
    bench.robots()
    bench.spin_until(lambda: world.done, "finished")
    episode = world.lockstep.world.episode
    for service in ("reset", "step"):
        said = observer.call(Trigger, f"world_simulator/{service}")
        assert not said.success and said.message.startswith("the run is not under way")
    assert world.lockstep.world.episode == episode


def test_a_robot_names_the_folder_of_its_tables(team, capfd):
    """The team's tables are joined at the end: the robot's own file is gone then."""
    [robot, *_] = team.robots
    capfd.readouterr()
    robot.finish(interrupted=True)
    said = capfd.readouterr().err
    where = robot.values["out"]
    assert f"saved its tables in {where}\n" in said
    assert ".npz" not in said
