# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Can we write where we must, and what did dead processes leave in shared memory?"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from sparse_coord_ros.doctor.findings import FINE, HINT, WRONG, Finding

SHARED_MEMORY = Path("/dev/shm")
LITTLE = 200 << 20
"""Free bytes on a disk below which recording may soon end."""

PARTICIPANT = 600_000
"""Bytes of shared memory that a process with ROS takes: its segment, and a port."""


def places() -> Iterator[Finding]:
    """Try to write where runs, logs and temporary files go."""
    yield writable("here", Path.cwd(), "go to a folder of your own, or give --out")
    yield writable("temporary files", Path(tempfile.gettempdir()), "export TMPDIR=FOLDER")
    yield writable("ROS logs", ros_logs(), "export ROS_LOG_DIR=FOLDER")


def ros_logs() -> Path:
    """Return where ROS writes its logs."""
    named = os.environ.get("ROS_LOG_DIR")
    home = Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")
    return Path(named).expanduser() if named else home.expanduser() / "log"


def writable(what: str, folder: Path, remedy: str) -> Finding:
    """Say whether a folder, or the one that it will be made in, can be written.

    Args:
        what: what is written there.
        folder: it need not be there yet.
        remedy: what else to do.
    """
    try:
        there = next(one for one in (folder, *folder.parents) if one.exists())
        with tempfile.TemporaryFile(dir=there) as file:
            file.write(bytes(1 << 16))
    except OSError as error:
        problem = f"{folder} cannot be written ({error.strerror})"
        return Finding(WRONG, "write access", f"{what}: {problem}", remedy)
    free = shutil.disk_usage(there).free
    text = f"{what}: {folder}, {free / 1e9:.1f} GB free"
    if free < LITTLE:
        return Finding(HINT, "write access", text, "make room: recorded runs need it")
    return Finding(FINE, "write access", text)


def shared_memory(folder: Path = SHARED_MEMORY) -> Iterator[Finding]:
    """Look at the shared memory by which nodes on one machine talk.

    Args:
        folder: where it is.
    """
    from sparse_coord_ros.nodes.shared_memory import leftovers

    if not folder.is_dir():
        return
    left = leftovers(folder)
    if left:
        size = sum(path.stat().st_size for path in left if path.exists())
        yield Finding(
            HINT,
            "shared memory",
            f"{len(left)} files of processes that are gone, {size / 1e6:.1f} MB in {folder}",
            "harmless until it is full; remove them: sparse_coord doctor --clean",
        )
    free = shutil.disk_usage(folder).free
    if free < 16 * PARTICIPANT:
        yield Finding(
            HINT,
            "shared memory",
            f"{folder} has {free / 1e6:.0f} MB free; a process with ROS takes 0.6 MB; "
            "those that get none talk by UDP",
            "remove leftovers, or give a container more (docker run --ipc=host)",
        )
    elif not left:
        text = f"{folder}: no leftovers, {free / 1e6:.0f} MB free"
        yield Finding(FINE, "shared memory", text)
