# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each parameter of a node does what its help says, whatever legal value it has.

`test_driver_effects.py` has the settings of drivers, `test_setting_effects.py` those of scenarios.
"""

import re
import time
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import pytest
from domains import ros_domain
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from hypothesis import given, settings
from hypothesis import strategies as st

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.game.actions import EAST, SOUTH
from sparse_coord_ros.core.game.plugins import allowed
from sparse_coord_ros.core.game.scenario import load_scenario, scenario_names
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.learners.registry import LEARNERS
from sparse_coord_ros.core.runs.run_config import load_run, make_run
from sparse_coord_ros.protocol.lockstep.bodies import BodyGoal, GoalReport, Goals
from sparse_coord_ros.protocol.lockstep.world_states import State
from sparse_coord_ros.protocol.wire import RECORDER
from sparse_coord_ros.ros.driving import nav2_stand_in
from sparse_coord_ros.ros.driving.body import BodyNode
from sparse_coord_ros.ros.driving.driver import CmdVelDriverNode
from sparse_coord_ros.ros.nodes import (
    parameters,
    player,
    world_simulator,
    world_topics,
)
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, ParameterNode
from sparse_coord_ros.ros.nodes.recorder import Recorder
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.transforms import robot_frame

from .puppet import puppet
from .test_player import write_bag

TESTS = Path(__file__).parents[1]
LIVE = sorted(name for name, one in LEARNERS.registered.items() if one.runs_live)
SECONDS = st.floats(0.5, 20)
ENV1 = make_run(load_scenario("env1"), {})


@pytest.fixture(scope="module")
def make():
    """Return a function that makes a node for the time of a `with`."""
    with ros_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        with ros_context() as context:

            @contextmanager
            def node(kind, *arguments, **values):
                made = kind(*arguments, context=context, values=values)
                try:
                    yield made
                finally:
                    made.destroy_node()

            yield node


@contextmanager
def world_of(make, **values):
    """Make a world of env1 whose time passes only with `world.later`."""
    clock = SimpleNamespace(now=100.0)
    with pytest.MonkeyPatch.context() as patch:
        for module in (parameters, world_simulator, world_topics):
            ticking = SimpleNamespace(monotonic=lambda: clock.now, time_ns=time.time_ns)
            patch.setattr(module, "time", ticking)
        values = {"scenario": "env1", **values}
        with make(puppet(world_simulator.WorldSimulator), **values) as world:

            def later(seconds):
                clock.now += seconds
                world.tick()

            world.later = later
            yield world


@contextmanager
def waiting_world(make, **values):
    """Make a world under way that waits for its second robot."""
    with world_of(make, **values) as world:
        world.later(2.0)
        world.state = State.RUNNING
        world.lockstep.start()
        world.topics.gone = lambda robots: False
        world.lockstep.action(
            0, world.lockstep.world.step, Action(SOUTH, False, -1, False)
        )
        yield world


def scenario(make, value):
    with world_of(make, scenario=value) as world:
        assert world.run.scenario.name == value


def world_out(make, value):
    with (
        TemporaryDirectory() as folder,
        world_of(make, out=f"{folder}/{value}") as world,
    ):
        world.later(2.0)
        assert load_run(Path(folder) / value).id == world.run.id


def recorder_out(make, value):
    with (
        TemporaryDirectory() as folder,
        make(Recorder, out=f"{folder}/{value}") as node,
    ):
        assert node.directory == Path(folder) / value


def lost_robot(make, value):
    with waiting_world(make, lost_robot=value, step_timeout=1.0) as world:
        ended = False
        for _ in range(30):
            try:
                world.later(0.1)
            except RunError:
                ended = True
        assert world.lockstep.timeouts == (value == "go_on")
        assert ended == (value == "end")


def step_timeout(make, value):
    with waiting_world(make, step_timeout=value) as world:
        waited = 0.0
        while world.lockstep.timeouts == 0 and waited < value + 1.0:
            world.later(0.1)
            waited += 0.1
    assert waited == pytest.approx(value, abs=0.15)


def body_timeout(make, value):
    with world_of(make, bodies=True, body_timeout=value) as world:
        bodies = world.bodies
        bodies.side.made((Action(SOUTH, False, -1, False),) * 2)
        for k in range(2):  # both are placed
            bodies.side.reached(GoalReport(k, 1, bodies.game.cells[k], True, 0.0, 0.0))
        assert bodies.side.waiting and not bodies.side.placing
        began = time.monotonic()
        bodies.look(began + 0.99 * value, held=False)
        assert bodies.side.failed == 0
        bodies.look(began + 1.01 * value + 0.1, held=False)
        assert bodies.side.failed > 0 and not bodies.side.waiting


def frame_prefix(make, value):
    for table in ("world_simulator", "driver", "nav2_driver", "body"):
        with make(ParameterNode, "node", PARAMETERS[table], frame_prefix=value) as node:
            assert (
                robot_frame(node, "robot_1", "base_link") == f"{value}robot_1/base_link"
            )


def seed(make, value):
    with world_of(make, seed=value) as world:
        assert world.run.seed == value


def learner(make, value):
    with world_of(make, learner=value) as world:
        assert world.run.learner == value


def greedy(make, value):
    with world_of(make, greedy=value) as world:
        assert world.doing == "waiting"
        world.later(2.0)
        world.state = State.RUNNING
        assert world.doing == ("acting greedily" if value else "learning")


def clock(make, value):
    with world_of(make, clock=value) as world:
        published = [publisher.topic_name for publisher in world.publishers]
        assert ("/clock" in published) == (value == "own")


def bodies(make, value):
    with world_of(make, bodies=value) as world:
        assert any("driver" in one for one in world_missing(world)) == value


def world_missing(world):
    """Return the nodes for which a world waits."""
    missing = list(world.topics.missing())
    return missing if world.bodies is None else missing + world.bodies.missing()


def slips(make, value):
    with world_of(make, bodies=True, slips=value, move_success=0.01) as world:
        game = world.bodies.game
        start = game.cells[0]
        end = int(ENV1.scenario.map.next_cell[start, EAST])
        assert game.wanted(0, EAST) == (start if value else end)


def recorded(make, value):
    with world_of(make, recorded=value) as world:
        assert (RECORDER in world.topics.missing()) == value


def driver_robot(make, value):
    with make(CmdVelDriverNode, robot=value) as node:
        published = [publisher.topic_name for publisher in node.publishers]
        assert f"/{value}/cmd_vel" in published


def base_frame(make, value):
    with make(CmdVelDriverNode, robot="robot_1", base_frame=value) as node:
        assert node.base_frame == value


def stamped(make, value):
    with make(CmdVelDriverNode, robot="robot_1", stamped=value) as node:
        [kind] = [
            p.msg_type for p in node.publishers if p.topic_name.endswith("cmd_vel")
        ]
        assert kind is (TwistStamped if value else Twist)


def map_frame(make, value):
    with make(puppet(CmdVelDriverNode), robot="robot_1", map_frame=value) as node:
        node.begin(ENV1)
        pose = PoseStamped()
        for frame in (f"{value}_too", value):
            pose.header.frame_id = frame
            assert node.driver.pose is None
            node.hear("robot_1/pose", pose)
        assert node.driver.pose is not None


def pose_timeout(make, value):
    values = {"robot": "robot_1", "pose_timeout": value}
    with make(puppet(CmdVelDriverNode), **values) as node:
        node.begin(ENV1)
        node.on_duty = True
        node.held = False
        pose = PoseStamped()
        pose.header.frame_id = "map"
        node.driver.take(Goals(1, 5, False, -9.0, (BodyGoal(0, 0, 4),)))
        node.hear("robot_1/pose", pose)
        lost = []
        node.driver.lose_sight = lost.append
        now = time.monotonic()
        node.go_on(now + 0.99 * value - 0.1)
        assert not lost
        node.go_on(now + 1.01 * value + 0.1)
        assert lost


def body_radius(make, value):
    with make(BodyNode, radius=value) as node:
        node.begin(ENV1)
        assert node.simulator.metric_map.radius == value


@contextmanager
def stand_in(make, **values):
    """Make simulated bases without Nav2's action."""

    class StandIn(puppet(nav2_stand_in.Nav2StandIn)):
        action = SimpleNamespace(Feedback=SimpleNamespace)

        def set_up(self):
            pass

    nothing = SimpleNamespace(destroy=lambda: None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nav2_stand_in, "ActionServer", lambda *_, **__: nothing)
        with make(StandIn, **values) as node:
            yield node


