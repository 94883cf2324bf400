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


SECURITY = "ROS_SECURITY_ENABLE"
SECURITY_MARK = b"dds.sec.auth.plugin"
"""A name that only a Fast DDS with DDS-Security contains."""


def check_security() -> None:
    """Refuse to start where the user wants DDS-Security and the installed Fast DDS has none.

    The Fast DDS of the PyPI wheels has none. Others, such as that of the apt packages, have it.

    Raises:
        RunError: the messages would not be secured.
    """
    library = Path(sys.prefix) / "lib" / "libfastrtps.so"
    if os.environ.get(SECURITY, "").lower() != "true" or not library.exists():
        return
    if SECURITY_MARK not in library.read_bytes():
        raise RunError(
            f"{SECURITY} asks for DDS-Security, but this Fast DDS ({library}, from PyPI) is built "
            "without it and nothing would be secured; use ROS 2's apt packages "
            "(docs/reliability.md), or unset it"
        )


def use_udp(variables: MutableMapping[str, str] = os.environ) -> None:
    """Let the nodes of this process talk by UDP, as `config/fastdds.xml` says.

    With shared memory, Fast DDS's default, one process that stands still slows the whole team, and
    may hear nothing any more. In the range LOCALHOST rmw_fastrtps ignores the transports of
    profiles. So the range becomes SYSTEM_DEFAULT, and `config/fastdds_localhost.xml` stays on this
    machine. Profiles that the user has chosen stay. Other middlewares ignore these settings.
    """
    if PROFILES in variables:
        return
    profiles = "fastdds.xml"
    # SYSTEM_DEFAULT would ignore peers
    if variables.get(RANGE, "").upper() == "LOCALHOST" and not variables.get(PEERS):
        profiles = "fastdds_localhost.xml"
        variables[RANGE] = "SYSTEM_DEFAULT"
    variables[PROFILES] = str(share_folder("config") / profiles)
