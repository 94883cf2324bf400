# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays as the bytes of an .npz file: the container of tables, histories and checkpoints.

Beside the arrays it has `format`, three texts: the number of the format of all three; the version
of the software that wrote it; the SHA-256 of names, dtypes, shapes and bytes of all other arrays,
in the order of the names. With it the reader of a file detects damage.
"""

import hashlib
import io
import json
import math
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import (
    SparseCoordError,
    check_format,
    in_short,
    message_of,
)
from sparse_coord_ros.base.limits import ARRAYS, Limit
from sparse_coord_ros.base.version import FORMAT, __version__

ENTRY = b"PK\x01\x02"
MOST_ARRAYS = 2**16
"""The beginning of an entry of a zip file's directory; the most entries."""

MOST_UPDATES = 2**31
"""The compiled loops count in 32 bits."""

LARGEST_VALUE = 1e30
"""No learned value is further from 0: the limits of a scenario's rewards are far below."""

HEADERS: Mapping[tuple[int, int], Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def pack(arrays: Mapping[str, Any], *, compressed: bool = True) -> bytes:
    """Return named arrays as bytes; equal arrays give equal bytes."""
    whole: dict[str, Any] = {name: np.asarray(array) for name, array in arrays.items()}
    head = np.array([str(FORMAT), __version__, _digest(whole)])
    file = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(file, format=head, **whole)
    return file.getvalue()


def unpack(
    data: bytes,
    *,
    where: str,
    what: str,
    remedy: str,
    error: type[SparseCoordError],
    damaged: type[SparseCoordError] | None = None,
    limit: Limit = ARRAYS,
) -> dict[str, np.ndarray]:
    """Return the arrays of a file.

    Args:
        data: its bytes.
        where: its name in messages.
        what: its expected kind, such as "tables".
        remedy: the remedy if it is of another kind.
        error: the class to raise.
        damaged: the class to raise if it cannot be read or does not fit its digest; None: `error`.
        limit: largest size of its arrays in bytes.

    Raises:
        SparseCoordError: an `error`: the file is too large, cannot be read, does not fit its
            digest, or is in another format.
    """
    try:
        _check_headers(data, limit)
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        if "format" not in arrays:
            raise ValueError("it has no array 'format'")
        head = arrays.pop("format").ravel()[:3].tolist()
        number = int(head[0])
        if number == FORMAT and head[2] != _digest(arrays):
            raise ValueError("its contents do not fit its digest")
    except (
        Exception
    ) as failure:  # zip, zlib and NumPy's parser raise any exception for a bad file
        # without NumPy's advice to trust the file
        problem = message_of(failure).partition(". ")[0]
        told = f"{where}: cannot be read as {what} ({problem}); {remedy}"
        raise (damaged or error)(told) from None
    check_format(number, where, error)
    return arrays


def _check_headers(data: bytes, limit: Limit) -> None:
    """Raise an exception unless the arrays are within the limit, and of numbers or texts.

    Only their headers are unpacked. Every declared size is compared with the actual data.
    """
    if data.count(ENTRY) > MOST_ARRAYS:
        raise ValueError(f"it has more than {MOST_ARRAYS:,} arrays")
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        entries = file.infolist()
        size = sum(entry.file_size for entry in entries)
        if size > limit.elements:
            raise ValueError(
                f"its arrays have {size:,} bytes, allowed for {limit.what}: {limit.elements:,}"
            )
        for entry in entries:
            with file.open(entry) as array:
                shape, dtype = HEADERS[np.lib.format.read_magic(array)](array)[::2]
                size = array.tell() + math.prod(shape) * dtype.itemsize
            if (
                dtype.kind not in "biufU"
                or not dtype.itemsize
                or size != entry.file_size
            ):
                raise ValueError(
                    f"{entry.filename} has type {dtype.str} and shape {in_short(shape)} in "
                    f"{entry.file_size:,} bytes"
                )


def member(
    arrays: Mapping[str, Any],
    name: str,
    kind: Any,
    *shape: int | None,
    below: int | None = None,
) -> np.ndarray:
    """Return an array, checked for its required type and shape.

    Args:
        arrays: a file's arrays.
        name: the array's name.
        kind: its type.
        shape: its shape; None: any size.
        below: its numbers are from 0 to below this; None: any numbers.

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
        found = f"{array.dtype} of shape {in_short(array.shape)}"
        raise ValueError(f"{name} is {found}, not {np.dtype(kind)} of {shape}")
    if below is not None:
        check_range(array, 0, below, name)
    return array


def check_range(array: np.ndarray, low: int, high: int, name: str) -> None:
    """Raise `ValueError` unless all numbers are from `low` to below `high`."""
    if array.size and not (low <= array.min() and array.max() < high):
        raise ValueError(
            f"{name} has numbers out of range, allowed: {low} to {high - 1}"
        )


def check_finite(array: np.ndarray, name: str) -> None:
    """Raise `ValueError` unless all numbers are finite, and up to `LARGEST_VALUE`."""
    if not np.all(np.abs(array) <= LARGEST_VALUE):
        raise ValueError(
            f"{name} has numbers that are not finite, or beyond {LARGEST_VALUE:g}"
        )


def _digest(arrays: Mapping[str, Any]) -> str:
    said = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        said.update(json.dumps([name, array.dtype.str, array.shape]).encode())
        said.update(array.tobytes())
    return said.hexdigest()
