# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Environment variables of the middleware: checked and set before ROS starts."""

import os
import re
import sys
from collections.abc import Mapping, MutableMapping
from pathlib import Path

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.base.share import share_folder

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILES_3 = "FASTDDS_DEFAULT_PROFILES_FILE"
"""The file of profiles of Fast DDS 2 (ROS 2 Jazzy), and of Fast DDS 3 (Kilted)."""

DOMAIN = "ROS_DOMAIN_ID"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PEERS = "ROS_STATIC_PEERS"
LAST_DOMAIN = 232
"""The last domain that has ports of DDS."""


def ros_domain(variables: Mapping[str, str] = os.environ) -> int:
    """Return the ROS domain that these environment variables choose; unset or empty: 0.

    Raises:
        RunError: DDS has no such domain. Leading zeros are refused, as ROS would read the rest as
            an octal number.
    """
    domain = variables.get(DOMAIN, "").strip() or "0"
    if not re.fullmatch("0|[1-9][0-9]{0,2}", domain) or int(domain) > LAST_DOMAIN:
        allowed = f"a whole number from 0 to {LAST_DOMAIN}, without leading zeros"
        raise RunError(f"{DOMAIN} is {domain!r}, allowed: {allowed}")
    return int(domain)


FAST_DDS_2 = "libfastrtps.so"
FAST_DDS_3 = "libfastdds.so"

SECURITY = "ROS_SECURITY_ENABLE"
SECURITY_MARK = b"dds.sec.auth.plugin"
"""A name that only a Fast DDS with DDS-Security contains."""


def check_security() -> None:
    """Refuse to start where the user wants DDS-Security and the installed Fast DDS has none.

    The Fast DDS of the PyPI wheels has none. Others, such as that of the apt packages, have it.

    Raises:
        RunError: the messages would not be secured.
    """
    if os.environ.get(SECURITY, "").lower() != "true":
        return
    library = _library(FAST_DDS_2) or _library(FAST_DDS_3)
    if library is None:
        return
    if SECURITY_MARK not in library.read_bytes():
        raise RunError(
            f"{SECURITY} asks for DDS-Security, but this Fast DDS ({library}, from PyPI) is built "
            "without it and nothing would be secured; use ROS 2's apt packages "
            "(docs/interface.md#security), or unset it"
        )


def use_udp(variables: MutableMapping[str, str] = os.environ) -> None:
    """Let the nodes of this process talk by UDP, as `config/fastdds.xml` says.

    With shared memory, Fast DDS's default, one process that stands still slows the whole team, and
    may hear nothing any more. In the range LOCALHOST rmw_fastrtps ignores the transports of
    profiles. So the range becomes SYSTEM_DEFAULT, and `config/fastdds_localhost.xml` stays on this
    machine. Profiles that the user has chosen stay. Other middlewares ignore these settings.
    """
    if PROFILES in variables or PROFILES_3 in variables:
        return
    where = ""
    # SYSTEM_DEFAULT would ignore peers
    if variables.get(RANGE, "").upper() == "LOCALHOST" and not variables.get(PEERS):
        where = "_localhost"
        variables[RANGE] = "SYSTEM_DEFAULT"
    name, version = (PROFILES_3, "3") if _library(FAST_DDS_3) else (PROFILES, "")
    variables[name] = str(share_folder("config") / f"fastdds{version}{where}.xml")


def _library(name: str) -> Path | None:
    """Return the path of a library of ROS 2, or None."""
    folders = [Path(sys.prefix) / "lib"]
    folders += map(Path, filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(":")))
    paths = [folder / name for folder in folders]
    return next((path for path in paths if path.exists()), None)
