# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Second tables as arrays: rows that are found, grow in number, and are not lost."""

import numpy as np
import pytest

from sparse_coord_ros.game.actions import PRIMITIVES
from sparse_coord_ros.learn.rows import find_row, has_room, make_rows, rehash, row_to_learn, updated_rows


@pytest.mark.parametrize("move", range(PRIMITIVES))
def test_a_row_is_learned_when_any_one_of_its_moves_is(move):
    rows = make_rows(2, 3, 0.0)
    rows.updates[1, 2, move] = 1
    assert updated_rows(rows.updates).tolist() == [[False] * 3, [False, False, True]]
    keys, values, updates = rows.learned(1)
    assert (keys.tolist(), values.shape, updates[0, move]) == ([2], (1, PRIMITIVES), 1)
    assert not len(rows.learned(0)[0])


@pytest.mark.parametrize("hashed", [False, True])
def test_rows_that_were_put_are_found_by_their_keys(hashed):
    keys = np.array([6, 18])  # in a table of 16 rows 18 lies before 6
    values, updates = np.array([[1.0] * PRIMITIVES, [2.0] * PRIMITIVES]), np.ones((2, PRIMITIVES))
    rows = make_rows(1, 32, 0.0, 1, 8, hashed=hashed)
    rows.put(0, keys, values, updates)
    if hashed:
        grown = rows.empty(16)
        rehash(rows, grown)
        rows = grown
        assert rows.used.tolist() == [2]
    for key, due in zip(keys.tolist(), values.tolist(), strict=True):
        assert rows.values[0, row_to_learn(rows, 0, key)].tolist() == due
    assert rows.learned(0)[0].tolist() == [6, 18]


def test_a_hashed_table_stays_half_empty_whatever_a_block_brings():
    rows = make_rows(1, 16, 0.0, 2, 100, hashed=True)
    for key in range(2):
        row_to_learn(rows, 0, key)
    assert rows.used.tolist() == [2]
    assert has_room(rows, 3), "2 + 3 * 2 rows of 16"
    assert not has_room(rows, 4)
    assert rows.rows_for(2, 3) == 16
    assert rows.rows_for(2, 4) == 32
    assert rows.rows_for(2, 1000) == 256, "no more than the keys that there are"
    assert has_room(make_rows(1, 16, 0.0), 1000), "a dense table has all its rows"


def test_keys_that_want_one_place_take_the_next_ones():
    keys = np.full(4, -1, dtype=np.int64)
    for place in range(4):
        key = 3 + 4 * place  # the last place, then from the first one on
        row = find_row(keys, key)
        assert keys[row] == -1
        keys[row] = key
    assert [int(keys[find_row(keys, 3 + 4 * place)]) for place in range(4)] == [3, 7, 11, 15]
