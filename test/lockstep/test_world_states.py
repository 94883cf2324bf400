# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The states of a world: what a user's pause, a rate, a restart and the end change."""

import pytest

from sparse_coord_ros.protocol.lockstep.world_states import (
    MOVING,
    OVER,
    UNDER_WAY,
    Event,
    State,
    next_state,
)
from sparse_coord_ros.protocol.wire import RunState


def after(*events, begin=State.LISTENING):
    """Return the state after events."""
    state = begin
    for event in events:
        state = next_state(state, event)
    return state


BEGUN = (Event.OPENED, Event.ALL_THERE)


def test_a_run_begins_and_makes_steps_until_its_budget_is_used():
    assert after(Event.OPENED) is State.WAITING
    assert after(*BEGUN, Event.DUE) is State.RUNNING
    assert after(*BEGUN, Event.DUE, Event.MADE) is State.RUNNING
    assert after(*BEGUN, Event.DUE, Event.BUDGET_USED, Event.PAUSE) is State.FINISHED


def test_with_a_rate_each_step_waits_until_it_is_due():
    assert after(*BEGUN) not in MOVING
    assert after(*BEGUN, Event.DUE, Event.MADE_BY_RATE) is State.RESTING
    assert after(*BEGUN, Event.DUE, Event.MADE_BY_RATE, Event.DUE) is State.RUNNING


def test_a_paused_team_makes_one_step_at_a_time():
    paused = (*BEGUN, Event.DUE, Event.PAUSE)
    assert after(*paused, Event.DUE) is State.PAUSED
    assert after(*paused, Event.STEP) is State.STEPPING
    assert after(*paused, Event.STEP, Event.MADE) is State.PAUSED
    assert after(*paused, Event.CONTINUE, Event.DUE) is State.RUNNING


@pytest.mark.parametrize("before", [BEGUN, (*BEGUN, Event.DUE)])
def test_a_pause_outlasts_a_restart(before):
    """Whether it came before the restart, or while nodes return."""
    assert after(*before, Event.RETURN, Event.ALL_THERE) is State.RESTING
    for events in ((Event.PAUSE, Event.RETURN), (Event.RETURN, Event.PAUSE)):
        assert after(*before, *events) not in UNDER_WAY
        assert after(*before, *events, Event.ALL_THERE) is State.PAUSED


def test_a_world_may_be_paused_before_its_run():
    assert after(Event.OPENED, Event.PAUSE, Event.ALL_THERE) is State.PAUSED
    waits = after(Event.OPENED, Event.PAUSE, Event.CONTINUE)
    assert waits is State.WAITING


@pytest.mark.parametrize("state", State)
def test_its_end_is_final(state):
    end = next_state(state, Event.END)
    assert end in OVER and (end is State.FINISHED) == (state is State.FINISHED)
    assert {next_state(end, event) for event in Event} == {end}


@pytest.mark.parametrize("state", State)
def test_each_state_has_words(state):
    said = state.published(greedy=False, resuming=False)
    assert isinstance(said, RunState)
    assert (said is RunState.LEARNING) == (state in (*MOVING, State.RESTING))
    assert State.WAITING.published(greedy=False, resuming=True) is RunState.RESUMING
