# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays as the bytes of an .npz file: the container of tables, histories and checkpoints.

Beside the arrays it has `format`, the number of the format.
"""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import (
    SparseCoordError,
    check_format,
    in_short,
    message_of,
)
from sparse_coord_ros.base.version import FORMAT


def pack(arrays: Mapping[str, Any], *, compressed: bool = True) -> bytes:
    """Return named arrays as bytes; equal arrays give equal bytes."""
    file = io.BytesIO()
    save: Any = np.savez_compressed if compressed else np.savez
    save(file, format=np.array(FORMAT), **arrays)
    return file.getvalue()


def unpack(
    data: bytes,
    *,
    where: str,
    what: str,
    remedy: str,
    error: type[SparseCoordError],
    damaged: type[SparseCoordError] | None = None,
) -> dict[str, np.ndarray]:
    """Return the arrays of a file.

    Args:
        data: its bytes.
        where: its name in messages.
        what: its expected kind, such as "tables".
        remedy: the remedy if it is of another kind.
        error: the class to raise.
        damaged: the class to raise if it cannot be read; None: `error`.

    Raises:
        SparseCoordError: an `error`: the file cannot be read, or is in another format.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        number = int(arrays.pop("format").ravel()[0])
    except Exception as failure:
        # Zip, zlib and NumPy's parser raise any exception for a bad file. The message is without
        # NumPy's advice to trust the file.
        problem = message_of(failure).partition(". ")[0]
        line = f"{where}: cannot be read as {what} ({problem}); {remedy}"
        raise (damaged or error)(line) from None
    check_format(number, where, error)
    return arrays


def member(
    arrays: Mapping[str, Any], name: str, kind: Any, *shape: int | None
) -> np.ndarray:
    """Return an array, checked for its required type and shape.

    Args:
        arrays: a file's arrays.
        name: the array's name.
        kind: its type.
        shape: its shape; None: any size.

    Raises:
        ValueError: it is missing, or has another type or shape.
    """
    if name not in arrays:
        raise ValueError(f"has no {name}")
    array: np.ndarray = arrays[name]
    due = [
        size if want is None else want
        for size, want in zip(array.shape, shape, strict=False)
    ]
    if array.dtype != kind or len(shape) != array.ndim or array.shape != tuple(due):
        given = f"{array.dtype} of shape {in_short(array.shape)}"
        raise ValueError(f"{name} is {given}, not {np.dtype(kind)} of {shape}")
    return array
