# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team that continues from its last common checkpoint: the tables of an unbroken run."""

import os
from types import SimpleNamespace

import pytest
from teams import plain_run

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.tables import memories_equal, tables_equal
from sparse_coord_ros.core.runs.run import learn
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep.node_checkpoints import (
    Checkpoints,
    CheckpointStore,
    steps_of,
)
from sparse_coord_ros.protocol.lockstep.rollback import RobotRollback, WorldRollback
from sparse_coord_ros.protocol.wire.status import NO_ROLLBACK, Order, Progress

from .team import WORLD, Team

CASES = [
    ("crowd-3r", "coop", {"perception": "probability:0.7", "peers": "all"}),
    ("env2-4r", "noncoop", {}),
    ("env1", "factored", {"perception": "line_of_sight"}),
    ("env1", "cq", {}),
]
"""Each learner that runs live."""


def problem(name, **settings):
    return load_scenario(name).with_settings(
        {"steps": 250, "max_steps": 30, **settings}
    )


def killed_everywhere(at):
    return [(at, Team.kill_all), (at, Team.resume_all)]


@pytest.mark.parametrize(("name", "learner", "settings"), CASES)
def test_the_bits_are_those_of_an_unbroken_run(name, learner, settings):
    scenario = problem(name, **settings)
    team = Team(scenario, 1, learner=learner, checkpoint=37)
    team.play([*killed_everywhere(700), *killed_everywhere(1100)])
    scenario = team.scenario  # with the learner's changes
    assert tables_equal(team.tables, learn(scenario, learner, 5))
    assert team.world.side.history.history().same_bits(history(scenario, learner))
    assert not team.disturbed
    whole = Team(scenario, 2, learner=learner).play()
    # the counts beside the tables are also those of an unbroken run
    for k in range(team.robots):
        mine, theirs = (one.up[k].side.counts for one in (team, whole))
        assert {**mine, "repeated": 0} == {**theirs, "repeated": 0}


def history(scenario, learner):
    learning = plain_run(scenario, learner, 5)
    learning.advance(scenario.steps)
    return learning.history


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("who", [0, 1, WORLD])
def test_whoever_dies_while_it_saves(who, when):
    scenario = problem("env1", perception="probability:0.7")
    team = Team(scenario, 3)
    team.up[who].store.killed = when
    team.play([(900, Team.kill_all), (900, Team.resume_all)])
    assert tables_equal(team.tables, learn(scenario, "coop", 5))


@pytest.mark.parametrize("every", (24, 36, 48))
def test_a_robot_comes_back_at_any_step(every):
    """Also if it had arrived and only answers, and receives the world long after its start."""
    scenario = problem("env1", perception="probability:0.7", epsilon="constant:1")
    team = Team(scenario, 4, checkpoint=every)
    team.play([(600, lambda t: t.kill(1)), (620, lambda t: t.start(1, resume=True))])
    assert (team.world.back.events["taken_back"], team.disturbed) == (1, False)
    assert tables_equal(team.tables, learn(scenario, "coop", 5))


@pytest.mark.parametrize("back", [330, 460])
def test_who_sleeps_while_the_team_goes_back_twice_learns_nothing_of_the_time_between(
    back,
):
    """In between the world continued without it, under the repeated time steps."""
    scenario = problem("env1")
    team = Team(scenario, 4, checkpoint=1000)
    robot = {"resume": True}
    faults = [(300, lambda t: t.asleep.add(0)), (310, lambda t: t.kill(1))]
    faults += [(320, lambda t: t.start(1, **robot)), (back + 1800, lambda t: t.kill(1))]
    faults += [
        (back + 1830, lambda t: t.start(1, **robot)),
        (4000, lambda t: t.asleep.clear()),
    ]
    team.play(faults)
    assert team.world.back.events["taken_back"] == 2
    team.check_updates()


def test_a_robot_that_begins_anew_is_counted():
    team = Team(problem("env1"), 4)
    team.play([(600, lambda t: t.kill(1)), (620, lambda t: t.start(1, resume=False))])
    assert team.world.back.events == {"replaced_robots": 1}
    assert not tables_equal(team.tables, learn(team.scenario, "coop", 5))


def test_a_robot_that_is_replaced_before_the_run_lost_nothing():
    back = WorldRollback(Team(problem("env1"), 4).world.side, CheckpointStore(), 2)
    for life in ("one", "another"):
        back.heard(0, Progress(life, 0, 0))
    assert back.events == {}


def test_a_robot_may_go_on_alone_from_its_own_checkpoint():
    team = Team(problem("env1"), 4, rolls_back=False)
    team.play([(600, lambda t: t.kill(1)), (620, lambda t: t.start(1, resume=True))])
    assert team.world.back.events == {"returned_robots": 1}
    team.check_updates()


