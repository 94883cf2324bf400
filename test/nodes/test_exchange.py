# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots exchange what they learned, once, and plan on it; the log shows it."""

import base64

import numpy as np
import pytest
from std_srvs.srv import Trigger
from teams import tables_in

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.core.engine.improve import improve
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.tables import tables_equal
from sparse_coord_ros.core.runs.run_config import load_run, make_run
from sparse_coord_ros.core.runs.tables import pack_tables
from sparse_coord_ros.log.runlog import improved, verify
from sparse_coord_ros.protocol.wire import COUNTS
from sparse_coord_ros.protocol.wire.services import LEARNED
from sparse_coord_ros.ros.nodes.exchange import AGAIN_TICKS, TICK_SECONDS, Exchange
from sparse_coord_ros.ros.nodes.robot import RobotNode
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team

pytestmark = pytest.mark.skipif(not has_numba(), reason="minutes in plain Python")


def values(out, **more):
    sets = ["steps=300", "penalty=-100"]
    base = {
        "scenario": "env1",
        "learner": "factored",
        "seed": 7,
        "set": sets,
        "improve": True,
    }
    return {**base, "out": str(out), "claim_window": 0.0, "record": True, **more}


def test_each_robot_plans_what_a_run_without_ros_plans_and_verify_again(
    tmp_path, monkeypatch
):
    out = tmp_path / "out"
    with ros_context() as context:
        run_team(values(out), context=context)
    run = load_run(out / "improved")
    assert run.improve
    done = train(run.scenario, "factored", 7)
    due = improve(run.scenario, done.learner, [table.memory for table in done.tables])
    assert tables_equal(tables_in(out), done.tables)
    assert tables_equal(tables_in(out / "improved"), list(due.tables))
    assert not list((out / "improved").glob("tables_*"))
    found = verify(out / "bag")
    assert found.same
    real = improved.improve
    backwards = lambda scenario, rule, known: real(scenario, rule, known[::-1])  # noqa: E731
    monkeypatch.setattr(improved, "improve", backwards)
    odd = verify(out / "bag").differences
    assert [one.quantity.split()[0] for one in odd] == [
        f"improved/robot_{k}.npz" for k in (1, 2)
    ]


class Silent(RobotNode):
    """Robots; robot_2 does not send its memory."""

    def create_service(self, kind, name, answer, **more):
        def say_nothing(request, response):
            return response

        silent = (self.get_name(), name) == ("robot_2", LEARNED.of("~"))
        answer = say_nothing if silent else answer
        return super().create_service(kind, name, answer, **more)


