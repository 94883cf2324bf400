# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of size for untrusted input, and the functions that read it.

Files, bags and messages are data. With any content, reading ends soon, with the content or with a
one-line error. Each kind of input has its `Limit`; bytes and elements bound the time.
"""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO, NamedTuple

from sparse_coord_ros.base.errors import SparseCoordError


class Limit(NamedTuple):
    """The largest size of a kind of input.

    Attributes:
        what: the kind, in the words of messages.
        bytes: of a file, text or message.
        elements: values of a YAML text, keys and containers included; squares of a grid; bytes
            of an archive's arrays.
    """

    what: str
    bytes: int
    elements: int = 0


MB = 2**20
SCENARIO = Limit("a scenario or a run", 8 * MB, 20_000)
MAP = Limit("a map", 4 * MB, 1_000_000)
CELLS = 250_000
"""Free cells of a map to learn on."""

MAP_HEADER = Limit("the description of a map", 2**16, 1_000)
IMAGE = Limit("an image", 128 * MB, 25_000_000)
ARRAYS = Limit("tables, histories and checkpoints", 1024 * MB, 1024 * MB)
RESULTS = Limit("results", 64 * MB)
RECORD = Limit("a record of a bag", 256 * MB)
CHUNK = Limit("the content of a chunk", 64 * MB)
CHUNKS = Limit("the content of all chunks, and of each byte of the file", 256 * MB, 100)
RECORDS = 50_000
"""Most attachments and metadata of a bag; its messages have one more for each byte of the file."""

MESSAGE = Limit("a message", 2**16)
"""For topics without their own limit: a node reads such a message within a few milliseconds."""

PICTURE = Limit("a map or markers", 4 * MB)
TABLES = Limit("the tables of one robot", 64 * MB, 64 * MB)
METADATA = Limit("a bag's metadata", 4 * MB, 100_000)

ASKED = 1_000
"""Most parameters in one request to a node's parameter services."""

DEEPEST_NESTING = 30
"""Containers within containers of a YAML text."""


def too_large(size: int, limit: Limit) -> str:
    """Return the error text for something larger than its limit."""
    return f"it has {size:,} bytes, allowed for {limit.what}: {limit.bytes:,}"


def open_regular(path: Path, limit: Limit | None = None) -> BinaryIO:
    """Open a regular file to read; a pipe or a device is refused without waiting.

    Args:
        path: the file.
        limit: its largest size; None: any size.

    Raises:
        OSError: it cannot be read, is not a regular file, or is too large; with its name.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a path has no NUL characters", str(path))
    file = open(
        path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)
    )
    found = os.fstat(file.fileno())
    if not stat.S_ISREG(found.st_mode):
        refusal = errno.EINVAL, "it is not a file"
    elif limit is not None and found.st_size > limit.bytes:
        refusal = errno.EFBIG, too_large(found.st_size, limit)
    else:
        return file
    file.close()
    raise OSError(*refusal, str(path))


def read_file(
    path: Path, limit: Limit, error: type[SparseCoordError], remedy: str
) -> bytes:
    """Return the bytes of a regular file.

    Args:
        path: the file.
        limit: its largest size.
        error: the class to raise.
        remedy: the remedy in the error text.

    Raises:
        SparseCoordError: an `error`: as `open_regular`.
    """
    try:
        with open_regular(path, limit) as file:
            return file.read()
    except OSError as failure:
        raise error(f"{path}: cannot be read ({failure.strerror}); {remedy}") from None


def read_text(
    path: Path, limit: Limit, error: type[SparseCoordError], remedy: str
) -> str:
    """Return the text of a regular file in UTF-8; arguments and errors as in `read_file`."""
    try:
        return read_file(path, limit, error, remedy).decode().replace("\r\n", "\n")
    except UnicodeDecodeError as failure:
        raise error(f"{path}: is no UTF-8 text ({failure.reason}); {remedy}") from None
