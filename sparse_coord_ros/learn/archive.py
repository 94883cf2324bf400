# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays as the bytes of an .npz file: the container of tables, histories and checkpoints.

Beside the arrays it has `format`, three texts: the number of the format of all three; the version
of the software that wrote it; the SHA-256 of names, dtypes, shapes and bytes of all other arrays,
in the order of the names. So whoever has read a file can trust what is in it.
"""

import hashlib
import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from sparse_coord_ros.errors import SparseCoordError, other_format
from sparse_coord_ros.version import __version__

FORMAT = 3
"""Number of the format. It changes where the arrays of any of these files change."""


def pack(arrays: Mapping[str, Any], *, compressed: bool = True) -> bytes:
    """Return named arrays as bytes; equal arrays give equal bytes."""
    whole: dict[str, Any] = {name: np.asarray(array) for name, array in arrays.items()}
    head = np.array([str(FORMAT), __version__, _digest(whole)])
    file = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(file, format=head, **whole)
    return file.getvalue()


def unpack(
    data: bytes, *, where: str, what: str, remedy: str, error: type[SparseCoordError]
) -> tuple[dict[str, np.ndarray], str]:
    """Return the arrays of a file, and the version that wrote it.

    Args:
        data: its bytes.
        where: what messages call it.
        what: what it should be, such as "tables".
        remedy: what to do where it is something else.
        error: what to raise.

    Raises:
        SparseCoordError: an `error`: it cannot be read, does not fit its digest, or is in another
            format.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            head = file["format"].ravel().tolist() if "format" in file.files else [1]
            number = int(head[0])
            names = set(file.files) - {"format"} if number == FORMAT else ()
            arrays = {name: file[name] for name in names}
        if number == FORMAT and head[2] != _digest(arrays):
            raise ValueError("its contents do not fit its digest")
    except Exception as failure:  # zip, zlib and NumPy's parser raise what a file makes them
        problem = " ".join(str(failure).split()).partition(". ")[0]  # no advice to trust it
        raise error(f"{where}: cannot be read as {what} ({problem}); {remedy}") from None
    if number != FORMAT:
        raise error(other_format(where, number, FORMAT))
    return arrays, str(head[1])


def _digest(arrays: Mapping[str, Any]) -> str:
    said = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        said.update(json.dumps([name, array.dtype.str, array.shape]).encode())
        said.update(array.tobytes())
    return said.hexdigest()
