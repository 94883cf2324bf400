# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team that continues from its last common checkpoint: the tables of an unbroken run."""

import math
import os
from types import SimpleNamespace

import pytest
from teams import learn, memories_equal, plain_run, same_bits, tables_equal

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep.attempts import (
    MOST_BEHIND,
    RobotAttempts,
    WorldAttempts,
)
from sparse_coord_ros.protocol.lockstep.node_checkpoints import (
    Checkpoints,
    CheckpointStore,
)
from sparse_coord_ros.protocol.wire import RECORDER
from sparse_coord_ros.protocol.wire.status import LEFT, NO_ATTEMPT, Order, Progress

from .team import WORLD, Team

CASES = [
    ("crowd-3r", "coop", {"perception": "probability:0.7", "peers": "all"}),
    ("env2-4r", "noncoop", {}),
    ("env1", "voi", {"perception": "line_of_sight"}),
    ("env2-4r", "voi", {"peers_seen": "while_learning"}),
    ("env1", "cq", {}),
    ("env1", "joint", {}),
    (
        "env1",
        "coop",
        {"perception": "probability:0.7", "peers_seen": "while_learning"},
    ),
]
"""Each learner that runs live, and robots that learn from the cells of their peers."""


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
    assert same_bits(team.world.side.history.so_far, history(scenario, learner))
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
    team.play([(400, Team.kill_all), (400, Team.resume_all)])
    assert tables_equal(team.tables, learn(scenario, "coop", 5))


@pytest.mark.parametrize("every", (24, 36, 48))
def test_a_robot_comes_back_at_any_step(every):
    """Also if it had arrived and only answers, and receives the world long after its start."""
    scenario = problem("env1", perception="probability:0.7", epsilon="constant:1")
    team = Team(scenario, 4, checkpoint=every)
    team.play([(600, lambda t: t.kill(1)), (620, lambda t: t.start(1))])
    assert (team.world.restarts, team.disturbed) == (1, False)
    assert tables_equal(team.tables, learn(scenario, "coop", 5))


@pytest.mark.parametrize("back", [330, 460])
def test_who_sleeps_while_the_team_goes_back_twice_learns_nothing_of_the_time_between(
    back,
):
    """In between the world continued without it, under the repeated time steps."""
    scenario = problem("env1")
    team = Team(scenario, 4, checkpoint=1000)
    faults = [(300, lambda t: t.asleep.add(0)), (310, lambda t: t.kill(1))]
    faults += [(320, lambda t: t.start(1)), (back + 1800, lambda t: t.kill(1))]
    faults += [
        (back + 1830, lambda t: t.start(1)),
        (4000, lambda t: t.asleep.clear()),
    ]
    team.play(faults)
    assert team.world.restarts == 2
    team.check_updates()


def test_before_the_second_checkpoint_a_run_can_begin_anew():
    scenario = problem("env1")
    team = Team(scenario, 4)

    def without_its_disk(team):
        team.disks[1].clear()
        team.start(1)

    team.play([(150, lambda t: t.kill(1)), (170, without_its_disk)])
    assert tables_equal(team.tables, learn(scenario, "coop", 5))


def attempts(steps, checkpoint=0, **said):
    """Return the attempts of a world with checkpoints; the nodes have said theirs."""
    side = SimpleNamespace(go_on_from=lambda state: None)
    forgotten = []
    store = SimpleNamespace(
        steps=lambda: steps, load=lambda step: None, forget_after=forgotten.append
    )
    made = WorldAttempts(side, store, list(said), checkpoint)
    for node, checkpoints in said.items():
        made.reports[node] = Progress(checkpoints)
    return made, forgotten


@pytest.mark.parametrize(
    ("steps", "said", "begins"),
    [
        ([80, 40, 0], {"robot_1": (80, 40, 0), "robot_2": (80, 40, 0)}, 80),
        ([80, 40, 0], {"robot_1": (80, 40, 0), "robot_2": (40, 0)}, 40),
        ([40, 0], {"robot_1": (0,), "robot_2": (40, 0)}, 0),
        ([80, 40, 0], {"robot_1": (), "robot_2": (80, 40, 0)}, 80),
        ([80, 40, 0], {"robot_1": (80, 40, 0), RECORDER: (40, 0)}, 40),
        ([120, 80, 40, 0], {"robot_1": (120, 80, 40, 0), RECORDER: (0,)}, 0),
        ([9000, 6000, 3000, 0], {"robot_1": (9000, 6000, 3000), RECORDER: (0,)}, 9000),
        ([80, 40, 0], {"robot_1": (80, 40, 0), RECORDER: ()}, 80),
    ],
    ids=[
        *("all", "one died while it saved", "the first one is missing"),
        *("one learns nothing", "a recorder lags", "a recorder lags far"),
        "the world has gone on without a recorder",
        "a new recorder",
    ],
)
def test_the_team_begins_at_the_newest_common_checkpoint(steps, said, begins):
    made, forgotten = attempts(steps, **said)
    made.begin()
    assert made.order.checkpoint == begins
    assert forgotten == [begins] * bool(begins)


