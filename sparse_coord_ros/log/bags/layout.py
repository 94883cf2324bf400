# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a bag: new, unbuffered, locked while they grow; every failure is a `BagError`."""

import contextlib
import errno
import os
from functools import partial
from pathlib import Path
from typing import BinaryIO

from sparse_coord_ros.base.errors import BagError, retold
from sparse_coord_ros.base.files import (
    PARTIAL,
    sync_directory,
    take_lock,
    write_whole,
)

RESCUE = "'pymcap-cli recover --always-decode-chunk' (pip install pymcap-cli)"
"""What makes a whole bag of the readable parts of a damaged one; without the option it copies a
damaged chunk as it is."""

WANTED = "give a run's directory, its bag, or an .mcap file"

CONVERT = (
    "convert it: rosbags-convert --src DIRECTORY --dst NEW --dst-storage mcap "
    "(pip install rosbags)"
)
"""What makes an MCAP bag of another one."""

failing = partial(retold, BagError, OSError)
"""Turns an OSError into a BagError."""


class OutputFile:
    """A new file, as an output stream of `mcap.writer.Writer`.

    It is unbuffered: the operating system has the written bytes, and they survive the process. The
    first failure is final; the file then ends with the last whole record. Until it is closed the
    file is locked, so that others know that it is being recorded.

    Attributes:
        path: the file; its name ends with `.partial` until `finish`.
        refusal: the reason why the file accepts no more bytes; None while it does.
    """

    def __init__(self, path: Path) -> None:
        """Create the file, `.partial`; an OSError passes, `create_bag_file` explains it."""
        self.path = path.with_name(path.name + PARTIAL)
        self.refusal: str | None = None
        self._position = 0
        self._file = open(self.path, "xb", buffering=0)
        take_lock(self._file, exclusive=True)

    @property
    def closed(self) -> bool:
        """True if `close` was called."""
        return self._file.closed

    def check_usable(self) -> None:
        """Raise BagError with the refusal, if there is one."""
        if self.refusal is not None:
            raise BagError(self.refusal)

    def write(self, data: bytes) -> None:
        """Write all bytes, or raise BagError with the cause and the place."""
        rest = memoryview(data)
        begin = self._position
        try:
            while rest:
                # A nearly full disk accepts a part and fails with the next call.
                written = self._file.write(rest)
                self._position += written
                rest = rest[written:]
        except OSError as error:
            self.refusal = (
                f"cannot write {self.path} beyond {self._position} bytes: {error.strerror}; the "
                "recording ends there, unfinished, and is read up to there: make room or choose "
                f"another directory; {RESCUE} gives the file an end"
            )
            with contextlib.suppress(OSError):
                self._file.truncate(begin)
            raise BagError(self.refusal) from error

    def tell(self) -> int:
        """Return the number of bytes written."""
        return self._position

    def flush(self) -> None:
        """Do nothing: there is no buffer."""

    def finish(self) -> None:
        """Write everything to the disk, then drop `.partial` from the name; raises BagError."""
        if not os.fstat(self._file.fileno()).st_nlink:
            raise BagError(f"{self.path} was deleted while it was recorded")
        whole = self.path.with_name(self.path.name.removesuffix(PARTIAL))
        with failing(f"cannot finish {self.path} as {whole.name}", "; all is in it"):
            if whole.exists():
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
            os.fsync(self._file.fileno())
            self.path = self.path.rename(whole)
            sync_directory(whole.parent)

    def close(self) -> None:
        """Close the file; raises BagError if the system reports a late failure."""
        if self.refusal is None:
            self.refusal = f"the bag {self.path} is closed: open a new one"
        with failing(f"cannot close {self.path}"):
            self._file.close()


def create_bag_file(directory: Path, file_name: str, *, new: bool = True) -> OutputFile:
    """Make the directory, which must not exist if it is `new`, and a file in it.

    Raises:
        BagError: directory or file cannot be made.
    """
    try:
        if new:
            directory.mkdir(parents=True)
        return OutputFile(directory / file_name)
    except FileExistsError as error:
        remedy = "choose another name, or move it away"
        raise BagError(f"bag directory {directory} exists: {remedy}") from error
    except OSError as error:
        why = f"{error.strerror}; choose a directory that you may write to"
        raise BagError(f"cannot make the bag {directory / file_name}: {why}") from error


def open_to_read(path: Path) -> BinaryIO:
    """Open a file; raises BagError if it cannot be read."""
    with failing(f"cannot read {path}", f"; {WANTED}"):
        return path.open("rb")


def being_recorded(path: Path) -> bool:
    """True if a recorder holds the file's lock; raises BagError."""
    with open_to_read(path) as file:
        return not take_lock(file, exclusive=False)


def write_text(path: Path, text: str) -> None:
    """Write a text file, all or nothing, to the disk; raises BagError."""
    with failing(f"cannot write {path}", "; make room"):
        write_whole(path, text, sync=True)
