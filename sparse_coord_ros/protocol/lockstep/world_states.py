# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The states of a world, and what changes them, without ROS.

`WorldSide` says whether a time step can be made: whether all robots have acted. The state says
whether it may be made now.
"""

from enum import Enum, auto

from sparse_coord_ros.protocol.wire import RunState


class State(Enum):
    """The state of a world.

    It listens whether another world announces a run; waits for its nodes; makes time steps; rests
    until the next one is due by the rate, if there is one; is paused; makes one step in spite of
    the pause. After an order to return to a checkpoint it waits until all nodes have obeyed. It
    has finished, or was stopped. A world that is paused before the run, or while nodes return, is
    paused after it.
    """

    LISTENING = auto()
    WAITING = auto()
    WAITING_PAUSED = auto()
    RETURNING = auto()
    RETURNING_PAUSED = auto()
    RUNNING = auto()
    RESTING = auto()
    PAUSED = auto()
    STEPPING = auto()
    FINISHED = auto()
    STOPPED = auto()

    def published(self, *, greedy: bool, resuming: bool) -> RunState:
        """Return the state in words, for `status`.

        Args:
            greedy: whether the team acts greedily.
            resuming: whether an earlier run is continued.
        """
        match self:
            case State.LISTENING | State.WAITING:
                return RunState.RESUMING if resuming else RunState.WAITING
            case State.RETURNING | State.RETURNING_PAUSED:
                return RunState.RESUMING
            case State.PAUSED | State.WAITING_PAUSED:
                return RunState.PAUSED
            case State.FINISHED:
                return RunState.FINISHED
            case State.STOPPED:
                return RunState.STOPPED
        return RunState.GREEDY if greedy else RunState.LEARNING


class Event(Enum):
    """An event that changes the state of a world.

    No other world is there. All nodes are there: the run begins, or goes on. A process has come in
    place of another: all nodes return to a checkpoint. A user pauses, continues, or requests one
    step. A step was made; or a step that has a rate. The next step is due by the rate, or there is
    no rate any more. The step budget is used up. The world ends.
    """

    OPENED = auto()
    ALL_THERE = auto()
    RETURN = auto()
    PAUSE = auto()
    CONTINUE = auto()
    STEP = auto()
    MADE = auto()
    MADE_BY_RATE = auto()
    DUE = auto()
    BUDGET_USED = auto()
    END = auto()


_NEXT = {
    (State.LISTENING, Event.OPENED): State.WAITING,
    (State.WAITING, Event.ALL_THERE): State.RESTING,
    (State.WAITING, Event.PAUSE): State.WAITING_PAUSED,
    (State.WAITING_PAUSED, Event.ALL_THERE): State.PAUSED,
    (State.WAITING_PAUSED, Event.CONTINUE): State.WAITING,
    (State.RETURNING, Event.ALL_THERE): State.RESTING,
    (State.RETURNING, Event.PAUSE): State.RETURNING_PAUSED,
    (State.RETURNING_PAUSED, Event.ALL_THERE): State.PAUSED,
    (State.RETURNING_PAUSED, Event.CONTINUE): State.RETURNING,
    (State.RUNNING, Event.RETURN): State.RETURNING,
    (State.RUNNING, Event.PAUSE): State.PAUSED,
    (State.RUNNING, Event.STEP): State.STEPPING,
    (State.RUNNING, Event.MADE_BY_RATE): State.RESTING,
    (State.RUNNING, Event.BUDGET_USED): State.FINISHED,
    (State.RESTING, Event.RETURN): State.RETURNING,
    (State.RESTING, Event.PAUSE): State.PAUSED,
    (State.RESTING, Event.STEP): State.STEPPING,
    (State.RESTING, Event.DUE): State.RUNNING,
    (State.RESTING, Event.BUDGET_USED): State.FINISHED,
    (State.PAUSED, Event.RETURN): State.RETURNING_PAUSED,
    (State.PAUSED, Event.CONTINUE): State.RESTING,
    (State.PAUSED, Event.STEP): State.STEPPING,
    (State.PAUSED, Event.BUDGET_USED): State.FINISHED,
    (State.STEPPING, Event.RETURN): State.RETURNING_PAUSED,
    (State.STEPPING, Event.CONTINUE): State.RESTING,
    (State.STEPPING, Event.MADE): State.PAUSED,
    (State.STEPPING, Event.BUDGET_USED): State.FINISHED,
}

OVER = (State.FINISHED, State.STOPPED)
GATHERING = (State.WAITING, State.WAITING_PAUSED)
RETURNING = (State.RETURNING, State.RETURNING_PAUSED)
MOVING = (State.RUNNING, State.STEPPING)
"""The states in which the next step is made as soon as all robots have acted."""

UNDER_WAY = (*MOVING, State.RESTING, State.PAUSED)
"""The states in which robots act."""


def next_state(state: State, event: Event) -> State:
    """Return the state after an event; the same one where the event means nothing in it."""
    if event is Event.END:
        return State.FINISHED if state is State.FINISHED else State.STOPPED
    return _NEXT.get((state, event), state)