def test_a_robot_keeps_its_tables_where_a_peer_says_nothing(
    tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr("sparse_coord_ros.ros.nodes.team.RobotNode", Silent)
    out = tmp_path / "out"
    with ros_context() as context:
        run_team(values(out, step_timeout=3.0, percept_timeout=1.0), context=context)
    assert "robot_2 did not share tables" in capfd.readouterr().err
    learned = tables_in(out)
    plan = tables_in(out / "improved")
    assert tables_equal(plan[:1], learned[:1]) and not tables_equal(
        plan[1:], learned[1:]
    )
    found = verify(out / "bag")
    [unknown] = found.unknown
    assert found.undecided
    assert unknown.why.startswith("robot_1 kept its own tables instead of a plan")


def test_a_second_server_of_what_was_learned_is_told(bench, capfd):
    world = bench.world(learner="factored", improve=True, rate=0.001)
    bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    stranger = bench.observer()
    stranger.create_service(Trigger, "robot_2/learned", lambda _, response: response)

    def seen():
        world.guard.look()
        return world.guard.doubled

    bench.spin_until(seen, "the stranger is seen")
    assert world.summary()["services_of_two_servers"] == 1
    assert (
        "/robot_2/learned has 2 servers, /observer, /robot_2; it"
        in capfd.readouterr().err
    )


# Without ROS.


class Asking:
    """The part of a robot's node for its exchange; its peers answer at once.

    Attributes:
        answer: its answer to its peers.
        dropped: the dropped messages.
    """

    def __init__(self, name):
        self.name = name
        self.shared_clients = {}
        self.subscriber = self
        self.answer = None
        self.dropped = []

    def get_name(self):
        return self.name

    def create_service(self, kind, name, answer):
        self.answer = answer

    def guarded(self, call):
        return call

    def drop(self, name, why, done):
        self.dropped.append(why)

    def says(self):
        """Return its answer to a peer."""
        return self.answer(Trigger.Request(), Trigger.Response())


class Client:
    """A client of a peer's memory.

    Args:
        says: returns the peer's answer.
    """

    def __init__(self, says):
        self.says = says

    def service_is_ready(self):
        return True

    def call_async(self, request):
        self.answer = self.says()
        return self

    def add_done_callback(self, then):
        then(self)

    def result(self):
        return self.answer


RUN = make_run(
    load_scenario("env1").with_settings({"steps": 300, "penalty": -100}),
    {
        "learner": "factored",
        "improve": True,
        "step_timeout": 3.0,
        "percept_timeout": 1.0,
    },
)


def learned(robot, change=None):
    """Return a robot's memory, packed; changed by `change`."""
    agent = Agent(RUN.rule, RUN.scenario, robot, 0)
    memory = agent.memory()
    if change is not None:
        memory = {**memory, **change(memory)}
    return pack_tables({robot + 1: memory}, counts=dict.fromkeys(COUNTS, 0))


def exchange(name):
    """Return a robot's part in the exchange, and its node."""
    node = Asking(name)
    number = RUN.scenario.names.index(name)
    return Exchange(node, RUN, lambda: learned(number)), node


def response(text, *, success=True):
    return Trigger.Response(success=success, message=text)


def in_base64(data):
    return base64.b64encode(data).decode()


def infinite(memory):
    """Return an impossible memory."""
    return {"q_star": memory["q_star"] * np.inf}


def test_a_robot_says_what_it_has_learned_once_it_has_learned_all():
    mine, node = exchange("robot_1")
    node.shared_clients[LEARNED.of("robot_2")] = Client(lambda: None)
    said = node.says()
    assert (said.success, said.message) == (False, "it is still learning")
    mine.over()
    said = node.says()
    assert said.success and base64.b64decode(said.message) == learned(0)


@pytest.mark.parametrize(
    ("said", "drops"),
    [
        (response("nonsense!"), True),
        (response(in_base64(b"no archive")), True),
        (response(in_base64(learned(1, infinite))), True),
        (response("it is still learning", success=False), False),
        (response(in_base64(learned(1))), False),
    ],
    ids=["no base64", "no archive", "cannot be learned", "not yet", "good"],
)
def test_only_what_a_robot_can_have_learned_is_used(said, drops):
    """A foreign node, or a peer of another version, may send any memory: no robot plans on it."""
    mine, node = exchange("robot_1")
    node.shared_clients[LEARNED.of("robot_2")] = Client(lambda: said)
    mine.over()
    node.says()  # its peer has asked it
    assert bool(node.dropped) == drops
    assert mine.over() == (said.success and not drops), "it knows all"


def test_nobody_leaves_before_its_peers_have_asked():
    """Nor before it has all memories."""
    first, node = exchange("robot_1")
    second, other = exchange("robot_2")
    node.shared_clients[LEARNED.of("robot_2")] = Client(other.says)
    other.shared_clients[LEARNED.of("robot_1")] = Client(node.says)
    assert not first.over(), "the second one is still learning"
    assert not second.over(), "it knows all, but nobody has asked it"
    for _ in range(AGAIN_TICKS):
        assert not (first.over() and second.over())
    assert first.over() and second.over()


def test_nobody_waits_longer_than_step_timeout():
    alone, node = exchange("robot_1")
    node.shared_clients[LEARNED.of("robot_2")] = Client(lambda: None)
    ticks = 0
    while not alone.over():
        ticks += 1
    assert 0 <= ticks * TICK_SECONDS - RUN.step_timeout <= 2 * TICK_SECONDS
