# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files of Fast DDS that killed processes left in shared memory.

Fast DDS keeps a segment for each participant in /dev/shm. A process that ends removes its own;
SIGKILL leaves them there, half a megabyte each time. A lock file beside each is locked while its
owner lives, so that leftovers of any program can be recognised (`fastdds shm clean` does the
same). Ports (50 kB each) stay: the next processes use them again.
"""

import fcntl
import os
import re
import time
from collections import defaultdict
from contextlib import ExitStack, suppress
from pathlib import Path

FOLDER = Path("/dev/shm")

SEGMENT = re.compile(r"(?P<name>fast(?:rtps|dds)_[0-9a-f]{16})(?P<lock>_[es]l)?")
"""A segment's file, or its lock file."""

YOUNG_SECONDS = 2.0
"""Files that are younger may be about to be locked."""


def leftovers(folder: Path = FOLDER, *, remove: bool = False) -> list[Path]:
    """Return the files of segments that no living process holds, sorted.

    Args:
        folder: the directory of the shared memory.
        remove: remove them, and return the removed files. Files of other users stay, as this
            process may not remove them. Young files stay too, as their owner may be about to lock
            them.
    """
    found: defaultdict[str, list[Path]] = defaultdict(list)
    with suppress(OSError):
        for path in sorted(folder.iterdir()):
            match = SEGMENT.fullmatch(path.name)
            if match:
                found[match["name"]].append(path)
    of_segments = [files for name, files in found.items() if files[-1].name != name]
    return sorted(
        path for files in of_segments if _free(files, remove) for path in files
    )


def _free(files: list[Path], remove: bool) -> bool:
    """Return whether a segment's files are unused; they are removed under their locks."""
    with suppress(OSError), ExitStack() as stack:
        age = time.time() - max(path.lstat().st_mtime for path in files)
        if remove and age < YOUNG_SECONDS:
            return False
        for path in files:
            descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
            stack.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for path in files if remove else ():
            path.unlink()
        return True
    return (
        False  # its owner lives, or it is another user's, or it has just been removed
    )
