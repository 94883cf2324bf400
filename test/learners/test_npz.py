# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The container of tables, histories and checkpoints."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from sparse_coord_ros.base import npz
from sparse_coord_ros.base.errors import TablesError


def read(data):
    return npz.unpack(
        data, where="a.npz", what="tables", remedy="use another", error=TablesError
    )


@pytest.mark.parametrize("data", [b"", b"just text", b"PK\x03\x04 no zip"])
def test_what_is_no_archive(data):
    with pytest.raises(TablesError, match="^a.npz: cannot be read as tables"):
        read(data)


def test_objects_are_not_read():
    with pytest.raises(TablesError, match="a.npz"):
        read(npz.pack({"a": np.array([print], dtype=object)}))


@pytest.mark.parametrize(
    ("kind", "shape", "words"),
    [
        (np.int64, (2, 3), "a is float64 of shape .2, 3., not int64"),
        (np.float64, (3, 3), "a is float64 of shape .2, 3., not float64 of .3, 3."),
        (np.float64, (None,), "a is float64 of shape .2, 3."),
    ],
)
def test_an_array_of_another_type_or_shape(kind, shape, words):
    with pytest.raises(ValueError, match=words):
        npz.member({"a": np.zeros((2, 3))}, "a", kind, *shape)


def test_a_missing_array():
    with pytest.raises(ValueError, match="has no b"):
        npz.member({"a": np.zeros(2)}, "b", np.float64, None)


KINDS = st.sampled_from(["<f8", "<i8", "<i4", "|b1", "|i1"])
SHAPES = array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3)
NAMES = st.text("abcxyz_12", min_size=1)


@given(st.dictionaries(NAMES, KINDS.flatmap(lambda kind: arrays(kind, SHAPES))))
def test_arrays_come_back(given):
    found = read(npz.pack(given))
    assert found.keys() == given.keys()
    for name, array in given.items():
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert found[name].tobytes() == array.tobytes()
