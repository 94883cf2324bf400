# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sparse_coord_ros.errors import BagError, RunError
from sparse_coord_ros.learn.evaluation import play
from sparse_coord_ros.look.episodes import (
    PLAYED,
    episode_number,
    logged_asks,
    logged_episode,
    outcomes,
    played_episode,
)
from sparse_coord_ros.look.sources import open_shown
from sparse_coord_ros.palette import ANSWERED, FAILED, REFUSED
from sparse_coord_ros.runlog import read_run
from sparse_coord_ros.runlog.percepts import ENDED
from sparse_coord_ros.wire import LATE
from sparse_coord_ros.wire import REFUSED as NOT_PERCEIVED

OLD = Path(__file__).parents[1] / "fixtures/0.1.0"


@pytest.fixture(scope="module")
def log(bag):
    return read_run(bag)


def test_every_episode_of_a_log(log):
    history = log.history()
    for number in range(history.episodes):
        one = logged_episode(log, number)
        assert one.cells.shape == (one.length + 1, 2) and len(one.asks) == one.length
        assert one.length == history.length[number]
        assert one.conflicts.sum() == history.miscoordinations[number]
        asked = [ask.asker for asks in one.asks for ask in asks]
        assert [asked.count(k) for k in range(2)] == history.asks[number].tolist()
        np.testing.assert_array_equal(one.arrived, history.arrived[number])
    assert {one.outcome for row in range(len(log.step)) for one in logged_asks(log, row)} == {
        ANSWERED,
        REFUSED,
    }


def test_outcomes_are_those_of_the_log(log):
    found = outcomes(log)
    assert not found[FAILED].any()
    ended = log.numbers[..., ENDED]
    np.testing.assert_array_equal(found[REFUSED], ended == NOT_PERCEIVED)
    np.testing.assert_array_equal(sum(found.values()), log.asked)


def test_a_late_answer_failed(log):
    row, k = np.argwhere(log.asked & ~log.perceived)[0].tolist()
    numbers = log.numbers.copy()
    numbers[row, k, ENDED] = LATE
    late = replace(log, numbers=numbers)
    assert outcomes(late)[FAILED].sum() == 1
    [one] = [ask for ask in logged_asks(late, row) if ask.asker == k]
    assert one.outcome == FAILED
    assert one.in_words(log.names).startswith(f"{log.names[k]} asks {log.names[1 - k]}: no answer")


def test_which_episode(log):
    history = log.history()
    assert logged_episode(log, "last").number == np.flatnonzero(history.arrived.all(axis=1))[-1]
    best = logged_episode(log, "best")
    starts = [robot.start for robot in log.run.scenario.robots]
    assert best.cells[0].tolist() == starts and best.arrived.all()
    assert logged_episode(log, "asks").number < history.episodes
    with pytest.raises(RunError, match=r"--episode is 9999, there are \d+; allowed: 0 to"):
        logged_episode(log, 9999)
    for text in ("first", "-1", "1.5", "", "9" * 20, "١"):
        with pytest.raises(RunError, match="give the number of an episode"):
            episode_number(text)
    assert episode_number("17") == 17


def test_a_played_episode_is_the_trial_of_an_evaluation(trained):
    shown = open_shown(trained)
    scenario = shown.config.scenario
    trials = play(scenario, shown.tables, trials=5, seed=2, learner="coop")
    for number in range(5):
        one = played_episode(scenario, shown.tables, number, seed=2)
        assert sum(map(len, one.asks)) == trials.asks[number].sum()
        assert one.conflicts.sum() == trials.miscoordinations[number]
        assert one.length == trials.time_to_goal[number].max()
    assert played_episode(scenario, shown.tables, "last", seed=2).number == PLAYED - 1
    best = played_episode(scenario, shown.tables, "best", seed=2)
    assert best.arrived.all() and best.greedy
    with pytest.raises(RunError, match="there are 100"):
        played_episode(scenario, shown.tables, PLAYED, seed=2)


def test_a_bag_of_version_0_1_0():
    shown = open_shown(OLD / "honest/bag")
    assert shown.name == "honest"
    assert logged_episode(shown.log, "last").number == shown.history.episodes - 1
    found = outcomes(shown.log)
    np.testing.assert_array_equal(sum(found.values()), shown.log.asked)
    assert len(shown.tables) == 2


def test_what_a_directory_lacks(trained, tmp_path):
    shown = open_shown(trained)
    assert not shown.has("log") and shown.has("history") and shown.has("tables")
    with pytest.raises(RunError, match="has no bag; 'sparse_coord run' records one"):
        shown.log  # noqa: B018
    for path, words in (
        (tmp_path, "has no .mcap file"),
        (tmp_path / "none", "cannot read|no such"),
    ):
        with pytest.raises(BagError, match=words):
            open_shown(path).config  # noqa: B018
    old = open_shown(OLD / "train_noncoop")
    assert old.has("tables") and not old.has("history")
    assert (
        open_shown(OLD / "honest").history.episodes
        == open_shown(OLD / "honest/bag").history.episodes
    )
