# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A table of rows does what a dictionary does, grows, and has the same bits compiled."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sparse_coord_ros.base.compiling import has_numba, jit
from sparse_coord_ros.core.learners import table as tables
from sparse_coord_ros.core.learners.table import (
    Table,
    find,
    grown,
    learned_rows,
    met,
    table,
    with_rows,
)

TEAM = 2
MOVES = 4


class Task(NamedTuple):
    """What `met` uses of a task."""

    full: Any


def task():
    return Task(np.zeros(1, dtype=np.bool_))


def of_team(most, first, a_step=1, *, room=None):
    """Return the table of two robots before learning, with room for so many rows or more."""
    one = table(most, np.array(first), a_step)
    arrays = {
        name: np.stack([value] * TEAM)
        for name, value in one._asdict().items()
        if isinstance(value, np.ndarray)
    }
    rows = one._replace(**arrays)
    return rows if room is None else grown(rows, room)


def visit(rows, task, robots, keys, moves):
    """Meet keys, one a step, and add 1 to an entry of each, until a table is full.

    Return how many steps were made.
    """
    for step in range(len(keys)):
        if task.full[0]:
            return step
        k = int(robots[step])
        row = met(rows, task, k, int(keys[step]))
        rows.values[k, row, moves[step]] += 1.0
        rows.updates[k, row, moves[step]] += 1
    return len(keys)


def visit_all(rows, robots, keys, moves, visit=visit):
    """Do all of them, in tables that grow."""
    done = 0
    state = task()
    while done < len(keys):
        done += visit(rows, state, robots[done:], keys[done:], moves[done:])
        if state.full[0]:
            rows = grown(rows, 2 * rows.values.shape[1])
            state.full[0] = False
    return rows


FIRST = [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0], [-1.0, -2.0, -3.0, -4.0]]

KEYS = {
    "few": (27, st.integers(0, 26)),
    "many": (3 * 10**6, st.integers(0, 3 * 10**6 - 1)),
    "largest": (2**63 - 2, st.integers(2**63 - 999, 2**63 - 3)),
}


@pytest.fixture
def small(monkeypatch):
    """Let tables begin with room for two rows, so that they soon grow."""
    monkeypatch.setattr(tables, "FIRST_ROWS", 2)


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("keys", KEYS)
@pytest.mark.parametrize("first", [FIRST[:1], FIRST])
def test_it_is_a_dictionary_for_each_robot(keys, first):
    most, numbers = KEYS[keys]
    step = st.tuples(st.integers(0, TEAM - 1), numbers, st.integers(0, MOVES - 1))

    @given(st.lists(step, min_size=1, max_size=60), st.lists(numbers, max_size=9))
    def check(steps, others):
        known = [{}, {}]
        span = most // len(first)
        for k, key, move in steps:
            values, updates = known[k].setdefault(
                key, (list(first[key // span]), [0] * MOVES)
            )
            values[move] += 1.0
            updates[move] += 1
        rows = visit_all(of_team(most, first), *zip(*steps, strict=True))
        for k in range(TEAM):
            for key in [*known[k], *others]:
                expected = known[k].get(key, (first[key // span],))[0]
                assert rows.values[k, find(rows, k, key)].tolist() == expected
            assert as_dictionary(rows, k) == known[k]

    check()


def as_dictionary(rows, k):
    learned = learned_rows(rows, k)
    assert learned.keys.dtype == np.int64
    assert (np.diff(learned.keys) > 0).all()
    return {
        key: (values, updates)
        for key, values, updates in zip(*(one.tolist() for one in learned), strict=True)
    }


def walk(number, most, seed=0):
    """Return the robots, keys and moves of a random walk, which comes back to many keys."""
    draws = np.random.default_rng(seed)
    keys = np.abs(np.cumsum(draws.integers(-3, 4, number))) * 977 % most
    return draws.integers(0, TEAM, number), keys, draws.integers(0, MOVES, number)


@pytest.mark.usefixtures("small")
def test_one_that_grew_is_as_one_that_had_room():
    steps = walk(3000, 10**6)
    rows = visit_all(of_team(10**6, FIRST), *steps)
    large = visit_all(of_team(10**6, FIRST, room=5000), *steps)
    assert rows.values.shape[1] > 64
    assert large.values.shape[1] == 5000
    assert rows.used.min() > 50
    assert rows.used.tolist() == large.used.tolist()
    assert same_tables(rows, large)


@pytest.mark.parametrize("a_step", [1, 5])
def test_it_is_full_while_the_rows_of_another_time_step_have_room(a_step):
    rows = of_team(10**6, FIRST, a_step)
    state = task()
    room = rows.values.shape[1]
    for key in range(room):
        met(rows, state, 1, key)
        if state.full[0]:
            break
    assert room - rows.used[1] == a_step
    met(rows, state, 1, 0)  # one that is known needs no room
    assert room - rows.used[1] == a_step


def test_its_index_stays_half_empty():
    for rows in (1, 2, 3, 1000, 1024, 1025):
        places = tables.places_for(rows)
        assert places & (places - 1) == 0
        assert 2 * rows <= places < 4 * rows + 1


@pytest.mark.parametrize("few", [True, False])
def test_rows_that_were_saved_make_the_same_table(few, monkeypatch):
    """Also where a new table has no room for them, and whatever the order they were met in."""
    rows = visit_all(of_team(10**6, FIRST), *walk(3000, 10**6))
    monkeypatch.setattr(tables, "FIRST_ROWS", 2 if few else 5000)
    again = of_team(10**6, FIRST)
    for k in range(TEAM):
        again = with_rows(again, k, learned_rows(rows, k))
    more = walk(3000, 10**6, seed=1)
    assert same_tables(rows, again)
    rows = visit_all(rows, *more)
    again = visit_all(again, *more)
    assert same_tables(rows, again)


def same_tables(one, other):
    for k in range(TEAM):
        arrays = zip(learned_rows(one, k), learned_rows(other, k), strict=True)
        if any(mine.tobytes() != theirs.tobytes() for mine, theirs in arrays):
            return False
    return True


@pytest.mark.skipif(not has_numba(), reason="numba is not installed")
@pytest.mark.usefixtures("small")
def test_compiled_it_is_the_same_array_by_array():
    most = 2**63 - 2
    robots, keys, moves = walk(2000, 10**6)
    keys = keys * (most // 10**6)
    [quick] = jit([visit])
    plain = visit_all(of_team(most, FIRST), robots, keys, moves)
    compiled = visit_all(of_team(most, FIRST), robots, keys, moves, quick)
    for name in Table._fields:
        one, other = (np.asarray(getattr(rows, name)) for rows in (plain, compiled))
        assert one.tobytes() == other.tobytes(), name
