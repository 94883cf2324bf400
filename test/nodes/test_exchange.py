# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots exchange what they learned, once, and plan on it; the log shows it."""

import base64
from types import SimpleNamespace

import numpy as np
import pytest
from std_srvs.srv import Trigger
from teams import tables_in

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.engine.improve import improve
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.learners.tables import tables_equal
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.runs.tables import pack_tables, unpack_saved
from sparse_coord_ros.log.runlog import improved, verify
from sparse_coord_ros.ros.nodes.exchange import TICK_SECONDS, Exchange
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
    assert found.same and found.kept == 0
    real = improved.improve
    backwards = lambda scenario, rule, known: real(scenario, rule, known[::-1])  # noqa: E731
    monkeypatch.setattr(improved, "improve", backwards)
    odd = verify(out / "bag").differences
    assert [one.quantity.split()[0] for one in odd] == [
        f"improved/robot_{k}.npz" for k in (1, 2)
    ]


def test_a_robot_keeps_its_tables_where_a_peer_says_nothing(
    tmp_path, monkeypatch, capfd
):
    def silent(self, request, response):
        if self._number == 1:
            return response
        return answer(self, request, response)

    answer = Exchange._answer
    monkeypatch.setattr(Exchange, "_answer", silent)
    out = tmp_path / "out"
    with ros_context() as context:
        run_team(values(out, step_timeout=0.6, percept_timeout=0.5), context=context)
    assert "robot_2 did not say what was learned" in capfd.readouterr().err
    learned = tables_in(out)
    plan = tables_in(out / "improved")
    assert tables_equal(plan[:1], learned[:1]) and not tables_equal(
        plan[1:], learned[1:]
    )
    found = verify(out / "bag")
    assert found.cannot_tell and found.kept == 1
    [why] = found.broke_off
    assert why.startswith(
        "robot_1 kept what it had learned, as where a peer does not say"
    )


def test_a_learning_robot_says_nothing_and_one_that_has_learned_all(bench):
    observer = bench.observer()
    world = bench.world(learner="factored", improve=True, rate=0.001)
    robots = bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    said = observer.call(Trigger, "robot_1/learned")
    assert (said.success, said.message) == (False, "it is still learning")
    robots[0].member._exchange.over()
    said = observer.call(Trigger, "robot_1/learned")
    [saved] = unpack_saved(base64.b64decode(said.message), [1], where="said")
    assert said.success and saved.memory is not None


def test_an_answer_that_is_none_is_not_used(bench):
    world = bench.world(learner="factored", improve=True, rate=0.001)
    robots = bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    mine = robots[0].member._exchange
    for text in ("nonsense!", base64.b64encode(b"no archive").decode()):
        future = type("Answer", (), {"result": lambda _, text=text: response(text)})()
        mine._take(1, future)
        assert 1 not in mine._learned
    assert robots[0].subscriber.total == 2
    learning = response("it is still learning", success=False)
    mine._take(1, SimpleNamespace(result=lambda: learning))
    assert 1 not in mine._learned
    assert robots[0].subscriber.total == 2, (
        "it does not know all yet: nothing is wrong with that"
    )


def test_what_no_robot_can_have_learned_is_not_used(bench):
    """Of a stranger, or of a peer of another version: nobody plans on it."""
    world = bench.world(learner="factored", improve=True, rate=0.001)
    robots = bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    mine, peer = (robot.member._exchange for robot in robots)
    peer.over()
    real = Trigger.Response()
    peer._answer(Trigger.Request(), real)
    [saved] = unpack_saved(base64.b64decode(real.message), [2], where="said")
    false = {**saved.memory, "q_star": saved.memory["q_star"] * np.inf}
    data = pack_tables({2: false}, counts=saved.counts)
    future = SimpleNamespace(result=lambda: response(base64.b64encode(data).decode()))
    mine._take(1, future)
    assert 1 not in mine._learned and robots[0].subscriber.total == 1
    mine._take(1, SimpleNamespace(result=lambda: real))
    assert mine._learned[1] == base64.b64decode(real.message)


def test_a_second_server_of_what_was_learned_is_told(bench, capfd):
    world = bench.world(learner="factored", improve=True, rate=0.001)
    bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    stranger = bench.observer()
    stranger.create_service(Trigger, "robot_2/learned", lambda _, response: response)

    def seen():
        world._guard.look()
        return world._guard.doubled

    bench.spin_until(seen, "the stranger is seen")
    assert world.summary()["services_of_two_servers"] == 1
    assert (
        "/robot_2/learned has 2 servers, /observer, /robot_2; it"
        in capfd.readouterr().err
    )


def response(text, *, success=True):
    return Trigger.Response(success=success, message=text)


def test_who_cannot_improve(tmp_path):
    for wrong, words in (
        ({"learner": "coop"}, "learner coop keeps no model"),
        ({"greedy": True}, "a greedy run learns nothing"),
    ):
        with ros_context() as context, pytest.raises(SettingError, match=words):
            run_team(values(tmp_path / "out", **wrong), context=context)


def test_nobody_leaves_before_its_peers_have_asked(bench):
    """Nor before it knows all; and after `step_timeout` in any case."""
    world = bench.world(learner="factored", improve=True, rate=0.001, step_timeout=60.0)
    robots = bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    first, second = (robot.member._exchange for robot in robots)
    second._learned[1] = second._packed()  # it could answer, but does not ask yet
    bench.spin_until(lambda: first.over() or 1 in first._learned, "the first knows all")
    assert not first.over() and not first.over(), "the second has not asked it"
    bench.spin_until(
        lambda: second.over() or 0 in second._learned, "the second knows all"
    )
    assert first.over() and second.over()
    alone = Exchange(robots[0], world.run, first._packed)
    ticks = 0
    while not alone.over():
        ticks += 1
    assert 0 <= ticks * TICK_SECONDS - world.run.step_timeout <= 2 * TICK_SECONDS
