# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Can nodes find each other: ROS's environment variables, interfaces, ports, firewalls."""

import fcntl
import os
import re
import socket
import struct
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from sparse_coord_ros.doctor.findings import FINE, HINT, WRONG, Finding

DOMAIN, RANGE = "ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"
RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
HIGHEST_DOMAIN = 232

PORT_BASE, DOMAIN_GAIN, FIRST_UNICAST, PARTICIPANT_GAIN = 7400, 250, 10, 2
"""Of DDS: domain d multicasts on 7400 + 250 d; participant i of a machine hears its discovery on
7410 + 250 d + 2 i."""

MOST_LOCAL = 32
"""Participants of a machine that find each other with the range LOCALHOST."""

UP, LOOPBACK, MULTICAST = 0x1, 0x8, 0x1000
"""Flags of an interface (Linux)."""

GET_FLAGS, NAME_BYTES = 0x8913, 16
"""Linux's SIOCGIFFLAGS; its answer is the interface's name, then the flags."""

PORTS = "7400 + 250 * ROS_DOMAIN_ID"


def environment(variables: Mapping[str, str] = os.environ) -> Iterator[Finding]:
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
    span = variables.get(RANGE, "")
    if span.upper() not in ("", *RANGES):
        yield Finding(
            WRONG,
            "discovery",
            f"{RANGE} is {span!r}, allowed: {', '.join(RANGES)}",
            f"unset {RANGE}",
        )
    elif span.upper() == "OFF":
        yield Finding(
            WRONG,
            "discovery",
            f"{RANGE} is OFF: no node finds another",
            f"export {RANGE}=LOCALHOST (this machine) or SUBNET (the network)",
        )
    else:
        where = "this machine only" if span.upper() == "LOCALHOST" else "this network"
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


def domain(variables: Mapping[str, str] = os.environ) -> int:
    """Return the ROS domain; 0 where the variable is no domain."""
    text = variables.get(DOMAIN, "")
    return int(text) if text.isdecimal() and int(text) <= HIGHEST_DOMAIN else 0


def interfaces(found: Mapping[str, int] | None = None) -> Iterator[Finding]:
    """Look at the network interfaces; on Linux only.

    Args:
        found: the flags of each; None: those of this machine.
    """
    found = interface_flags() if found is None else found
    if found is None:
        return
    up = {name: flags for name, flags in sorted(found.items()) if flags & UP}
    others = [name for name, flags in up.items() if not flags & LOOPBACK]
    if not any(flags & LOOPBACK for flags in up.values()):
        yield Finding(WRONG, "interfaces", "the loopback is down", "sudo ip link set lo up")
    if not others:
        yield Finding(HINT, "interfaces", "only the loopback: no other machine can be found")
    elif not any(up[name] & MULTICAST for name in others):
        yield Finding(
            HINT,
            "interfaces",
            f"{', '.join(others)}: no multicast, so other machines are not found by themselves",
            "name them: export ROS_STATIC_PEERS='ADDRESS;ADDRESS'",
        )
    else:
        yield Finding(FINE, "interfaces", f"up: {', '.join(up)}")


def interface_flags() -> dict[str, int] | None:
    """Return the flags of each interface of this process's network; None where Linux is not."""
    if sys.platform != "linux":
        return None
    found = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        for _, name in socket.if_nameindex():
            with suppress(OSError):  # it has just gone
                asked = struct.pack("40s", name.encode())
                answer = fcntl.ioctl(any_socket, GET_FLAGS, asked)
                found[name] = struct.unpack_from("H", answer, NAME_BYTES)[0]
    return found


def ports(number: int, tables: tuple[Path, ...] = ()) -> Iterator[Finding]:
    """Look at who is in the domain on this machine; on Linux only.

    Args:
        number: the domain.
        tables: where Linux lists UDP ports; empty: its own.
    """
    taken = udp_ports(tables or (Path("/proc/net/udp"), Path("/proc/net/udp6")))
    if taken is None:
        return
    first = PORT_BASE + DOMAIN_GAIN * number
    places = range(first + FIRST_UNICAST, first + DOMAIN_GAIN, PARTICIPANT_GAIN)
    there = sum(port in taken for port in places)
    said = f"domain {number}: UDP ports from {first}, {there} participants on this machine"
    low = _first_ephemeral()
    if there >= MOST_LOCAL:
        yield Finding(
            HINT,
            "ports",
            said,
            f"with {RANGE}=LOCALHOST only {MOST_LOCAL} find each other; use another {DOMAIN}",
        )
    elif low and first + DOMAIN_GAIN > low:
        yield Finding(
            HINT,
            "ports",
            f"domain {number} has UDP ports from {first}, which other programs are lent",
            f"use a {DOMAIN} up to {(low - PORT_BASE) // DOMAIN_GAIN - 1}",
        )
    else:
        yield Finding(FINE, "ports", said)


def udp_ports(tables: tuple[Path, ...]) -> set[int] | None:
    """Return the UDP ports in use; None where the system does not say."""
    found: set[int] = set()
    read = False
    for table in tables:
        try:
            lines = table.read_text().splitlines()[1:]
        except OSError:
            continue
        read = True
        found |= {int(line.split()[1].rpartition(":")[2], 16) for line in lines if line.strip()}
    return found if read else None


def _first_ephemeral() -> int:
    try:
        return int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    except (OSError, ValueError, IndexError):
        return 0


def surroundings(root: Path = Path("/")) -> Iterator[Finding]:
    """Look at what may stand between nodes: a firewall, a container, WSL.

    Args:
        root: of the file system.
    """
    walls = []
    ufw = _text(root / "etc/ufw/ufw.conf")
    if re.search(r"^ENABLED=yes", ufw, re.MULTILINE | re.IGNORECASE):
        walls.append(("ufw is on", "sudo ufw allow in proto udp from NETWORK, and to 224.0.0.0/4"))
    if (root / "run/firewalld").exists():
        walls.append(("firewalld runs", "sudo firewall-cmd --add-source=NETWORK --zone=trusted"))
    for text, remedy in walls:
        yield Finding(
            HINT,
            "firewall",
            f"{text}: it may stop robots on other machines (UDP, {PORTS})",
            f"{remedy}, NETWORK e.g. 192.168.1.0/24",
        )
    if "microsoft" in _text(root / "proc/version").lower():
        yield Finding(
            HINT,
            "WSL",
            "this is WSL: with its own network other machines do not find it",
            "for robots on the network set networkingMode=mirrored in .wslconfig",
        )
    inside = (root / ".dockerenv").exists() or (root / "run/.containerenv").exists()
    if inside:
        yield Finding(
            HINT,
            "container",
            "this is a container: others find it only with their network and shared memory",
            "docker run --network=host --ipc=host, the same user id in all of them",
        )


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""
