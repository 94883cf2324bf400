# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Random draws: each is a function of seed, phase, robot, role, time step and column.

Nothing is remembered between draws, so nothing depends on their order, and a draw that nobody
needs costs nothing. The generator is SplitMix64 (Steele, Lea and Flood, Fast Splittable
Pseudorandom Number Generators, 2014), read at any place: its n-th output needs no other one.
Plain Python and compiled loops run this source, with the same bits.
"""

import numpy as np

from sparse_coord_ros.base.compiling import jitable

LEARNING, EVALUATION = range(2)
"""Phases of a run: the same seed gives independent draws in each."""

PHASES = {"evaluation": EVALUATION, "learning": LEARNING}
"""What environments call them."""

ENVIRONMENT, ROBOT = range(2)
"""Roles: who draws, the world for a robot or the robot itself."""

COLUMNS = 64
"""Draws that a time step owns for each robot and role, whether they are used or not."""

MOTION, PERCEPT, START, START_CELL = range(4)
"""Columns of ENVIRONMENT: whether a move succeeds; whether a percept succeeds; whether an episode
begins with an exploring start, and in which cell."""

(
    PEER,
    EXPLORE,
    EXPLORED_ACTION,
    TIE,
    MOVE_TIE,
    BLIND_EXPLORE,
    BLIND_ACTION,
    REPLAY,
) = range(8)
"""Columns of ROBOT: which peer to perceive; whether to explore, and which action; the tie draw of
pi_epsilon's greedy choice, and that of pi_g (Algorithm 1, lines 7 and 9); whether the move that
COORDINATE becomes is explored, and which; what to replay."""

FREE = 16
"""Columns of ROBOT from here on are for a learner of one's own."""

_WORD = 0xFFFFFFFFFFFFFFFF
_GOLDEN = 0x9E3779B97F4A7C15
_FIRST_FACTOR = 0xBF58476D1CE4E5B9
_SECOND_FACTOR = 0x94D049BB133111EB
_BITS_33 = 2**33 - 1
_BITS_34 = 2**34 - 1
_BITS_37 = 2**37 - 1
_BITS_53 = 2**53 - 1
_UNIT = 2.0**-53


@jitable
def draw(key: int, step: int, column: int) -> float:
    """Return a uniform draw in [0, 1), a multiple of 2^-53.

    It is output number `step * COLUMNS + column` (from 0) of SplitMix64 with the seed `key`.

    Args:
        key: the key of a robot in a role, from `key_of` or `keys_of`.
        step: the time step, from 0.
        column: which draw of the time step, from 0 to COLUMNS - 1.
    """
    counter = int(step) * COLUMNS + column + 1
    return ((mixed(int(key) + counter * _GOLDEN) >> 11) & _BITS_53) * _UNIT


@jitable
def mixed(z: int) -> int:
    """Return the finalizer of SplitMix64 of the low 64 bits of a number.

    Compiled loops compute with signed numbers of 64 bits, Python with whole ones: the masks after
    the shifts make both unsigned.
    """
    z &= _WORD
    z = ((z ^ ((z >> 30) & _BITS_34)) * _FIRST_FACTOR) & _WORD
    z = ((z ^ ((z >> 27) & _BITS_37)) * _SECOND_FACTOR) & _WORD
    return z ^ ((z >> 31) & _BITS_33)


def key_of(seed: int, phase: int, robot: int, role: int) -> int:
    """Return the key of a robot's draws in a role, 64 bits.

    Args:
        seed: the run's seed, from 0 to 2^63 - 1.
        phase: LEARNING or EVALUATION.
        robot: the robot's number, from 0.
        role: ENVIRONMENT or ROBOT.
    """
    return mixed(seed + (4 * robot + 2 * phase + role + 1) * _GOLDEN)


def keys_of(seed: int, phase: int, robots: int) -> np.ndarray:
    """Return the keys of a team's draws, uint64, shape (2, robots): [role, k].

    Args:
        seed: the run's seed, from 0 to 2^63 - 1.
        phase: LEARNING or EVALUATION.
        robots: number of robots.
    """
    keys = [
        [key_of(seed, phase, k, role) for k in range(robots)]
        for role in (ENVIRONMENT, ROBOT)
    ]
    return np.array(keys, dtype=np.uint64)
