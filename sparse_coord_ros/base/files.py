# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files that are written whole or not at all, and locks on them."""

import errno
import fcntl
import itertools
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import chdir, nullcontext, suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import IO, Any

from sparse_coord_ros.base.errors import (
    RunError,
    SparseCoordError,
    wrong_argument,
)

PARTIAL = ".partial"
"""The end of the name of a file that is being written."""


STAND_INS = (
    (
        b"version https://git-lfs.github.com/",
        "is a pointer of Git LFS, not the file itself; fetch the file: git lfs pull",
    ),
    (
        b"/annex/objects/",
        "is a pointer of git-annex, not the file itself; fetch the file: git annex get",
    ),
    (
        b"<!doctype html",
        "is a web page, not the file itself; download the file (on GitHub: the button Raw)",
    ),
    (b"\x1f\x8b", "is compressed; unpack it first: gunzip"),
    (b"\x28\xb5\x2f\xfd", "is compressed; unpack it first: zstd -d"),
)
"""The first bytes of files that stand in place of another, and what to do."""


def refuse_stand_in(path: Path, begin: bytes, error: type[SparseCoordError]) -> None:
    """Raise an `error` if a file is no content, but a pointer to it or a package of it.

    Args:
        path: the file.
        begin: its first bytes.
        error: the class to raise.
    """
    for sign, text in STAND_INS:
        if begin[: len(sign)].lower() == sign:
            raise error(f"{path}: {text}")


def read_file(path: Path, error: type[SparseCoordError], remedy: str) -> bytes:
    """Return the bytes of a file.

    Args:
        path: the file.
        error: the class to raise.
        remedy: the remedy in the error text.

    Raises:
        SparseCoordError: an `error`: it cannot be read, or stands in place of another file.
    """
    try:
        content = path.read_bytes()
    except OSError as failure:
        raise error(f"{path}: cannot be read ({failure.strerror}); {remedy}") from None
    refuse_stand_in(path, content, error)
    return content


def read_text(path: Path, error: type[SparseCoordError], remedy: str) -> str:
    """Return the text of a file in UTF-8; arguments and errors as in `read_file`."""
    try:
        return read_file(path, error, remedy).decode().replace("\r\n", "\n")
    except UnicodeDecodeError as failure:
        raise error(f"{path}: is no UTF-8 text ({failure.reason}); {remedy}") from None


def path_argument(
    name: str,
    value: object,
    error: type[SparseCoordError] = RunError,
    instead: str = "a path",
) -> Path:
    """Return an argument as a path.

    Args:
        name: of the argument.
        value: its value.
        error: the class to raise.
        instead: the allowed values, in words.

    Raises:
        SparseCoordError: an `error`: it is neither a text nor a path.
    """
    if not isinstance(value, str | os.PathLike):
        raise error(wrong_argument(name, value, f"{instead}, as a text or a Path"))
    return Path(value)


def write_whole(path: Path, data: bytes | str, *, sync: bool = False) -> None:
    """Write a file atomically: readers find the old content or the new, never a part of it.

    Args:
        path: the file; its folder must exist.
        data: the content; a text is written as UTF-8.
        sync: also wait until the disk has the file and its name.

    Raises:
        OSError: it cannot be written, with the file's name; the old content is still there.
    """
    partial = path.with_name(path.name + PARTIAL)
    try:
        partial.unlink(missing_ok=True)  # it may be a link to another place
        with partial.open("xb") as file:
            file.write(data.encode() if isinstance(data, str) else data)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        os.replace(partial, path)
    except BaseException as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename = str(path)  # the error of a full disk lacks the file
        raise
    if sync:
        sync_directory(path.parent)


def _numbered(path: Path) -> Iterator[Path]:
    yield path
    for number in itertools.count(2):
        yield path.with_name(f"{path.name}{number}")


def rescue(
    directory: Path,
    write: Callable[[Path], None],
    joins: Callable[[Path], bool] = lambda target: False,
) -> Path:
    """Write files into a directory that replaces another, and return it.

    It is a new one with the name `<directory>_rescued`, and a number if that name exists, beside
    the other or in the folder for temporary files.

    Args:
        directory: the other one, an absolute path.
        write: writes the files into a directory.
        joins: tells whether to write into an existing directory of that name.

    Raises:
        OSError: neither place can be written; the error of the second.
    """
    for folder in (directory.parent, Path(tempfile.gettempdir())):
        names = _numbered(folder / f"{directory.name}_rescued")
        try:
            target = next(target for target in names if _makes(target) or joins(target))
            write(target)
            return target
        except OSError as error:
            failure = error
    raise failure


def _makes(directory: Path) -> bool:
    """Make a directory; False if its name exists. Other OSErrors pass."""
    try:
        directory.mkdir(parents=True)
    except FileExistsError:
        return False
    return True


class HeldError(Exception):
    """Another process holds a file; the text names the process if it is known."""


def take_lock(
    file: IO[Any] | int, *, exclusive: bool = True, wait: bool = False
) -> bool:
    """Lock an open file or folder until it is closed; False if another process has the lock.

    Also True on file systems without locks, such as some network file systems.

    Args:
        file: the file, or its descriptor.
        exclusive: only for this process; else shared by all readers.
        wait: wait for the lock.
    """
    operation = fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH
    try:
        fcntl.flock(file, operation if wait else operation | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def hold(path: Path) -> IO[str]:
    """Lock a file for this process until it is closed; the file's text names the process.

    The file stays after that, for the next holder.

    Args:
        path: the file; it is made if it is missing.

    Raises:
        HeldError: another process holds it.
        OSError: it cannot be opened.
    """
    file = os.fdopen(
        os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW), "r+", errors="replace"
    )
    if not take_lock(file):
        with file:
            raise HeldError(f"process {file.read().strip()}".rstrip())
    with suppress(OSError):  # the text is only information for other processes
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
    return file


def sync_directory(directory: Path) -> None:
    """Write the names in a directory to the disk; an OSError passes."""
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # EINVAL: this file system needs no sync
            raise
    finally:
        os.close(descriptor)


def import_apart(name: str, file: str) -> ModuleType:
    """Import a library without its settings file in the current directory, which may be foreign.

    Args:
        name: the library.
        file: the name of the settings file.
    """
    with chdir(Path(__file__).parent) if os.path.exists(file) else nullcontext():
        return import_module(name)


def free_memory() -> int | None:
    """Return the bytes of memory that this machine has left; None where it does not say."""
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    return None