def test_the_world_may_go_only_so_far_before_the_recorder_has_written():
    made, _ = attempts([0], robot_1=(0,))
    made.begin()
    attempt = made.order.attempt
    assert made.limit == math.inf, "until a recorder has begun"
    made.hear(RECORDER, Progress((), "another", written=10))
    made.hear("robot_1", Progress((0,), attempt))
    assert made.limit == math.inf
    made.hear(RECORDER, Progress((0,), attempt, written=30))
    assert made.limit == 30 + MOST_BEHIND
    made.hear(RECORDER, Progress((0,), attempt, LEFT))
    assert made.limit == math.inf, "it records no more"
    made.hear(RECORDER, Progress((0,), attempt, written=30))
    made.begin()
    assert made.limit == math.inf


def test_the_world_goes_only_so_many_checkpoints_before_a_recorder():
    """It would miss tables: publishers keep the last ten."""
    made, _ = attempts([0], checkpoint=25, robot_1=(0,))
    made.begin()
    made.hear(RECORDER, Progress((0,), made.order.attempt, written=30))
    assert made.limit == 30 + 5 * 25


def test_nothing_is_thrown_away_for_a_robot_that_keeps_no_checkpoints():
    made, _ = attempts([80, 40, 0], robot_1=(80, 40, 0), robot_2=(0,))
    with pytest.raises(
        RunError,
        match="robot_2 has no checkpoint of this run; all is saved: start robot_2",
    ):
        made.begin()


def test_a_robot_obeys_each_order_once_and_not_the_one_that_it_finds():
    side = SimpleNamespace(go_on_from=lambda agent, state: None)
    robot = RobotAttempts(side, CheckpointStore(), lambda: None, "an attempt")
    assert not robot.obey(Order())
    assert not robot.obey(Order("an attempt", 40))
    assert robot.progress() == Progress((0,), NO_ATTEMPT)
    assert robot.obey(Order("the next", 0))
    assert not robot.obey(Order("the next", 0))
    assert robot.progress() == Progress((0,), "the next")


def test_a_world_that_comes_back_finds_its_robots():
    scenario = problem("env1")
    team = Team(scenario, 4)
    team.play([(600, lambda t: t.kill(WORLD)), (640, lambda t: t.start(WORLD))])
    assert tables_equal(team.tables, learn(scenario, "coop", 5))


def test_who_sleeps_through_the_order_obeys_when_it_wakes():
    team = Team(problem("env1", steps=600), 4)
    team.play(
        [
            (600, lambda t: t.asleep.add(0)),
            (601, lambda t: t.kill(1)),
            (620, lambda t: t.start(1)),
            (6000, lambda t: t.asleep.discard(0)),
        ]
    )
    assert team.world.side.left_out > 0
    assert team.up[0].attempts.attempt == team.world.attempts.order.attempt
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
    assert same_bits(world.history, state.history)
    robot = stores["robot_2"].load(80)
    state = played.up[1].side.snapshot()
    assert robot[1:-1] == state[1:-1]
    assert memories_equal(robot.memory, state.memory)
    assert stores["robot_1"].load(0) is None


def test_who_begins_at_a_checkpoint_forgets_later_ones(tmp_path, run, played):
    store = saved(tmp_path, run, played, steps=(40, 80, 120))["robot_1"]
    store.forget_after(80)
    assert store.steps() == [80, 40, 0]


def test_checkpoints_to_which_the_team_never_goes_back_are_removed(
    tmp_path, run, played
):
    store = saved(tmp_path, run, played, steps=(40, 80, 120))["robot_1"]
    store.forget_before(80)
    assert store.steps() == [120, 80, 0]


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty"])
def test_a_broken_file_is_named_and_an_earlier_one_is_used(
    tmp_path, run, played, damage
):
    for store in saved(tmp_path, run, played).values():
        store.close()
    path = tmp_path / "checkpoint" / "robot_1_80.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    damages = {"cut": data[:300], "flipped": data, "empty": b""}
    path.write_bytes(damages[damage])
    store = Checkpoints(tmp_path, "robot_1", run)
    assert store.steps() == [40, 0]
    assert store.steps() == [40, 0]
    (line,) = store.broken
    assert "robot_1_80.npz: cannot be read as a checkpoint" in line
    assert line.endswith("; an earlier one is used")


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
