# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Random streams: every draw is a function of (seed, robot, role, time step).

Nothing depends on the order in which messages arrive. A stream is one NumPy PCG64 generator,
keyed by (seed; phase, agent, role); each time step owns a fixed number of its draws, whether
they are used or not, and `advance` finds the draws of any step.
"""

import numpy as np

LEARNING = 0
EVALUATION = 1
"""Phases of a run: the same seed gives independent draws in each."""

PHASES = {"evaluation": EVALUATION, "learning": LEARNING}
"""What environments call them."""

POLICY, MOTION, PERCEPT, START, REPLAY, BLIND, LEAVE = range(7)
"""Roles of a stream; REPLAY: the factored learner's, BLIND: of those that explore as they ask,
LEAVE: of those that leave a stand-off."""

DRAWS = {POLICY: 5, MOTION: 1, PERCEPT: 1, START: 2, REPLAY: 1, BLIND: 2, LEAVE: 1}
"""Draws a time step owns, by role."""

EXPLORE, EXPLORED_ACTION, TIE, PRIMITIVE_TIE, PEER = range(5)
"""Columns of the POLICY stream: explore or not, which action, the tie draw of pi_epsilon's greedy
choice, the tie draw of pi_g (Algorithm 1, lines 7 and 9), which peer to perceive."""

BLIND_EXPLORE, BLIND_ACTION = range(2)
"""Columns of the BLIND stream: whether the move that COORDINATE becomes is explored, and which."""

DRAWS_AT_ONCE = 256


def bit_generator(seed: int, agent: int, role: int, phase: int) -> np.random.PCG64:
    """Return the generator of one agent in one role, at time step 0; arguments as of `Stream`."""
    return np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(phase, agent, role)))


class Stream:
    """Uniform draws in [0, 1) of one agent in one role, by time step.

    Args:
        seed: the run's seed, >= 0.
        agent: the agent's number, from 0.
        role: one of the roles.
        phase: LEARNING or EVALUATION.
    """

    def __init__(self, seed: int, agent: int, role: int, phase: int = LEARNING) -> None:
        self._key = (seed, agent, role, phase)
        self._width = DRAWS[role]
        self._first = self._last = 0
        self._rows: list[list[float]] = []

    def at(self, step: int) -> list[float]:
        """Return the draws of a time step (>= 0), a list of as many floats as the role owns."""
        if not self._first <= step < self._last:
            self._fill(step)
        return self._rows[step - self._first]

    def _fill(self, step: int) -> None:
        block = step // DRAWS_AT_ONCE
        bits = bit_generator(*self._key)
        bits.advance(block * DRAWS_AT_ONCE * self._width)
        draws = np.random.Generator(bits).random((DRAWS_AT_ONCE, self._width))
        self._first = block * DRAWS_AT_ONCE
        self._last = (block + 1) * DRAWS_AT_ONCE
        self._rows = draws.tolist()
