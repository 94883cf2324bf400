# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a team that learns now puts on the board, and how seldom what is costly."""

from types import SimpleNamespace

import numpy as np
import pytest

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, Reward, StepOutcome
from sparse_coord_ros.core.runs.history import History, HistoryRecorder, blank_history
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.show.page import page_messages
from sparse_coord_ros.show.page.live_source import LiveView
from sparse_coord_ros.show.page.message_board import MessageBoard


@pytest.fixture
def view(monkeypatch):
    run = make_run(load_scenario("env1"), {})
    clock = SimpleNamespace(
        monotonic=lambda: made.time, thread_time=lambda: made.worked
    )
    monkeypatch.setattr("sparse_coord_ros.show.page.live_source.time", clock)
    made = LiveView(run, MessageBoard(), source="live", title="", controls=())
    made.time = 100.0
    made.worked = 0.0
    return made


def ask(view, step, robots=2):
    """Let robot 1 ask at a time step."""
    actions = (Action(0, True, 1, True), *[Action(1, False, -1, False)] * (robots - 1))
    cells = (3, *range(4, 3 + robots))
    after = (3, *range(5, 4 + robots))
    view.take(TeamTransition(step, cells, actions, after, False))
    view.show(transitions=step, episode=0)


def test_the_newest_questions_are_told_once(view):
    for step in range(50):
        ask(view, step)
        view.show(transitions=step, episode=0, rate=1.0)  # the same transition
    told = [entry["step"] for entry in view.board.get("dialogue")["entries"]]
    assert told == list(range(50 - page_messages.MOST_ENTRIES, 50))


@pytest.mark.parametrize(
    ("name", "learner", "settings", "by_row"),
    [
        ("env1", "coop", {}, True),
        ("crowd-3r", "coop", {}, True),
        ("env1", "voi", {}, False),
        ("env1", "voi", {"peers_seen": "while_learning"}, True),
        ("crowd-3r", "voi", {"peers_seen": "while_learning"}, False),
    ],
)
def test_the_row_is_named_where_no_other_reason_can_be(name, learner, settings, by_row):
    """The newest tables of a robot are not those by which it moved."""
    scenario = load_scenario(name).with_settings(settings)
    run = make_run(scenario, {"learner": learner})
    view = LiveView(run, MessageBoard(), source="live", title="", controls=())
    ask(view, 4, robots=len(scenario.robots))
    [entry] = view.board.get("dialogue")["entries"]
    assert entry["lines"][-1].startswith("goes north")
    assert (" by Q^C" in entry["lines"][-1]) == by_row


def test_a_trail_is_of_one_episode_and_leads_from_cell_to_cell(view):
    quiet = (Action(0, False, -1, False),) * 2
    for step, cells in enumerate(
        [(0, 20), (1, 20), (1, None), (5, 2), (5, 3)], start=4
    ):
        view.take(TeamTransition(step, cells, quiet, cells, False))
    view.show(transitions=5, episode=0)
    assert view.board.get("frame")["trails"] == [[0, 1, 5], [2, 3]]  # not from 20 on
    # a jump, as in a damaged log
    view.take(TeamTransition(9, (5, 20), quiet, (5, 20), False))
    view.show(transitions=6, episode=0)
    assert view.board.get("frame")["trails"] == [[0, 1, 5], [20]]
    view.take(TeamTransition(12, (1, 2), quiet, (1, 2), False))  # another episode
    view.show(transitions=7, episode=1)
    assert view.board.get("frame")["trails"] == [[1], [2]]


@pytest.mark.parametrize(("took", "pause"), [(0.001, 1.0), (0.03, 3.0), (9.0, 5.0)])
def test_what_takes_long_comes_seldom(view, monkeypatch, took, pause):
    """What is long because the machine is busy with something else does not count."""

    def slow_message(history):
        view.worked += took
        view.time += 10 * took
        return {}

    monkeypatch.setattr(page_messages, "curve_fields", slow_message)
    assert not view.slow_due()  # nobody looks
    view.board.pages += 1
    assert view.slow_due()
    view.show_learned(blank_history(0, 2), {})
    view.time += 0.99 * pause
    assert not view.slow_due()
    view.time += 0.02 * pause
    assert view.slow_due()


def test_numbers_have_four_digits_and_json_knows_each():
    found = page_messages.plain(np.array([[1.00001, np.nan], [-np.inf, 2 / 3]]))
    assert found == [[1.0, None], [None, 0.6667]]
    assert page_messages.plain(np.array([1.5, 2.0])) == [1.5, 2.0]


def test_a_robot_s_curve_leaves_out_the_episodes_in_which_it_was_not_there():
    history = blank_history(0, 2)._replace(
        first_step=np.arange(2),
        length=np.array([3, 5]),
        miscoordinations=np.zeros(2),
        asks=np.array([[1.0, 0.0], [0.0, 4.0]]),
        present=np.eye(2),
    )
    assert page_messages.curve_fields(history)["asks"] == [[1.0, None], [None, 4.0]]


def test_curves_of_a_long_run_are_means_and_take_no_copy_of_it():
    """Of robots that learned alone, whose episodes come one robot after the other, too."""
    recorder = HistoryRecorder(load_scenario("env1"))
    outcome = StepOutcome((Reward(-1.0, 0.0, 0.0, -1.0),) * 2, False, (0,), False)
    for episode in range(1000):
        actions = (Action(1, episode % 2 == 0, 1, False), Action(1, False, -1, False))
        recorder.add(episode, 3 * episode, actions, outcome)
    history = recorder.so_far
    assert not history.length.flags.owndata
    message = page_messages.curve_fields(history)
    assert message["window"] == 5 and len(message["length"]) == 200
    assert message["step"] == list(range(0, 1000, 5))
    assert message["asks"] == [[0.6, 0.4] * 100, [0.0] * 200]
    parts = [
        {name: array[half::2] for name, array in history._asdict().items()}
        for half in (1, 0)
    ]
    mixed = History(
        **{name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    )
    # each robot has made half as many steps
    due = message | {"step": [step // 2 for step in message["step"]]}
    assert page_messages.curve_fields(mixed) == due
