# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The container of tables, histories and checkpoints: its digest covers all that is in it."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from sparse_coord_ros.base import npz
from sparse_coord_ros.base.errors import TablesError

ARRAYS = {"a": np.arange(1.0, 7.0).reshape(2, 3), "b": np.zeros(2, dtype=np.int64)}


def read(data):
    return npz.unpack(
        data, where="a.npz", what="tables", remedy="use another", error=TablesError
    )


@pytest.mark.parametrize("data", [b"", b"just text", b"PK\x03\x04 no zip"])
def test_what_is_no_archive(data):
    with pytest.raises(TablesError, match="^a.npz"):
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
    with pytest.raises(TablesError, match="a.npz: .*digest"):
        read(changed.getvalue())


KINDS = st.sampled_from(["<f8", "<i8", "<i4", "|b1", "|i1"])
SHAPES = array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3)
NAMES = st.text("abcxyz_12", min_size=1).filter(lambda name: name != "digest")


@given(st.dictionaries(NAMES, KINDS.flatmap(lambda kind: arrays(kind, SHAPES))))
def test_arrays_come_back(given):
    found = read(npz.pack(given))
    assert found.keys() == given.keys()
    for name, array in given.items():
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert found[name].tobytes() == array.tobytes()
