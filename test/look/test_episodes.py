# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0

from dataclasses import replace

import numpy as np
import pytest

from sparse_coord_ros.base.errors import BagError, RunError
from sparse_coord_ros.base.palette import ANSWERED, FAILED, REFUSED
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.evaluation import play
from sparse_coord_ros.core.runs.history import History
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.log.runlog import read_run
from sparse_coord_ros.protocol.wire import ACTION, PerceptEnd
from sparse_coord_ros.show.episodes import (
    PLAYED,
    chosen,
    episode_number,
    logged_episode,
    played_episode,
)
from sparse_coord_ros.show.sources import open_run
from sparse_coord_ros.show.steps import logged_step, questions_of


@pytest.fixture(scope="module")
def log(bag):
    return read_run(bag)


def test_every_episode_of_a_log(log):
    history = log.history()
    outcomes = set()
    for number in range(history.episodes):
        one = logged_episode(log, number)
        assert len(one.steps) == history.length[number]
        assert (
            sum(s.miscoordination for s in one.steps)
            == history.miscoordinations[number]
        )
        questions = [question for step in one.steps for question in questions_of(step)]
        asked = [question.asker for question in questions]
        assert [asked.count(k) for k in range(2)] == history.asks[number].tolist()
        assert one.arrived == history.arrived[number].all()
        outcomes |= {question.outcome for question in questions}
    assert outcomes == {ANSWERED, REFUSED}


@pytest.mark.parametrize(
    ("end", "outcome", "words"),
    [
        (PerceptEnd.REFUSED, REFUSED, "refused"),
        (PerceptEnd.LATE, FAILED, "no answer"),
        (PerceptEnd.NOBODY_TO_ASK, FAILED, "no answer"),
        (77, FAILED, "no answer"),  # another writer's
    ],
)
def test_how_a_question_ended_is_what_the_robot_says(log, end, outcome, words):
    row, k = np.argwhere(log.asked & ~log.perceived)[0].tolist()
    numbers = log.numbers.copy()
    numbers[row, k, ACTION.column("percept")] = end
    changed = replace(log, numbers=numbers)
    [one] = [one for one in questions_of(logged_step(changed, row)) if one.asker == k]
    assert one.outcome == outcome
    assert one.in_words(log.names).startswith(
        f"{log.names[k]} asks {log.names[1 - k]}: {words}"
    )


def test_how_a_question_ended_is_guessed_only_where_nobody_tells_it():
    asks = Action(2, True, -1, False)
    moves = Action(1, False, -1, False)
    seen = TeamTransition(5, (3, 4, 9), (asks, moves, None), (4, 5, 9), True)
    [question] = questions_of(seen)
    assert question == (0, (1, 2), PerceptEnd.REFUSED, 2)
    told = TeamTransition(
        5, (3, 4), (asks, moves), (4, 5), False, ends=(PerceptEnd.LATE, None)
    )
    assert questions_of(told)[0].outcome == FAILED
    perceived = told._replace(actions=(asks._replace(perceived=True), moves))
    assert questions_of(perceived)[0].outcome == ANSWERED
    alone = TeamTransition(5, (3,), (asks,), (4,), False)
    assert questions_of(alone)[0].end == PerceptEnd.NOBODY_TO_ASK


def test_which_episode(log):
    history = log.history()
    assert (
        logged_episode(log, "last").number
        == np.flatnonzero(history.arrived.all(axis=1))[-1]
    )
    best = logged_episode(log, "best")
    starts = tuple(robot.start for robot in log.run.scenario.robots)
    assert best.steps[0].cells == starts and best.arrived
    episodes = [logged_episode(log, n) for n in range(history.episodes)]
    own = [one for one in episodes if one.arrived and one.steps[0].cells == starts]
    asks = [sum(len(questions_of(step)) for step in one.steps) for one in own]
    busiest = logged_episode(log, "asks")
    assert busiest.arrived and sum(len(questions_of(s)) for s in busiest.steps) == max(
        asks
    )
    with pytest.raises(
        RunError, match=r"--episode is 9999, there are \d+; allowed: 0 to"
    ):
        logged_episode(log, 9999)
    with pytest.raises(RunError, match="holds no episode to show"):
        logged_episode(log.between(0, 0), "last")
    for text in ("first", "-1", "1.5", "", "9" * 20, "١"):
        with pytest.raises(RunError, match="give the number of an episode"):
            episode_number(text)
    assert episode_number("17") == 17


def test_of_equal_episodes_the_shortest_then_the_latest():
    asks = np.array([[9, 9], [1, 0], [0, 0], [8, 8], [0, 3]])
    history = History(
        first_step=np.arange(5),
        length=np.array([9, 5, 5, 4, 7]),
        returns=np.ones((5, 2)),
        miscoordinations=np.zeros(5),
        asks=asks,
        arrived=np.array([[True, True]] * 3 + [[True, False], [True, True]]),
        present=np.ones((5, 2)),
    )
    own = np.array([False, True, True, True, True])
    found = {what: chosen(what, history, own, "") for what in ("best", "asks", "last")}
    assert found == {"best": 2, "asks": 4, "last": 4}
    assert chosen("best", history, ~own, "") == 0


def test_a_played_episode_is_the_trial_of_an_evaluation(trained):
    shown = open_run(trained)
    scenario = shown.config.scenario
    trials = play(scenario, shown.tables, trials=5, seed=2, learner="coop")
    for number in range(5):
        one = played_episode(scenario, shown.tables, number, seed=2)
        assert (
            sum(len(questions_of(step)) for step in one.steps)
            == trials.asks[number].sum()
        )
        assert (
            sum(s.miscoordination for s in one.steps) == trials.miscoordinations[number]
        )
        assert len(one.steps) == trials.time_to_goal[number].max()
    assert played_episode(scenario, shown.tables, "last", seed=2).number == PLAYED - 1
    best = played_episode(scenario, shown.tables, "best", seed=2)
    assert best.arrived and best.greedy
    with pytest.raises(RunError, match="there are 100"):
        played_episode(scenario, shown.tables, PLAYED, seed=2)


def test_what_a_directory_lacks(trained, tmp_path):
    shown = open_run(trained)
    assert not shown.has("log") and shown.has("history") and shown.has("tables")
    with pytest.raises(RunError, match="has no bag; 'sparse_coord run' records one"):
        shown.log  # noqa: B018
    for path, words in (
        (tmp_path, "has no .mcap file"),
        (tmp_path / "none", "cannot read|no such"),
    ):
        with pytest.raises(BagError, match=words):
            open_run(path).config  # noqa: B018
