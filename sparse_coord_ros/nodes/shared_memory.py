# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What Fast DDS leaves in shared memory when a process is killed.

A participant holds a lock on a file beside each of its own: `fastrtps_<id>_el` beside its
segment, `_el` or `_sl` beside a port that it listens on. The lock goes with the process, the files
stay. So a file whose lock can be taken is nobody's.
"""

import fcntl
import os
import re
from contextlib import suppress
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")

_NAME = re.compile(r"(?:fast(?:rtps|dds)_(?:port\d+|[0-9a-f]{16}))")
_LOCKS = ("_el", "_sl")
_MUTEX = "sem.{}_mutex"


def leftovers(folder: Path = SHARED_MEMORY) -> list[Path]:
    """Return the files that no living process holds and that this user may remove, sorted.

    Args:
        folder: where the shared memory is.
    """
    try:
        names = set(os.listdir(folder))
    except OSError:
        return []
    left = []
    for name in names:
        if not _NAME.fullmatch(name) or _held(folder, name):
            continue
        beside = [name, *(name + lock for lock in _LOCKS), _MUTEX.format(name)]
        left += [folder / one for one in beside if one in names]
    left += [
        folder / name
        for name in names
        if name.endswith(_LOCKS) and name[:-3] not in names and _NAME.fullmatch(name[:-3])
        if not _locked(folder / name)
    ]
    return sorted(path for path in left if os.access(path, os.W_OK))


def remove(paths: list[Path]) -> int:
    """Remove leftovers; return how many are gone."""
    for path in paths:
        with suppress(OSError):
            path.unlink()
    return sum(not path.exists() for path in paths)


def _held(folder: Path, name: str) -> bool:
    return any(_locked(folder / (name + lock)) for lock in _LOCKS)


def _locked(path: Path) -> bool:
    """Whether a living process holds the lock on a file; one that cannot be tried counts as held.

    A file that is not there is held by nobody.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False