def bases(make, value):
    with stand_in(make, bases=value) as node:
        assert list(node.bases) == value


def places(make, value):
    names = [f"tb{k}" for k in range(len(value))]
    with stand_in(make, bases=names, places=[f"{x},{y}" for x, y in value]) as node:
        assert [base.pose[:2] for base in node.bases.values()] == value


def stand_in_speed(make, value):
    with stand_in(make, bases=["tb1"], speed=value) as node:
        goal = PoseStamped()
        goal.pose.position.x = 1e6
        feedback = SimpleNamespace(
            publish_feedback=lambda _: None, is_cancel_requested=False
        )
        handle = SimpleNamespace(request=SimpleNamespace(pose=goal), **vars(feedback))
        node.bases["tb1"].execute(handle).send(None)
        for _ in range(10):
            node.tick()
        driven = node.bases["tb1"].pose.x
        assert driven == pytest.approx(10 * value * nav2_stand_in.SIMULATION_SECONDS)


@contextmanager
def player_of(make, **values):
    """Make a player of a short bag; yield it and what its `Playback` was told."""
    told = {}

    def playback(*_, **how):
        told.update(how)

    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(player, "Playback", playback)
        bag = write_bag(Path(folder) / "bag")
        with make(player.Player, bag=str(bag), **values) as node:
            yield node, told


