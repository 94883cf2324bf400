# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The generator at any place: NumPy's own draws, by plain Python and by numba."""

import numpy as np
import pytest

from sparse_coord_ros.base import compiling
from sparse_coord_ros.core.game.draws import CompiledDraws, drawn
from sparse_coord_ros.core.game.pcg64 import MOST, jump_table, source_of
from sparse_coord_ros.core.game.streams import DRAWS, EVALUATION, POLICY, START, Stream

STEPS = [0, 0, 1, 2, 24, 25, 26, 63, 64, 200, 10**5, 10**5 + 1]
"""With jumps as long as the table goes, one longer, and many times as long."""


def _draw_all(draws, steps, role, found):
    for row, step in enumerate(steps):
        for column in range(found.shape[1] - 1, -1, -1):
            found[row, column] = drawn(draws, role, 1, step, column)


def _draws(seed, role, first):
    sources = np.zeros((len(DRAWS), 2, 4), dtype=np.uint64)
    sources[role, 1] = source_of(seed, 1, role, EVALUATION, first * DRAWS[role])
    return CompiledDraws(True, sources, np.full((len(DRAWS), 2), first), jump_table())


@pytest.mark.parametrize("role", DRAWS)
def test_draws_at_any_step_in_any_order_are_those_of_the_stream(role):
    [draw_all] = compiling.jit([_draw_all])
    for seed, first in ((0, 0), (7, 0), (2**40, 10**6)):
        steps = np.array(STEPS) + first
        found = np.full((len(steps), DRAWS[role]), np.nan)
        draw_all(_draws(seed, role, first), steps, role, found)
        stream = Stream(seed, 1, role, EVALUATION)
        assert found.tolist() == [stream.at(step) for step in steps.tolist()]


def test_draws_of_a_role_without_a_generator_are_zero():
    found = np.full((1, DRAWS[START]), np.nan)
    [draw_all] = compiling.jit([_draw_all])
    draw_all(_draws(1, POLICY, 0), np.array([12345]), START, found)
    assert not found.any()


def test_the_table_reaches_as_far_as_it_says():
    assert jump_table().shape == (MOST + 1, 4)
    assert max(DRAWS.values()) <= MOST