def test_who_cannot_go_back_is_not_waited_for():
    """A robot comes back without checkpoints while an order stands."""
    side = SimpleNamespace(
        held=True,
        go_on_from=lambda state: None,
        world=SimpleNamespace(step=40, transitions=30),
    )
    store = SimpleNamespace(steps=lambda: [40, 0], load=lambda step: None, counted=dict)
    back = WorldRollback(side, store, 2)
    for k in range(2):
        back.heard(k, Progress(f"{k}", 50, 50, (40, 0)))
    back.go_back()
    back.heard(0, Progress("0", 40, 40, (40, 0), obeyed=back.order.name))
    assert back.waiting == {1}
    back.heard(1, Progress("another", 0, 0))
    assert not back.waiting


def test_a_robot_without_the_checkpoint_does_not_obey():
    back = RobotRollback(None, CheckpointStore(), None, "life", False)
    assert not back.obey(Order("an order", 40, 41))
    assert back.obey(Order("a call", NO_ROLLBACK))


def test_a_world_that_comes_back_finds_its_robots():
    scenario = problem("env1")
    team = Team(scenario, 4)
    team.play(
        [(600, lambda t: t.kill(WORLD)), (640, lambda t: t.start(WORLD, resume=True))]
    )
    assert tables_equal(team.tables, learn(scenario, "coop", 5))


def test_who_sleeps_through_the_order_obeys_when_it_wakes():
    team = Team(problem("env1", steps=600), 4)
    team.play(
        [
            (600, lambda t: t.asleep.add(0)),
            (601, lambda t: t.kill(1)),
            (620, lambda t: t.start(1, resume=True)),
            (6000, lambda t: t.asleep.discard(0)),
        ]
    )
    assert team.world.side.left_out > 0
    assert team.up[0].back.progress().obeyed
    team.check_updates()


# On disk.


@pytest.fixture
def run():
    return make_run(problem("env1"), {"seed": 5, "checkpoint": 40})


@pytest.fixture
def played():
    return Team(problem("env1"), 1).play()


def saved(out, run, played, steps=(40, 80)):
    stores = {}
    for k, name in enumerate(("robot_1", "robot_2")):
        stores[name] = Checkpoints(out, name, run)
        for step in steps:
            stores[name].save(played.up[k].side.snapshot()._replace(step=step))
    stores["world_simulator"] = Checkpoints(out, "world_simulator", run)
    for step in steps:
        stores["world_simulator"].save(played.world.side.snapshot(step))
    return stores


def test_a_file_gives_back_what_was_saved(tmp_path, run, played):
    stores = saved(tmp_path, run, played)
    world = stores["world_simulator"].load(80)
    state = played.world.side.snapshot(80)
    assert world[:-1] == state[:-1]
    assert world.history.same_bits(state.history)
    robot = stores["robot_2"].load(80)
    state = played.up[1].side.snapshot()
    assert robot[1:-1] == state[1:-1]
    assert memories_equal(robot.memory, state.memory)
    assert stores["robot_1"].load(0) is None


def test_what_was_counted_outlives_its_process_and_is_never_taken_back(
    tmp_path, run, played
):
    stores = saved(tmp_path, run, played)
    assert stores["robot_1"].counted() == {}
    stores["world_simulator"].count({"taken_back": 2, "messages_dropped": 7})
    for store in stores.values():
        store.close()
    again = Checkpoints(tmp_path, "world_simulator", run)
    assert again.counted() == {"taken_back": 2, "messages_dropped": 7}
    assert (again.steps(), again.broken) == ([80, 40, 0], [])
    assert WorldRollback(played.world.side, again, 2).events["taken_back"] == 2
    path = tmp_path / "checkpoint" / "world_simulator_events.npz"
    path.write_bytes(path.read_bytes()[:-20])
    assert again.counted() == {}
    assert "world_simulator_events.npz: what was counted is lost" in again.broken[0]
    Checkpoints.remove(tmp_path)
    assert not path.exists()


def test_old_files_go_but_never_a_common_one(tmp_path, run, played):
    stores = saved(tmp_path, run, played)
    for step in (120, 160, 200, 240):
        stores["robot_1"].save(played.up[0].side.snapshot()._replace(step=step))
    assert stores["robot_1"].steps() == [240, 200, 160, 80, 40, 0]
    assert steps_of(tmp_path / "checkpoint", "robot_2") == [80, 40]


@pytest.mark.parametrize(
    "damage", ["cut", "flipped", "empty", "robot_2_80", "robot_1_40"]
)
def test_a_broken_file_is_named_and_an_earlier_one_is_used(
    tmp_path, run, played, damage
):
    for store in saved(tmp_path, run, played).values():
        store.close()
    path = tmp_path / "checkpoint" / "robot_1_80.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    other = path.with_name(f"{damage}.npz")
    damages = {"cut": data[:300], "flipped": data, "empty": b""}
    path.write_bytes(other.read_bytes() if other.exists() else damages[damage])
    store = Checkpoints(tmp_path, "robot_1", run)
    assert store.steps() == [40, 0]
    assert store.steps() == [40, 0]
    (line,) = store.broken
    assert "robot_1_80.npz: cannot be read as a checkpoint" in line
    assert line.endswith("; an earlier one is used")
    assert not other.exists() or f"(it is that of {damage})" in line


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"seed": 6}, "another run"),
        ({"learner": "noncoop"}, "another run"),
        ({"penalty": -7}, "another run"),
        ({"format": 3}, "is in format 3"),
    ],
)
def test_another_run_or_format_is_refused(
    tmp_path, run, played, change, said, monkeypatch
):
    other = run
    if "format" in change:
        monkeypatch.setattr("sparse_coord_ros.base.npz.FORMAT", change["format"])
    for store in saved(tmp_path, run, played).values():
        store.close()
    monkeypatch.undo()
    if "penalty" in change:
        other = make_run(problem("env1", **change), {"seed": 5})
    elif "format" not in change:
        other = make_run(run.scenario, {"seed": 5, **change})
    with pytest.raises(RunError, match=said) as caught:
        Checkpoints(tmp_path, "robot_1", other).steps()
    assert "\n" not in str(caught.value)