def bag(make, value):
    with TemporaryDirectory() as folder:
        bag = write_bag(Path(folder) / value)
        with make(player.Player, bag=str(bag)) as node:
            assert node.played.bag.path == bag / f"{value}_0.mcap"


def played(name):
    """Return the check that `Playback`, which test_playlist.py tests, is told a value."""

    def check(make, value):
        parameter, key = name
        with player_of(make, **{parameter: value}) as (_, told):
            assert told[key] == value

    return check


def wait(make, value):
    with player_of(make, wait=value) as (_, told):
        assert ("on_gap" in told) != value  # else it jumps over gaps


def allow(make, value):
    for table in PARAMETERS.values():
        if "allow" in table:
            with make(ParameterNode, "node", table, allow=value):
                assert set(value) <= set(allowed())


NAMES = st.from_regex(r"[a-z]{1,8}", fullmatch=True)
LEGAL = {
    "world_simulator scenario": (scenario, st.sampled_from(scenario_names())),
    "world_simulator out": (world_out, NAMES),
    "world_simulator lost_robot": (
        lost_robot,
        st.sampled_from(["go_on", "wait", "end"]),
    ),
    "world_simulator body_timeout": (body_timeout, SECONDS),
    "world_simulator frame_prefix": (frame_prefix, NAMES.map("{}/".format)),
    "world_simulator seed": (seed, st.integers(0, 2**63 - 1)),
    "world_simulator learner": (learner, st.sampled_from(LIVE)),
    "world_simulator greedy": (greedy, st.booleans()),
    "world_simulator clock": (clock, st.sampled_from(["own", "none"])),
    "world_simulator step_timeout": (step_timeout, SECONDS),
    "world_simulator bodies": (bodies, st.booleans()),
    "world_simulator slips": (slips, st.booleans()),
    "world_simulator recorded": (recorded, st.booleans()),
    "world_simulator allow": (allow, st.lists(NAMES, min_size=1, max_size=3)),
    "recorder out": (recorder_out, NAMES),
    "driver robot": (driver_robot, NAMES),
    "driver base_frame": (base_frame, NAMES),
    "driver map_frame": (map_frame, NAMES),
    "driver pose_timeout": (pose_timeout, SECONDS),
    "driver stamped": (stamped, st.booleans()),
    "body radius": (body_radius, st.floats(0.05, 0.4)),
    "nav2_stand_in bases": (
        bases,
        st.lists(NAMES, min_size=1, max_size=3, unique=True),
    ),
    "nav2_stand_in places": (
        places,
        st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=3),
    ),
    "nav2_stand_in speed": (stand_in_speed, st.floats(0.001, 100)),
    "player bag": (bag, NAMES),
    "player rate": (played(("rate", "rate")), st.floats(0.01, 1000)),
    "player loop": (played(("loop", "loop")), st.booleans()),
    "player start_paused": (played(("start_paused", "paused")), st.booleans()),
    "player wait": (wait, st.booleans()),
}
"""For each parameter the check of its effect, and some of its legal values."""

