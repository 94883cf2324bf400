# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots' and recorders' knowledge of the world, and the time that they wait for it."""

import pytest

from sparse_coord_ros.protocol.lockstep.timeouts import (
    Deadline,
    Reminder,
    Silence,
    WorldPresence,
)


@pytest.fixture
def watch():
    watch = WorldPresence("mine", 60.0, 0.0)
    watch.hear("mine", "learning", 5, 1.0)
    return watch


@pytest.mark.parametrize(
    ("said", "text"),
    [
        (("", "finished", 9), "is of run (none), not of this run mine"),
        (("other", "learning", 6), "is of run other"),
    ],
)
def test_what_another_world_says_does_not_count(watch, said, text):
    with pytest.raises(ValueError) as error:
        watch.hear(*said, 30.0)
    assert str(error.value).startswith(text)
    assert watch.end is None
    assert watch.silent(30.0) == 29.0


@pytest.mark.parametrize("state", ["finished", "stopped"])
def test_the_end_is_that_of_the_first_word(watch, state):
    watch.hear("mine", state, 9, 2.0)
    watch.hear("mine", state, 9, 3.0)
    assert (watch.end, watch.ended) == (9, 2.0)


def test_a_world_that_goes_on_belies_an_end(watch):
    watch.hear("mine", "stopped", 9, 2.0)
    watch.hear("mine", "resuming", 9, 3.0)
    assert watch.end is None
    watch.hear("mine", "stopped", 12, 4.0)
    assert (watch.end, watch.ended) == (12, 4.0)


def test_a_cut_is_waited_out(watch):
    assert watch.given_up(60.9) == ""
    watch.hear("mine", "learning", 6, 60.9)
    assert watch.given_up(61.0) == ""
    assert watch.given_up(121.0) == "no word from the world for 60 s"


def test_a_new_world_ends_the_wait_for_the_old_one_once_that_is_silent(watch):
    watch.another_run()
    assert watch.given_up(3.9) == ""
    assert watch.given_up(4.0).endswith("and another one has begun a run")
    watch.hear("mine", "learning", 6, 4.1)
    assert watch.given_up(20.0) == "", "the old one is there after all"


def test_patience_without_end():
    watch = WorldPresence("mine", 0.0, 0.0)
    assert watch.given_up(1e9) == ""


def test_reminders_of_one_wait_become_rarer():
    reminder = Reminder()
    due = [now for now in range(205) if reminder.due(now)]
    assert due == [5, 10, 20, 40, 80, 140, 200]
    assert reminder.due(260) == 260
    reminder.over()
    assert [reminder.due(now) for now in (261, 265.9, 266)] == [0, 0, 5]


@pytest.mark.parametrize(
    ("heard", "at"),
    [((), 2.0), ((0.5, 1.5), 3.5), (tuple(range(1, 60)), 5.0)],
    ids=[
        "a silent peer",
        "one that falls silent",
        "one that always says: not there yet",
    ],
)
def test_a_peer_that_is_behind_is_waited_for_longer(heard, at):
    deadline = Deadline(2.0, 5.0)
    question = ("percept", 9)
    last = 0.0
    now = 0.0
    while not deadline.passed(question, last, now):
        now += 0.5
        last = max([last, *(one for one in heard if one <= now)])
    assert now == at
    assert not deadline.passed(question, last, now), "it is said once"


def test_a_new_question_has_its_own_deadline():
    deadline = Deadline(2.0, 5.0)
    assert not deadline.passed(("percept", 9), 0.0, 0.0)
    assert not deadline.passed(("percept", 10), 0.0, 2.5)
    assert not deadline.passed(("percept", 10), 0.0, 4.0)
    assert deadline.passed(("percept", 10), 0.0, 4.5)


def test_a_world_that_stood_still_itself_calls_nobody_silent():
    silence = Silence(0.0)
    for now in (0.2, 0.4, 0.6):
        silence.tick(now)
    assert (silence.lasts(0.6), silence.stands(0.6)) == (0.6, 0.6)
    silence.tick(5.0)
    assert (silence.lasts(5.0), silence.stands(5.0)) == (0.0, 5.0)
    assert silence.repeats(5.0) and not silence.repeats(5.1)
