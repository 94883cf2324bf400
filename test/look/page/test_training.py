# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A run without ROS, looked at: the same bits, held, slowed down, stepped through."""

import numpy as np
import pytest
from teams import plain_run, same_bits, tables_equal, walking

from sparse_coord_ros.cli import train as train_verb
from sparse_coord_ros.cli.main import make_parser
from sparse_coord_ros.core.engine import training
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.history import blank_history
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.show.page import page_messages
from sparse_coord_ros.show.page.controls import PAUSE, RATE, STEP, Control
from sparse_coord_ros.show.page.message_board import MessageBoard
from sparse_coord_ros.show.page.training_source import TrainedView, TrainingView
from sparse_coord_ros.show.sources import in_memory

OFTEN = {"q_star_init": 100, "ask_cost": 0, "epsilon": "constant:0.3", "steps": 300}


def scenario(name="env1", **settings):
    return load_scenario(name).with_settings({**OFTEN, **settings})


@pytest.mark.parametrize(
    ("name", "learner", "settings"),
    [
        ("env1", "coop", {"perception": "probability:0.5"}),
        ("crowd-3r", "voi", {"perception": "probability:0.5", "peers": "all"}),
        ("env1", "indiv", {}),
    ],
)
def test_single_transitions_are_those_of_the_whole_run(name, learner, settings):
    problem = scenario(name, **settings)
    watched = plain_run(problem, learner, 3)
    for _ in range(60):
        watched.advance(watched.done + 2)
        seen = watched.make_transition()
        assert all(isinstance(one, Action | None) for one in seen.actions)
    whole = plain_run(problem, learner, 3)
    whole.advance(watched.done)
    assert watched.done == 180
    assert same_bits(watched.history, whole.history)
    assert tables_equal(watched.tables, whole.tables)
    assert np.array_equal(watched.asked, whole.asked)
    assert watched.asked.shape == (len(problem.robots), len(problem.map.cells))
    if learner == "coop":
        assert watched.asked.sum() == watched.history.asks.sum() > 10


class Clock:
    """Time that passes when somebody sleeps."""

    def __init__(self):
        self.now = 0.0
        self.then = {}

    def monotonic(self):
        return self.now

    thread_time = monotonic

    def sleep(self, seconds):
        self.now += seconds
        for at in sorted(self.then):
            if at <= self.now:
                self.then.pop(at)()


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    for module in ("live_source", "training_source"):
        monkeypatch.setattr(f"sparse_coord_ros.show.page.{module}.time", made)
    return made


@pytest.mark.parametrize("every", [0, 50])
def test_looking_changes_no_bit_and_shows_what_there_is(every, clock):
    problem = scenario()
    board = MessageBoard()
    board.pages += 1
    view = TrainingView(make_run(problem, {}), board, title="")
    view.control(Control(RATE, 100.0))
    steps = set()

    def progress(done, budget):
        steps.add(board.get("frame") and board.get("frame")["step"])

    done = train(
        problem,
        "coop",
        0,
        engine="python",
        evaluate_every=every,
        trials=2,
        watcher=view,
        progress=progress,
    )
    view.end()
    alone = train(problem, "coop", 0, engine="python", evaluate_every=every, trials=2)
    assert tables_equal(done.tables, alone.tables) and same_bits(
        done.history, alone.history
    )
    assert done.evaluations == alone.evaluations
    assert 2.8 < clock.now < 3.6  # 300 steps, 100 a second
    assert len(steps) > 60
    frame = board.get("frame")
    curves = board.get("curves")
    assert frame["state"] == "finished" and frame["made"] == 300
    assert curves["length"] == alone.history.length.tolist()
    assert board.get("tables")["robots"][1]["q_star"][0][COORDINATE] is not None
    assert np.array(board.get("asked")["robots"]).sum() > 0


@pytest.mark.parametrize(
    ("learner", "every"), [("coop", 0), ("coop", 50), ("indiv", 0)]
)
def test_the_last_frame_shows_what_was_learned_at_the_end(learner, every, clock):
    """Tables, questions and curves are the final ones, and the frame is the last transition.

    Whether a page was open, and though hardly a transition was shown on the way.
    """
    for pages in (0, 1):
        problem = scenario(steps=5000)
        board = MessageBoard()
        board.pages = pages
        view = TrainingView(make_run(problem, {"learner": learner}), board, title="")
        done = train(problem, learner, 0, evaluate_every=every, trials=2, watcher=view)
        view.end()
        frame = board.get("frame")
        tables = board.get("tables")["robots"]
        assert (frame["state"], frame["made"]) == ("finished", 5000)
        alone = plain_run(problem, learner, 0)
        alone.advance(4999)
        assert (frame["step"], frame["cells"]) == alone.make_transition()[:2]
        assert [one["step"] for one in tables] == [None, None]
        for one, own in zip(tables, done.tables, strict=True):
            assert one["q_star"] == page_messages.plain(own.q_star)
        asked = np.array(board.get("asked")["robots"])
        assert np.array_equal(asked, alone.asked) and (asked.sum() > 0) == (
            learner == "coop"
        )
        assert board.get("curves")["episodes"] == done.history.episodes
        assert len(done.evaluations) == (100 if every else 0)


