# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks: is this package completely installed, does numba compile, can nodes connect?"""

import os
import platform
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from sparse_coord_ros.base import compiling
from sparse_coord_ros.base.errors import RunError, message_of
from sparse_coord_ros.base.share import PACKAGE, share_folder
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.ros.nodes.environment import (
    DOMAIN,
    PEERS,
    PROFILES,
    PROFILES_3,
    RANGE,
    ros_domain,
)

FINE = "ok"
HINT = "hint"
WRONG = "wrong"
"""It works; it works, with a hint or a surprise; it does not work."""

RANGES = {
    "SUBNET": "this network",
    "SYSTEM_DEFAULT": "the system's",
    "LOCALHOST": "this machine",
}
"""The ranges in which nodes find each other."""

ALSO = ("ROS_LOCALHOST_ONLY", PEERS, "ROS_DISCOVERY_SERVER", PROFILES, PROFILES_3)
"""Further variables that decide which nodes hear each other."""


class Finding(NamedTuple):
    """One finding.

    Attributes:
        level: FINE, HINT or WRONG.
        part: the subject, in a word or two.
        text: the result, one line.
        remedy: the remedy; empty: not needed.
    """

    level: str
    part: str
    text: str
    remedy: str = ""


def installation() -> Finding:
    """Check this package; `pip check` reports whether its requirements fit."""
    here = f"{__version__} in {Path(__file__).parents[2]}, Python {platform.python_version()}"
    again = "install it again: pip install -e . (or make clean, then make test)"
    try:
        share_folder("config")
        installed = metadata.version(PACKAGE)
    except FileNotFoundError as error:
        return Finding(WRONG, "package", str(error), again)
    except metadata.PackageNotFoundError:
        return Finding(HINT, "package", f"{here}, found by its path alone", again)
    if installed != __version__:
        return Finding(
            WRONG, "package", f"{here}, but {installed} is what pip installed", again
        )
    return Finding(FINE, "package", here)


def compiler() -> Finding:
    """Check numba: is it installed, does it compile, where is its cache?"""
    try:
        numba = compiling.numba()
        numba.njit(lambda number: number + 1)(1)
    except ModuleNotFoundError:
        text = (
            "is not installed: results are the same, but train and batches are a hundred "
            "times slower"
        )
        return Finding(HINT, "numba", text, "pip install numba")
    except Exception as error:  # a broken installation may raise any exception
        text = f"does not work: {message_of(error)}"
        return Finding(WRONG, "numba", text, "pip install --upgrade numba numpy")
    folder = compiling.folder()
    if folder is None:
        text = (
            f"{numba.__version__} compiles, but cannot store the result: each process "
            "compiles for some seconds"
        )
        remedy = f"make ~/.cache writable, or export {compiling.FOLDER_VARIABLE}=FOLDER"
        return Finding(HINT, "numba", text, remedy)
    return Finding(
        FINE,
        "numba",
        f"{numba.__version__} compiles, and stores the result in {folder}",
    )


def discovery(variables: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Check ROS's environment variables."""
    try:
        yield Finding(FINE, "discovery", f"{DOMAIN} {ros_domain(variables)}")
    except RunError as error:
        remedy = f"export {DOMAIN}=0, the same for all robots of a team"
        yield Finding(WRONG, "discovery", str(error), remedy)
    span = variables.get(RANGE, "").upper() or "SUBNET"
    if span in RANGES:
        yield Finding(FINE, "discovery", f"{RANGE} {span}: {RANGES[span]}")
    else:
        text = f"{RANGE} is {span!r}, so nodes do not find each other"
        remedy = f"export {RANGE}=LOCALHOST (this machine) or SUBNET (the network)"
        yield Finding(WRONG, "discovery", text, remedy)
    for name in ALSO:
        if variables.get(name):
            yield Finding(FINE, "discovery", f"{name} is {variables[name]}")
