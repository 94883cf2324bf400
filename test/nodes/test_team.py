# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Services, perception and namespaces of teams that are started for one question each."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from live_teams import same_tables
from nav_msgs.srv import GetPlan
from rclpy.node import Node
from recordings import cell_pose
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from sparse_coord_ros.log.bags import open_bag
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.wire import services
from sparse_coord_ros.ros.nodes import world_simulator
from sparse_coord_ros.ros.nodes.ros_messages import messages_of
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team

NAMES = ("robot_1", "robot_2")
TEAM = {
    "run",
    "status",
    *(f"world_simulator/{shown}" for shown in ("map", "markers", "scene")),
}
ROBOT = {
    "local_state",
    "reward",
    "action",
    "percept",
    "coordination_map",
    "_progress",
    "tables",
}


def test_reset_begins_an_episode_and_nobody_learns_across_it(bench):
    observer = bench.observer()
    world = bench.world(rate=0.001)
    robots = bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    response = observer.call(Trigger, "world_simulator/reset")
    assert (response.success, response.message) == (True, "episode 2 begins")
    assert world.lockstep.world.step == 3, "two steps later"
    bench.spin_until(lambda: world.lockstep.complete, "new actions")
    assert world.lockstep.world.transitions == 0
    initial = world.lockstep.world.scenario.q_star_init
    for robot in robots:
        assert robot.lockstep.newest[0] == 3
        assert (robot.lockstep.agent.tables.q_star == initial).all()
    world.values["rate"] = 0.0
    bench.spin_until(lambda: world.lockstep.world.transitions > 20, "it goes on")
    assert all(
        (robot.lockstep.agent.tables.q_star != initial).any() for robot in robots
    )
    assert all(robot.lockstep.dropped == 0 for robot in robots)


def test_reset_and_save_say_why_they_cannot(bench):
    observer = bench.observer()
    bench.world()
    response = observer.call(Trigger, "world_simulator/reset")
    assert (response.success, response.message) == (False, "the run is not under way")
    response = observer.call(Trigger, "world_simulator/step")
    assert not response.success
    assert response.message == "paused; the run is not under way"
    bench.robot("robot_1")
    response = observer.call(Trigger, "robot_1/save")
    assert not response.success
    assert response.message == "the run has not begun: nothing can be saved"


def test_a_step_that_waits_for_a_robot_names_it(bench):
    observer = bench.observer()
    world = bench.world(rate=0.001)
    first, _ = bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    bench.destroy(first)
    assert observer.call(Trigger, "world_simulator/step").success
    bench.spin_until(lambda: world.lockstep.missing() == [0], "the other has acted")
    response = observer.call(Trigger, "world_simulator/step")
    assert not response.success
    assert response.message == "paused; waits for the action of robot_1: call again"


def test_a_peer_is_answered_where_it_is_on_the_map(bench):
    observer = bench.observer()
    world = bench.world(perception="always", rate=0.001)
    bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    present = cell_pose(messages_of(world.run), 1, world.lockstep.world.cells[1])
    request = GetPlan.Request(start=present)
    request.goal.header.frame_id = "robot_2"
    plan = observer.call(GetPlan, "robot_1/active_perception", request).plan
    assert len(plan.poses) == 1
    assert plan.header.stamp == present.header.stamp
    request.start.pose.position.x = -1.0
    plan = observer.call(GetPlan, "robot_1/active_perception", request).plan
    assert not plan.poses, "an asker outside the map perceives nothing"


