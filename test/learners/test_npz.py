# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The container of tables, histories and checkpoints: its digest covers all that is in it."""

import io

import numpy as np
import pytest

from sparse_coord_ros.base import npz
from sparse_coord_ros.base.errors import TablesError

ARRAYS = {"a": np.arange(1.0, 7.0).reshape(2, 3), "b": np.zeros(2, dtype=np.int64)}


def read(data):
    return npz.unpack(
        data, where="a.npz", what="tables", remedy="use another", error=TablesError
    )


@pytest.mark.parametrize("data", [b"", b"just text", b"PK\x03\x04 no zip"])
def test_what_is_no_archive(data):
    with pytest.raises(
        TablesError, match="a.npz: cannot be read as tables .*; use another"
    ):
        read(data)


def test_a_spoiled_byte_is_refused_or_without_effect():
    """Whatever byte is wrong: never a traceback, never other numbers."""
    whole = npz.pack(ARRAYS)
    refused = 0
    for place in range(len(whole)):
        try:
            found = read(
                whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :]
            )
            assert all(
                found[name].tobytes() == ARRAYS[name].tobytes() for name in ARRAYS
            )
        except TablesError:
            refused += 1
    assert refused > len(whole) / 2


def test_arrays_come_back():
    found = read(npz.pack(ARRAYS))
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


@pytest.mark.parametrize(
    "other",
    [
        {"a": ARRAYS["a"].reshape(3, 2)},
        {"a": ARRAYS["a"].view(np.int64)},
        {"a": ARRAYS["a"] + 1},
        {"c": np.zeros(1)},
    ],
    ids=["shape", "dtype", "values", "one more"],
)
def test_a_digest_is_of_names_dtypes_shapes_and_values(other):
    with np.load(io.BytesIO(npz.pack(ARRAYS))) as file:
        arrays = dict(file)
    changed = io.BytesIO()
    np.savez(changed, **{**arrays, **other})
    with pytest.raises(TablesError, match="its contents do not fit its digest"):
        read(changed.getvalue())
