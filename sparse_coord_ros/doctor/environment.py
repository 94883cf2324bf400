# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What may keep nodes apart: ROS's environment variables, and a full shared memory."""

import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

from sparse_coord_ros.doctor.findings import FINE, HINT, WRONG, Finding

DOMAIN, RANGE = "ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"
RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
HIGHEST_DOMAIN = 232
SHARED_MEMORY = Path("/dev/shm")

PARTICIPANT = 600_000
"""Bytes of shared memory that a process with ROS takes: its segment, and a port."""


def discovery(variables: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Look at ROS's environment variables."""
    text = variables.get(DOMAIN, "")
    if text and not (text.isdecimal() and int(text) <= HIGHEST_DOMAIN):
        yield Finding(
            WRONG,
            "discovery",
            f"{DOMAIN} is {text!r}, allowed: a whole number from 0 to {HIGHEST_DOMAIN}",
            f"export {DOMAIN}=0, the same for all robots of a team",
        )
    else:
        yield Finding(FINE, "discovery", f"{DOMAIN} {text or '0 (not set)'}")
    span = variables.get(RANGE, "").upper()
    if span not in ("", *RANGES):
        problem = f"{RANGE} is {span!r}, allowed: {', '.join(RANGES)}"
        yield Finding(WRONG, "discovery", problem, f"unset {RANGE}")
    elif span == "OFF":
        yield Finding(
            WRONG,
            "discovery",
            f"{RANGE} is OFF: no node finds another",
            f"export {RANGE}=LOCALHOST (this machine) or SUBNET (the network)",
        )
    else:
        where = "this machine only" if span == "LOCALHOST" else "this network"
        yield Finding(FINE, "discovery", f"{RANGE} {span or 'SUBNET (not set)'}: {where}")
    if variables.get("ROS_LOCALHOST_ONLY", "0") not in ("", "0"):
        yield Finding(
            HINT,
            "discovery",
            "ROS_LOCALHOST_ONLY is set, which Jazzy deprecates: it overrides the range",
            f"unset ROS_LOCALHOST_ONLY; export {RANGE}=LOCALHOST",
        )
    for name in ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        if variables.get(name):
            yield Finding(FINE, "discovery", f"{name} is {variables[name]}")


def shared_memory(folder: Path = SHARED_MEMORY) -> Iterator[Finding]:
    """Look at the shared memory by which nodes on one machine talk.

    Args:
        folder: where it is.
    """
    from sparse_coord_ros.nodes.shared_memory import leftovers

    if not folder.is_dir():
        return
    left = leftovers(folder)
    free = shutil.disk_usage(folder).free
    if left:
        yield Finding(
            HINT,
            "shared memory",
            f"{len(left)} files of processes that are gone in {folder}",
            "harmless until it is full; remove them: sparse_coord doctor --clean",
        )
    if free < 16 * PARTICIPANT:
        yield Finding(
            HINT,
            "shared memory",
            f"{folder} has {free / 1e6:.0f} MB free; a process with ROS takes 0.6 MB; "
            "those that get none talk by UDP",
            "remove leftovers, or give a container more (docker run --ipc=host)",
        )