def test_a_namespace_moves_everything(bench):
    observer = bench.observer("team_a")
    said = observer.listen(DiagnosticArray, "/diagnostics")
    world = bench.world(namespace="team_a", rate=0.001)
    for name in NAMES:
        bench.robot(name, namespace="team_a")
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    own = TEAM | {f"{name}/{topic}" for name in NAMES for topic in ROBOT}
    wanted = {"/diagnostics"} | {f"/team_a/{topic}" for topic in own}

    def there():
        return {name for name, _ in observer.get_topic_names_and_types()}

    bench.spin_until(lambda: wanted <= there(), "topics")
    assert there() - {"/rosout", "/parameter_events"} == wanted
    names = {
        "team_a/world_simulator: run",
        *(f"team_a/{name}: agent" for name in NAMES),
    }
    bench.spin_until(
        lambda: {m.status[0].name for m in said} == names, "diagnostics of everybody"
    )
    plan = observer.call(GetPlan, "robot_1/active_perception").plan
    assert len(plan.poses) == 1
    assert observer.call(
        SetBool, "world_simulator/pause", SetBool.Request(data=True)
    ).success


def test_in_one_process_an_answer_reaches_one_client(own_domain, tmp_path):
    """Not one of each robot: the cost of a question would grow with the team."""
    clients = []
    with ros_context() as context:
        probe = Node("probe", context=context)

        def look():
            clients.append(
                probe.count_clients(services.ACTIVE_PERCEPTION.of("robot_1"))
            )
            return False

        values = {"scenario": "crowd-3r", "steps": 60, "record": False}
        summary = run_team(
            {**values, "out": str(tmp_path / "run")}, context=context, stop=look
        )
        probe.destroy_node()
    assert summary["timeouts"] == 0
    assert max(clients) == 1


def test_a_bystander_is_no_robot(bench):
    """Whoever listens to a robot's topics lets the world begin too soon; nothing is lost by it."""
    observer = bench.observer()
    for name in NAMES:
        observer.listen(JointState, f"{name}/reward")
        observer.listen(PoseStamped, f"{name}/local_state")
    world = bench.world(steps=10, rate=20.0)
    bench.spin_until(lambda: observer.count("robot_2/local_state"), "world found")
    assert observer.call(
        SetBool, "world_simulator/pause", SetBool.Request(data=True)
    ).success
    bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier while paused")
    assert observer.call(
        SetBool, "world_simulator/pause", SetBool.Request(data=False)
    ).success
    bench.spin_until_done()
    assert world.summary()["timeouts"] == 0


@pytest.mark.long
def test_diagnostics_of_other_programs_do_not_move_the_time_of_the_log(bench, tmp_path):
    """Drivers stamp them with the wall clock; a stamp may even be negative."""
    observer = bench.observer()
    others = observer.create_publisher(DiagnosticArray, "diagnostics", 10)
    world = bench.world(steps=200, rate=400.0, recorded=True)
    recorder = bench.recorder(tmp_path / "bag")
    bench.robots()
    bench.spin_until(
        lambda: world.lockstep.world.transitions > 20, "the run is under way"
    )
    for seconds in (-1, 1_700_000_000):
        message = DiagnosticArray(status=[DiagnosticStatus(name="driver: wheels")])
        message.header.stamp.sec = seconds
        others.publish(message)
    bench.spin_until_done()
    assert recorder.error is None
    bag = open_bag(tmp_path / "bag")
    assert bag.end_ns < 100 * 1_000_000_000
    stamps = {m.data[4:8] for m in bag.messages(["/diagnostics"])}
    assert (-1).to_bytes(4, "little", signed=True) in stamps
    assert verify(tmp_path / "bag").same


def test_progress_is_told_every_few_seconds_and_at_the_end(bench, capfd, monkeypatch):
    monkeypatch.setattr(world_simulator, "REPORT_SECONDS", 0.0)
    bench.world(steps=600)
    bench.robots()
    bench.spin_until_done()
    assert capfd.readouterr().err.count(" of 600 steps, ") == 2


def test_the_executable_runs_a_team(start, tmp_path):
    out = tmp_path / "out"
    given = {"scenario": "env1", "steps": 60, "record": "false", "out": out}
    words = [word for name, v in given.items() for word in ("-p", f"{name}:={v}")]
    process = start("nodes.team", "--ros-args", *words)
    assert process.exit_code() == 0, process.output
    assert same_tables(out)
