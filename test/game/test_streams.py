# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Random streams: functions of seed, agent, role, phase and step, equal to NumPy's own PCG64."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from sparse_coord_ros.core.game import streams
from sparse_coord_ros.core.game.streams import (
    DRAWS,
    DRAWS_AT_ONCE,
    EVALUATION,
    LEARNING,
    MOTION,
    PERCEPT,
    POLICY,
    START,
    Stream,
)

ROLES = (POLICY, MOTION, PERCEPT, START)


def test_numbers_that_key_the_streams_never_change():
    """Renumbering would silently change every result."""
    assert (LEARNING, EVALUATION) == (0, 1)
    assert ROLES == (0, 1, 2, 3)
    assert DRAWS == {0: 5, 1: 1, 2: 1, 3: 2, 4: 1, 5: 2, 6: 1}
    columns = ("EXPLORE", "EXPLORED_ACTION", "TIE", "PRIMITIVE_TIE", "PEER")
    assert [getattr(streams, name) for name in columns] == [0, 1, 2, 3, 4]


@given(
    st.sampled_from(ROLES),
    st.sampled_from([LEARNING, EVALUATION]),
    st.integers(0, 2**63 - 1),
    st.lists(st.integers(0, 100_000), min_size=1, max_size=5),
)
@example(POLICY, LEARNING, 7, [500, 3, DRAWS_AT_ONCE, 3, DRAWS_AT_ONCE - 1, 0])
def test_at_each_step_in_any_order_a_fresh_generator_of_numpy(role, phase, seed, steps):
    stream = Stream(seed, 3, role, phase)
    for step in steps:
        key = np.random.SeedSequence(seed, spawn_key=(phase, 3, role))
        bits = np.random.PCG64(key)
        bits.advance(step * DRAWS[role])
        expected = np.random.Generator(bits).random(DRAWS[role]).tolist()
        assert stream.at(step) == expected


def test_seeds_agents_roles_and_phases_differ():
    first = {
        Stream(seed, agent, role, phase).at(9)[0]
        for seed in (0, 1, 2)
        for agent in (0, 1, 2)
        for role in ROLES
        for phase in (LEARNING, EVALUATION)
    }
    assert len(first) == 3 * 3 * 4 * 2


def test_draws_are_uniform():
    draws = np.array([Stream(5, 0, MOTION).at(t)[0] for t in range(2000)])
    counts = np.histogram(draws, bins=10, range=(0, 1))[0]
    assert ((counts - 200) ** 2 / 200).sum() < 27.9  # chi squared, 9 degrees, 0.1 %
