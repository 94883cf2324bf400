# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Schedules: step sizes by update, exploration by time step, the same bits on every processor."""

import numpy as np
import pytest

from sparse_coord_ros.core.game.schedules import (
    EPSILON,
    STEP_SIZE,
    probabilities,
    step_sizes,
)


def test_constant_step_size():
    sizes = step_sizes(STEP_SIZE.parse("constant:0.1"), 4)
    assert sizes.by_step.tolist() == [0.1] * 5
    assert not sizes.by_count.any()


def test_power_step_size():
    table = step_sizes(STEP_SIZE.parse("power:0.5"), 16).by_count
    assert table.shape == (17,)
    assert table.dtype == np.float64
    assert table[[1, 4, 16]].tolist() == [1.0, 0.5, 0.25]
    assert (np.diff(table[1:]) < 0).all()


def test_power_step_sizes_do_not_depend_on_numpy_s_vector_instructions(python):
    code = (
        "import hashlib; from sparse_coord_ros.core.game.schedules import STEP_SIZE, step_sizes; "
        "table = step_sizes(STEP_SIZE.parse('power:0.6'), 20000).by_count; "
        "print(hashlib.sha256(table.tobytes()).hexdigest())"
    )
    without = (
        "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR X86_V4"
    )
    digests = {
        python("-W", "ignore", "-c", code, env=change).stdout
        for change in ({}, {"NPY_DISABLE_CPU_FEATURES": without})
    }
    assert len(digests) == 1


def test_constant_epsilon():
    assert probabilities(EPSILON.parse("constant:0.2"), 3).tolist() == [0.2] * 4


def test_linear_epsilon_falls_over_its_fraction_and_then_holds():
    table = probabilities(EPSILON.parse("linear:1:0.5:0.5"), 20)
    assert table.shape == (21,)
    assert table[0] == 1.0
    assert table[5] == pytest.approx(0.75)
    assert table[10:].tolist() == [0.5] * 11
    assert (np.diff(table[:11]) < 0).all()