SAME = {
    "frame_prefix": "world_simulator frame_prefix",
    "allow": "world_simulator allow",
    **{
        name: f"driver {name}"
        for name in ("robot", "map_frame", "base_frame", "pose_timeout")
    },
}
"""Parameters that mean the same in each node that has them, and are checked in one."""

ELSEWHERE = {
    "world_simulator rate": "nodes/test_rates.py: forty_rates",
    "world_simulator tables": "nodes/test_startup.py: learning_goes_on_from_tables",
    "world_simulator checkpoint": "lockstep/test_world.py: the_world_saves_at_each_step",
    "robot out": "nodes/test_interface.py: a_robot_names_the_folder_of_its_tables",
    "driver pose_type": "nodes/test_bodies.py: poses_of_other_types",
    "driver radius": "driving/test_driver_effects.py: a_setting_does_what_its_help_says",
    "driver speed": "driving/test_driver_effects.py: a_setting_does_what_its_help_says",
    "driver turn": "driving/test_driver_effects.py: a_setting_does_what_its_help_says",
    "driver near": "driving/test_driver_effects.py: a_setting_does_what_its_help_says",
    "driver step_seconds": "driving/test_driver_effects.py: a_setting_does_what_its_help_says",
    "nav2_driver pose_type": "nodes/test_nav2.py: with_transforms_for_poses",
    "nav2_driver action": "nodes/test_nav2.py: learning_goes_on_in_steps_of_seconds",
    "nav2_driver radius": "driving/test_driver_effects.py: a_setting_does_what_its_help_says",
    "nav2_driver near": "driving/test_nav2_driver.py: a_body_within_near_has_arrived",
    "nav2_driver step_seconds": "driving/test_nav2_driver.py: a_move_lasts_so_many_seconds",
    "body body_rate": "nodes/test_bodies.py: a_body_simulates_so_many_seconds_a_second",
    "player position": "nodes/test_player.py: a_start_in_the_middle_and_a_loop",
    "watch host": "nodes/test_watch.py: a_page_beside_a_live_team",
    "watch port": "nodes/test_watch.py: a_page_beside_a_live_team",
}
"""Parameters whose effect another test shows, by its file and the beginning of its name."""


@pytest.mark.parametrize(
    "parameter",
    [f"{node} {name}" for node, table in PARAMETERS.items() for name in table],
)
def test_no_parameter_is_forgotten(parameter):
    _, name = parameter.split()
    if parameter in LEGAL or SAME.get(name) in LEGAL:
        return
    file, test = ELSEWHERE[parameter].split(": ")
    assert re.search(f"^def test_{test}", (TESTS / file).read_text(), re.MULTILINE)


@pytest.mark.parametrize("parameter", LEGAL)
@settings(max_examples=4)
@given(data=st.data())
def test_a_parameter_does_what_its_help_says(make, parameter, data):
    check, values = LEGAL[parameter]
    check(make, data.draw(values))