def test_tables_on_the_way_are_of_the_time_step_that_is_reached(clock, monkeypatch):
    """Not of the transition that was shown last."""
    monkeypatch.setattr(training, "FIRST_PART", 100)
    monkeypatch.setattr(training, "PART_SECONDS", (0.0, 100.0))
    problem = scenario(steps=3000)
    board = MessageBoard()
    view = TrainingView(make_run(problem, {}), board, title="")
    found = []

    def progress(done, budget):
        clock.now += 2.0
        if done >= 1000:
            board.pages = 1  # a page is opened
        if board.get("tables"):
            found.append((done, board.get("tables")["robots"][0]))

    train(problem, "coop", 0, engine="python", watcher=view, progress=progress)
    made, tables = found[0]
    again = plain_run(problem, "coop", 0)
    while again.step < tables["step"]:
        again.advance(again.done + 1)
    assert tables["q_star"] == page_messages.plain(again.tables[0].q_star)
    assert 1000 <= again.done <= made


def test_a_run_that_is_stopped_is_not_said_to_learn(tmp_path, clock, monkeypatch):
    """The page of `import-map` shows on what was learned so far."""
    board = MessageBoard()
    board.pages = 1
    command = f"train env1 --steps 100000 --engine python --out {tmp_path / 'run'}"
    options = make_parser("train").parse_args(command.split())
    out, run = train_verb.begin(options)
    monkeypatch.setattr(TrainingView, "look", interrupted(TrainingView.look))
    with pytest.raises(KeyboardInterrupt):
        train_verb.learn(options, out, run, board)
    frame = board.get("frame")
    tables = board.get("tables")["robots"][0]
    assert frame["state"] == "stopped" and 0 < frame["made"] < 100_000
    assert tables["step"] > frame["step"]


def interrupted(look):
    """Return a look at a run that is interrupted at the fifth time."""
    times = []

    def looked(view, learning, transition):
        times.append(learning.done)
        if len(times) == 5:
            raise KeyboardInterrupt
        return look(view, learning, transition)

    return looked


def test_holding_and_stepping(clock):
    problem = scenario(steps=40)
    board = MessageBoard()
    view = TrainingView(make_run(problem, {}), board, title="")
    view.control(Control(PAUSE, True))
    held = []

    def note(then=None):
        held.append((board.get("frame")["state"], board.get("frame")["made"]))
        if then is not None:
            view.control(then)

    clock.then = {
        1.0: lambda: note(Control(STEP, 1)),
        2.0: lambda: note(Control(STEP, 1)),
        3.0: lambda: note(Control(PAUSE, False)),
    }
    done = train(problem, "coop", 0, engine="python", watcher=view)
    assert done.transitions == problem.steps
    first = held[0][1]
    assert held == [("paused", first), ("paused", first + 1), ("paused", first + 2)]


def test_the_last_step_is_made_though_it_cannot_be_shown_apart(clock):
    problem = scenario(steps=1)
    for command in (Control(STEP, 1), Control(RATE, 5.0)):
        view = TrainingView(make_run(problem, {}), MessageBoard(), title="")
        view.control(command)
        assert train(problem, "coop", 0, engine="python", watcher=view).transitions == 1


@pytest.mark.parametrize(
    ("asking", "said"),
    [
        (0.0, "The team hardly coordinates: a robot earns 92.60"),
        (-99.0, "The team does not coordinate by asking: "),
    ],
)
def test_a_run_without_a_bag_is_shown_by_a_greedy_episode(asking, said, clock):
    board = MessageBoard()
    run = make_run(scenario(), {})
    tables = walking(run.scenario, asking)
    view = TrainedView(in_memory(run, tables, blank_history(0, 2)), board)
    assert said in board.get("learned")["lines"][0]
    assert board.get("evaluation")["verdict"]
    frames = []

    def stop():
        raise KeyboardInterrupt

    clock.then = {
        i / 2: lambda: frames.append(board.get("frame")) for i in range(1, 40)
    }
    clock.then[20.0] = stop
    with pytest.raises(KeyboardInterrupt):
        view.play()
    assert {frame["state"] for frame in frames} == {"acting greedily"}
    assert (
        {frame["speed"] for frame in frames}
        == {frame["rate"] for frame in frames}
        == {2.0}
    )
    steps = [frame["step"] for frame in frames]
    assert steps[0] == 0 and max(steps) < 20 and steps.count(0) > 1, (
        "they are those of an episode"
    )
    assert all(len(frame["trails"][0]) <= frame["step"] + 1 for frame in frames)
    assert board.get("tables")["robots"][0]["step"] is None
    assert board.get("asked")["where"] == "asked here in 200 greedy episodes"
    entries = (board.get("dialogue") or {"entries": []})["entries"]
    assert {entry["step"] for entry in entries} <= set(steps)
    cells = [tuple(frame["cells"]) for frame in frames]
    first = tuple(robot.start for robot in run.scenario.robots)
    assert cells[0] == first and cells.count(first) > 1, "it is played again"
    assert any(frame["asks"] for frame in frames) == (asking == 0.0)
