# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which time steps a robot believes."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.protocol.lockstep.gate import NEAR, StepGate

GAPS = st.lists(st.sampled_from([1, NEAR]), min_size=1, max_size=30)
"""Between two time steps of the world: of one episode, and where another one begins."""


@given(GAPS)
def test_the_worlds_own_steps_pass(gaps):
    gate = StepGate()
    steps = list(itertools.accumulate(gaps))
    for step in steps:
        assert gate.passes(step)
    assert all(map(gate.passes, steps)), "what is said again passes too"
    assert gate.newest == steps[-1]


@given(GAPS, st.data(), st.integers(NEAR + 1, 10**9))
def test_one_step_far_ahead_makes_nobody_deaf(gaps, data, ahead):
    """It is not believed, and forgotten when the world goes on."""
    gate = StepGate()
    steps = list(itertools.accumulate(gaps))
    at = data.draw(st.integers(0, len(steps) - 1))
    for step in steps[:at]:
        assert gate.passes(step)
    assert not gate.passes(gate.newest + ahead)
    for step in steps[at:]:
        assert gate.passes(step)
        assert not gate.confirmed(step)
    assert gate.newest == steps[-1]


def test_a_step_beyond_an_episodes_start_is_not_believed():
    gate = StepGate(newest=10)
    assert not gate.passes(10 + EPISODE_GAP + 2)
    assert gate.passes(10 + EPISODE_GAP + 1)


def test_a_jump_passes_when_the_world_has_said_that_it_is_so_far():
    gate = StepGate()
    assert not gate.confirmed(500)
    assert gate.passes(480) and gate.passes(500 + NEAR)


def test_who_was_left_out_catches_up_with_the_next_status():
    gate = StepGate(newest=20)
    for step in (900, 901, 902, 905):
        assert not gate.passes(step)
    assert not gate.confirmed(700), "said before the first of them"
    assert gate.confirmed(903)
    assert gate.newest == 905
    assert gate.passes(906)
    assert not gate.confirmed(904), "said once is enough"


def test_a_strange_step_between_does_not_stop_who_catches_up():
    gate = StepGate(newest=20)
    for step in (900, 10**9, 901, 902):
        assert not gate.passes(step)
    assert gate.confirmed(903)
    assert gate.newest == 902


@pytest.mark.parametrize(
    ("said", "passes"), [(899, True), (900 - NEAR, True), (899 - NEAR, False)]
)
def test_a_status_may_be_said_a_little_before_the_step(said, passes):
    gate = StepGate(newest=20)
    assert not gate.passes(900)
    assert gate.confirmed(said) is passes
    assert gate.newest == (900 if passes else 20)
