# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What killed processes have left of Fast DDS in shared memory.

Fast DDS keeps a segment for each participant and one for each port in /dev/shm. A process that
ends removes its own; SIGKILL leaves them there, some megabytes each time. A lock file beside each
segment, and beside a port that somebody reads, is locked while its owner lives, so that the rest
can be told apart, whoever started it (`fastdds shm clean` does so too). Ports without a lock file
have no reader (50 kB each); they go where this process can see that no other has them open.
"""

import fcntl
import os
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

FOLDER = Path("/dev/shm")

SEGMENT = re.compile(r"(?P<name>fast(?:rtps|dds)_(?:[0-9a-f]{16}|port\d{1,5}))(?P<lock>_[es]l)?")
"""A segment's file, or its lock file."""

PORT = "port"
"""Part of a port's name, and never of a segment's, which is a hexadecimal number."""

YOUNG_SECONDS = 2.0
"""Files that are younger may be about to be locked."""

EVERY_PROCESS = 0xEFFFFFFC
"""The number of the first PID namespace (the kernel's PROC_PID_INIT_INO), which sees them all."""
INIT = "1"
"""The first process there, which even root may not be allowed to look into; it is no ROS node."""


def leftovers(folder: Path = FOLDER) -> list[Path]:
    """Return the files of Fast DDS that no living process holds, sorted.

    Args:
        folder: where shared memory is.
    """
    return sorted(path for name, files in _free(folder) for path in _take(folder, name, files))


def remove_orphans(folder: Path = FOLDER, *, ports: bool = True) -> list[Path]:
    """Remove the files of Fast DDS that no living process holds, and return them.

    A port's file is opened again by the next process with that port, and locked a moment later:
    where other nodes may be starting, only segments may go, whose names are never used again.

    Files of other users, which this process may not remove, stay; so do those that are so young
    that their owner may be about to lock them.

    Args:
        folder: where shared memory is.
        ports: whether ports may go too.
    """
    found = [(name, files) for name, files in _free(folder) if ports or PORT not in name]
    return [path for name, files in found for path in _take(folder, name, files, remove=True)]


def _free(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield segments and ports with their files, but not those that somebody surely has open."""
    found: dict[str, list[str]] = {}
    with suppress(OSError):
        for file in sorted(os.listdir(folder)):
            match = SEGMENT.fullmatch(file)
            if match:
                found.setdefault(match["name"], []).append(file)
    in_use = None
    for name, files in found.items():
        if files == [name]:  # without a lock file
            in_use = _mapped(folder) if in_use is None else in_use
            if in_use is ALL or str(folder / name) in in_use:
                continue
        yield name, files


ALL = frozenset({"*"})
"""Instead of the files that are in use, where that cannot be known."""


def _mapped(folder: Path) -> frozenset[str]:
    """Return the files of a folder that processes have mapped; `ALL` where not all can be seen."""
    files: set[str] = set()
    try:
        if os.stat("/proc/self/ns/pid").st_ino != EVERY_PROCESS:
            return ALL
        for process in os.listdir("/proc"):
            if process.isdigit() and process != INIT:
                with suppress(FileNotFoundError, ProcessLookupError):  # it has just ended
                    text = Path("/proc", process, "maps").read_text(errors="replace")
                    files.update(re.findall(rf"{re.escape(str(folder))}/\S+", text))
    except OSError:  # no /proc, or a process of somebody else
        return ALL
    return frozenset(files)


def _take(folder: Path, name: str, files: list[str], *, remove: bool = False) -> list[Path]:
    """Return a segment's files and, of a port, its semaphore; none where one of them is held.

    They are removed while their locks are held here.
    """
    held = []
    try:
        age = time.time() - max(os.lstat(folder / file).st_mtime for file in files)
        if remove and age < YOUNG_SECONDS:
            return []
        for file in files:
            held.append(os.open(folder / file, os.O_RDWR | os.O_NOFOLLOW))
            fcntl.flock(held[-1], fcntl.LOCK_EX | fcntl.LOCK_NB)
        taken = []
        for path in (folder / f"sem.{name}_mutex", *(folder / file for file in files)):
            if path.exists():
                if remove:
                    path.unlink()
                taken.append(path)
        return taken
    except OSError:  # its owner lives, or it is another user's, or it has just gone
        return []
    finally:
        for descriptor in held:
            os.close(descriptor)
