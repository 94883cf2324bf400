# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Environment variables of the middleware: checked and set before ROS starts."""

import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.base.share import share_folder

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"


DOMAIN = "ROS_DOMAIN_ID"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
MOST_PARTICIPANTS = 32
"""Number of participants that find each other with the range LOCALHOST: rmw_fastrtps looks for the
first 32 of a domain (maxInitialPeersRange)."""


def check_participants(count: int) -> None:
    """Refuse to start more processes than can find each other on this machine.

    Raises:
        RunError: they are too many for the discovery range.
    """
    if os.environ.get(RANGE, "").upper() == "LOCALHOST" and count > MOST_PARTICIPANTS:
        raise RunError(
            f"{count} nodes in processes of their own: with {RANGE}=LOCALHOST at most "
            f"{MOST_PARTICIPANTS} find each other; use {RANGE}=SUBNET, or leave out --processes"
        )


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


def repair_promptly() -> None:
    """Let Fast DDS offer a lost message again after 10 ms; its own period is 3 s.

    On a busy machine its shared memory drops messages, and networks lose frames. In a short run
    the repeats would come after the end, or after they were overwritten. The profiles also
    let a reader hear a writer of its own process that has written much: see `config/fastdds.xml`.
    Profiles that the user has chosen stay, and other middlewares ignore this setting. Profiles in
    the current directory are skipped: Fast DDS would load them without a request, and they may
    name any file to write.
    """
    os.environ["SKIP_DEFAULT_XML_FILE"] = "1"
    os.environ.setdefault(PROFILES, _profiles("fastdds.xml"))


def one_host() -> dict[str, str]:
    """Return the environment for processes of a team that are all on this machine.

    Every reader answers each offer. Where no network loses messages, offers every 10 ms cost more
    than they save, so the period here is 50 ms. Profiles that the user has chosen stay.
    """
    chosen = os.environ.get(PROFILES, _profiles("fastdds.xml"))
    if chosen == _profiles("fastdds.xml"):
        chosen = _profiles("fastdds_one_host.xml")
    return {**os.environ, PROFILES: chosen}


def _profiles(name: str) -> str:
    return str(share_folder("config") / name)
