# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ROS domains that no other test and no team of the user on this machine is in."""

import random
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from patience import PATIENCE_SECONDS

DOMAINS = (*range(1, 99), *range(215, 232))
"""ROS domains whose ports are not those that Linux hands out by itself; 99 and 100 are left for
the tests of this module."""

FIRST_PORT = 7400
PORTS_OF_A_DOMAIN = 250
"""DDS: a domain's ports begin here, so many after those of the one before."""

PARTICIPANTS = 40
"""Of a domain, that are looked for."""


@contextmanager
def ros_domain(domains: Sequence[int] = DOMAINS) -> Iterator[int]:
    """Take a ROS domain that no other test and no ROS node on this machine is in.

    A socket in the abstract namespace holds it against other tests, whichever suite they belong
    to; it is gone with its process.

    Args:
        domains: to choose from.

    Raises:
        TimeoutError: all are in use.
    """
    deadline = time.monotonic() + PATIENCE_SECONDS / 2
    while time.monotonic() < deadline:
        for domain in random.Random().sample(domains, len(domains)):
            with socket.socket(socket.AF_UNIX) as holder:
                try:
                    holder.bind(f"\0sparse_coord_test_domain_{domain}")
                except OSError:
                    continue
                if is_free(domain):
                    yield domain
                    return
        time.sleep(0.05)
    raise TimeoutError("all ROS domains are in use")


def is_free(domain: int) -> bool:
    """Whether no participant of DDS on this machine listens on a discovery port of a domain.

    It listens on the multicast port, which all share, and on a port of its own.
    """
    multicast = FIRST_PORT + PORTS_OF_A_DOMAIN * domain
    ports = [
        multicast,
        *(multicast + 10 + 2 * number for number in range(PARTICIPANTS)),
    ]
    with ExitStack() as stack:
        for port in ports:
            try:
                stack.enter_context(socket.socket(type=socket.SOCK_DGRAM)).bind(
                    ("", port)
                )
            except OSError:
                return False
    return True
