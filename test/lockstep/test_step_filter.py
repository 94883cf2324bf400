# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The time steps that a robot accepts."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.protocol.lockstep.step_filter import NEAR, StepFilter

GAPS = st.lists(st.sampled_from([1, NEAR]), min_size=1, max_size=30)
"""Between two time steps of the world: of one episode, and at another one's beginning."""


@given(GAPS)
def test_the_worlds_own_steps_pass(gaps):
    step_filter = StepFilter()
    steps = list(itertools.accumulate(gaps))
    for step in steps:
        assert step_filter.passes(step)
    assert all(map(step_filter.passes, steps)), "what is said again passes too"
    assert step_filter.newest == steps[-1]


@given(GAPS, st.data(), st.integers(NEAR + 1, 10**9))
def test_one_step_far_ahead_makes_nobody_deaf(gaps, data, ahead):
    """It is not accepted, and dropped when the world continues."""
    step_filter = StepFilter()
    steps = list(itertools.accumulate(gaps))
    at = data.draw(st.integers(0, len(steps) - 1))
    for step in steps[:at]:
        assert step_filter.passes(step)
    assert not step_filter.passes(step_filter.newest + ahead)
    for step in steps[at:]:
        assert step_filter.passes(step)
        assert not step_filter.confirmed(step)
    assert step_filter.newest == steps[-1]


def test_a_step_beyond_an_episodes_start_is_not_believed():
    step_filter = StepFilter(newest=10)
    assert not step_filter.passes(10 + EPISODE_GAP + 2)
    assert step_filter.passes(10 + EPISODE_GAP + 1)


def test_a_jump_passes_when_the_world_has_said_that_it_is_so_far():
    step_filter = StepFilter()
    assert not step_filter.confirmed(500)
    assert step_filter.passes(480) and step_filter.passes(500 + NEAR)


def test_who_was_left_out_catches_up_with_the_next_status():
    step_filter = StepFilter(newest=20)
    for step in (900, 901, 902, 905):
        assert not step_filter.passes(step)
    assert not step_filter.confirmed(700), "said before the first of them"
    assert step_filter.confirmed(903)
    assert step_filter.newest == 905
    assert step_filter.passes(906)
    assert not step_filter.confirmed(904), "said once is enough"


def test_a_strange_step_between_does_not_stop_who_catches_up():
    step_filter = StepFilter(newest=20)
    for step in (900, 10**9, 901, 902):
        assert not step_filter.passes(step)
    assert step_filter.confirmed(903)
    assert step_filter.newest == 902


@pytest.mark.parametrize(
    ("said", "passes"), [(899, True), (900 - NEAR, True), (899 - NEAR, False)]
)
def test_a_status_may_be_said_a_little_before_the_step(said, passes):
    step_filter = StepFilter(newest=20)
    assert not step_filter.passes(900)
    assert step_filter.confirmed(said) is passes
    assert step_filter.newest == (900 if passes else 20)
