# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a bag: new, compressed by chunks, unbuffered, every failure a `BagError`."""

import importlib.util
import os
from pathlib import Path

from mcap.writer import CompressionType

from sparse_coord_ros.errors import BagError

_COMPRESSIONS = {
    "zstd": (CompressionType.ZSTD, "zstandard"),
    "lz4": (CompressionType.LZ4, "lz4"),
    "none": (CompressionType.NONE, None),
}


class BagFile:
    """A new file, as an output stream of `mcap.writer.Writer`.

    Unbuffered: what is written is with the operating system, and survives the process. The first
    failure is final, for it may have cut a record short.

    Attributes:
        path: the file.
        refusal: why the file takes nothing more, or None while it does.
    """

    def __init__(self, path: Path) -> None:
        """Create the file; an OSError passes, `create_bag_file` explains it."""
        self.path = path
        self.refusal: str | None = None
        self._position = 0
        self._file = open(path, "xb", buffering=0)

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._file.closed

    def check_usable(self) -> None:
        """Raise BagError with the refusal, if there is one."""
        if self.refusal is not None:
            raise BagError(self.refusal)

    def write(self, data: bytes) -> None:
        """Write all bytes, or raise BagError with the cause and the place."""
        rest = memoryview(data)
        try:
            while rest:
                # A nearly full disk takes a part and fails with the next call.
                written = self._file.write(rest)
                self._position += written
                rest = rest[written:]
        except OSError as error:
            self.refusal = (
                f"cannot write {self.path} beyond {self._position} bytes: {error.strerror}; the "
                "recording ends there, unfinished: make room or choose another directory"
            )
            raise BagError(self.refusal) from error

    def tell(self) -> int:
        """Return the number of bytes written."""
        return self._position

    def flush(self) -> None:
        """Do nothing: there is no buffer."""

    def close(self) -> None:
        """Close the file; raises BagError if the system reports a late failure."""
        if self.refusal is None:
            self.refusal = f"the bag {self.path} is closed: open a new one"
        try:
            self._file.close()
        except OSError as error:
            raise BagError(f"cannot close {self.path}: {error.strerror}") from error


def chunk_compression(compression: str) -> CompressionType:
    """Return mcap's name for a chunk compression; raises BagError if it is not available."""
    if compression not in _COMPRESSIONS:
        raise BagError(f"compression is {compression!r}: give one of {', '.join(_COMPRESSIONS)}")
    compression_type, module = _COMPRESSIONS[compression]
    if module is not None and importlib.util.find_spec(module) is None:
        raise BagError(f"compression {compression} needs the Python package {module}: install it")
    return compression_type


def create_bag_file(directory: Path, file_name: str) -> BagFile:
    """Make the directory, which must not exist, and a file in it; raises BagError."""
    try:
        directory.mkdir(parents=True)
        return BagFile(directory / file_name)
    except FileExistsError as error:
        raise BagError(
            f"bag directory {directory} exists: choose another name, or move it away"
        ) from error
    except OSError as error:
        raise BagError(
            f"cannot make the bag {directory / file_name}: {error.strerror}; choose a directory "
            "that you may write to"
        ) from error


def write_whole(path: Path, text: str) -> None:
    """Write a text file all or nothing: its presence says that the bag is finished."""
    draft = path.with_name(f".{path.name}")
    try:
        draft.write_text(text, encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise BagError(f"cannot write {path}: {error.strerror}; make room") from error
