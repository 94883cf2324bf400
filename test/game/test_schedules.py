# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Schedules: step sizes by update, exploration by time step, the same bits on every processor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sparse_coord_ros.core.game.schedules import (
    EPSILON,
    STARTS,
    STEP_SIZE,
    probabilities,
    step_sizes,
)


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


SHARES = st.floats(0, 1)
BUDGETS = st.integers(1, 300)


@given(SHARES, BUDGETS)
def test_what_is_constant_is_the_same_at_each_step(share, budget):
    sizes = step_sizes(STEP_SIZE.parse(f"constant:{share!r}"), budget)
    assert sizes.by_step.tolist() == [share] * (budget + 1)
    assert not sizes.by_count.any()
    for schedule in (
        EPSILON.parse(f"constant:{share!r}"),
        STARTS.parse(f"mixed:{share!r}"),
    ):
        assert probabilities(schedule, budget).tolist() == [share] * (budget + 1)
    assert not probabilities(STARTS.parse("fixed"), budget).any()
    assert (probabilities(STARTS.parse("random"), budget) == 1).all()


@given(SHARES, SHARES, SHARES, BUDGETS)
def test_what_falls_goes_from_first_to_last_over_its_fraction_and_stays(
    first, last, fraction, budget
):
    numbers = f"{first!r}:{last!r}:{fraction!r}"
    table = probabilities(EPSILON.parse(f"linear:{numbers}"), budget)
    assert (
        table.tobytes()
        == probabilities(STARTS.parse(f"exploring:{numbers}"), budget).tobytes()
    )
    assert table[0] == first
    for step in range(budget + 1):
        done = 1.0 if step >= fraction * budget else step / (fraction * budget)
        expected = first + (last - first) * done
        # With a fraction of less than a step it has fallen at the first one.
        assert step == 0 or table[step] == pytest.approx(expected, abs=1e-12)


@given(SHARES, SHARES, SHARES, BUDGETS)
def test_a_floor_falls_over_the_budget_beside_the_power(exponent, first, last, budget):
    sizes = step_sizes(
        STEP_SIZE.parse(f"floored:{exponent!r}:{first!r}:{last!r}"), budget
    )
    power = step_sizes(STEP_SIZE.parse(f"power:{exponent!r}"), budget)
    assert sizes.by_count.tobytes() == power.by_count.tobytes()
    assert not power.by_step.any()
    falling = probabilities(EPSILON.parse(f"linear:{first!r}:{last!r}:1"), budget)
    assert sizes.by_step.tobytes() == falling.tobytes()
