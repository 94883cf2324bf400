# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sparse tables read like dense ones and have rows only for what was set."""

import numpy as np
import pytest

from sparse_coord_ros.game.scenario import dense_nbytes
from sparse_coord_ros.learn.sparse import SparseTable


def test_reads_like_a_dense_table_whatever_is_set():
    draws = np.random.default_rng(3)
    dense = np.full((6, 6, 6, 4), 200.0)
    sparse = SparseTable(6, 3, 200.0)
    assert sparse.shape == dense.shape
    for _ in range(300):
        entry = (*draws.integers(6, size=3).tolist(), int(draws.integers(4)))
        dense[entry] = sparse[entry] = float(draws.normal())
    seen = {state for state in np.ndindex(6, 6, 6) if (dense[state] != 200.0).any()}
    assert 100 < len(sparse) == len(seen) < 6**3
    for state in np.ndindex(6, 6, 6):
        assert (sparse[state] == dense[state]).all()
        for action in range(4):
            assert sparse[(*state, action)] == dense[(*state, action)]
    assert [tuple(key) for key in sparse.keys.tolist()] == sorted(seen)
    assert (sparse.rows == dense[tuple(sparse.keys.T)]).all()


def test_reading_makes_no_row():
    table = SparseTable(5, 3, 7.0)
    assert table[1, 2, 3].tolist() == [7.0] * 4
    assert table[1, 2, 3, 0] == 7.0
    with pytest.raises(ValueError, match="read-only"):
        table[1, 2, 3][0] = 1.0
    assert (len(table), table.nbytes) == (0, 0)
    assert (table.keys.shape, table.rows.shape) == ((0, 3), (0, 4))


def test_memory():
    table = SparseTable(59, 8, 0.0)
    for cell in range(40):
        table[(cell,) * 8 + (2,)] = 1.0
    assert table.nbytes == table.keys.nbytes + table.rows.nbytes == 40 * (8 * 4 + 4 * 8)
    assert dense_nbytes(59, 2) == np.zeros((59, 59, 4)).nbytes
    assert dense_nbytes(59, 8) == 59**8 * 32  # no 64-bit overflow on the way: 4.7 petabytes


def test_from_keys_and_rows_in_any_order():
    keys = np.array([[2, 0, 1], [0, 2, 1]], dtype=np.int32)
    rows = np.arange(8.0).reshape(2, 4)
    table = SparseTable(3, 3, 9.0, keys, rows)
    assert table[2, 0, 1].tolist() == [0, 1, 2, 3]
    assert table.keys.tolist() == [[0, 2, 1], [2, 0, 1]]
    assert table.rows.tolist() == [[4, 5, 6, 7], [0, 1, 2, 3]]
    turned = SparseTable(3, 3, 9.0, keys[::-1], rows[::-1])
    assert (turned.keys == table.keys).all() and (turned.rows == table.rows).all()
    table[2, 0, 1, 0] = table[1, 1, 1, 3] = 5.0
    assert rows[0, 0] == 0.0  # the table has a copy
    assert table.rows.tolist() == [[4, 5, 6, 7], [9, 9, 9, 5], [5, 1, 2, 3]]


def test_as_an_array():
    table = SparseTable(5, 2, 7.0)
    table[1, 2, 3] = 4.0
    array = np.asarray(table)
    assert array.shape == table.shape
    assert array[1, 2].tolist() == [7.0, 7.0, 7.0, 4.0]
    assert (array == 7.0).sum() == array.size - 1