def test_one_process_a_node(tmp_path, run):
    first = Checkpoints(tmp_path, "robot_1", run)
    Checkpoints(tmp_path, "robot_2", run)
    said = rf"another process runs robot_1 there \(process {os.getpid()}\)"
    with pytest.raises(RunError, match=said):
        Checkpoints(tmp_path, "robot_1", run)
    first.close()
    Checkpoints(tmp_path, "robot_1", run)


def test_a_directory_that_cannot_be_written(tmp_path, run):
    (tmp_path / "checkpoint").write_text("a file")
    with pytest.raises(FileExistsError, match=str(tmp_path / "checkpoint")):
        Checkpoints(tmp_path, "robot_1", run)


def test_a_checkpoint_does_not_depend_on_when_it_is_taken():
    """A robot at the barrier is still in the state of the step's beginning."""
    team = Team(problem("env1", steps=100), 7, checkpoint=1)
    team.play()
    states = team.disks[0]
    again = Team(problem("env1", steps=100), 8, checkpoint=1).play().disks[0]
    for step in set(states) & set(again):
        assert states[step][:5] == again[step][:5]
        assert memories_equal(states[step].memory, again[step].memory)
    assert len(set(states) & set(again)) >= 3


@pytest.mark.parametrize("together", [True, False])
def test_how_often_all_were_taken_back_is_counted(together):
    """A world that goes back alone takes nothing from its robots."""
    team = Team(problem("env1"), 4)
    back = WorldRollback(team.world.side, team.world.store, 2)
    for k in range(2):
        back.heard(k, Progress(f"{k}", 0, 0, (0,)))
    for _ in range(2):
        assert back.go_back(together=together)
    assert back.events["taken_back"] == 2 * together
    assert back.order.step == (0 if together else NO_ROLLBACK)


def heard_at(back, robot, step, **more):
    """Send the world a robot's progress: its step, and as many transitions."""
    back.heard(robot, Progress(f"life {robot}", step, step, (40, 0), **more))


def test_a_world_that_goes_on_alone_begins_where_no_robot_takes_it_for_its_next_step():
    """It may have received one state more than it has processed; from the next it would learn."""
    team = Team(problem("env1"), 4)
    side = team.world.side
    back = WorldRollback(team.world.side, team.world.store, 2)
    for robot, step in enumerate((17, 19)):
        heard_at(back, robot, step)
    assert back.go_back(together=False)
    assert not back.go_on()
    for robot, step in enumerate((17, 19)):
        heard_at(back, robot, step, obeyed=back.order.name)
    assert back.go_on()
    assert side.world.step > 19 + 1 + 1
    assert side.world.transitions == 19
    assert not side.held and back.order == Order()


def test_who_comes_back_while_an_order_stands_is_waited_for():
    team = Team(problem("env1"), 4)
    back = WorldRollback(team.world.side, team.world.store, 2)
    for robot in (0, 1):
        heard_at(back, robot, 50)
    back.go_back()
    for robot in (0, 1):
        heard_at(back, robot, 0, obeyed=back.order.name)
    assert not back.waiting
    back.heard(1, Progress("another life", 40, 40, (40, 0), resumed=True))
    assert back.waiting == {1}
    assert not back.go_on()
    assert back.go_on(anyway=True)
    order = back.order
    assert order.name and order.step == 0, "it still stands"
    back.heard(
        1, Progress("another life", 0, 0, (40, 0), obeyed=order.name, resumed=True)
    )
    assert back.order == Order()


def test_of_common_checkpoints_too_the_old_ones_go(tmp_path, run, played):
    stores = saved(tmp_path, run, played, steps=(40, 80, 120, 160, 200))
    world = stores["world_simulator"]
    for step in (240, 280, 320):
        stores["robot_1"].save(played.up[0].side.snapshot()._replace(step=step))
        stores["robot_2"].save(played.up[1].side.snapshot()._replace(step=step))
        world.save(played.world.side.snapshot(step))
    assert world.steps() == [320, 280, 240, 0]
    stores["robot_1"].save(played.up[0].side.snapshot()._replace(step=360))
    assert stores["robot_1"].steps() == [360, 320, 280, 0]
