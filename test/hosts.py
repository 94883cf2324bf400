# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python test/hosts.py`: a team on several hosts, with frames lost and late between them.

Each host is a network namespace of its own with its own /dev/shm, on a virtual Ethernet cable. The
cables end in a hub: a process that hands each frame to all other hosts, late, or never (many
kernels have no netem). World on the first host, a robot on each other one. Needs `ip`, `unshare`
and a kernel that lets its user make namespaces; the machine's own network is not touched.
"""

import argparse
import contextlib
import ctypes
import fcntl
import heapq
import itertools
import multiprocessing
import os
import random
import select
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import yaml
from live_teams import command, node_words, same_tables

from sparse_coord_ros.protocol.wire import WORLD

INSIDE = "SPARSE_COORD_HOSTS"
"""Set in the environment once this program runs in namespaces of its own."""

ROBOTS = ("robot_1", "robot_2")
PATIENCE_SECONDS = 300.0
FRAME_BYTES = 65536


class Condition(NamedTuple):
    """What happens to frames between hosts.

    Attributes:
        name: what it is called in the table.
        loss: probability with which each frame is lost.
        delay: seconds that each takes.
        steps: time steps of the run.
    """

    name: str
    loss: float
    delay: float
    steps: int


CONDITIONS = (
    Condition("nothing", 0.0, 0.0, 2000),
    Condition("5 % of the frames lost", 0.05, 0.0, 1000),
    Condition("20 ms on the way", 0.0, 0.02, 300),
)


def refusal() -> str:
    """Return why this machine cannot do it, in one line; empty where it can."""
    try:
        done = subprocess.run(
            [
                "unshare",
                "-rnm",
                "ip",
                "link",
                "add",
                "sc0",
                "type",
                "veth",
                "peer",
                "name",
                "sc1",
            ],
            capture_output=True,
            text=True,
            check=False,
        )
    except FileNotFoundError as error:
        return f"{error.filename} is missing: install iproute2 and util-linux"
    return " ".join(done.stderr.split())


@contextlib.contextmanager
def hosts(count: int, condition: Condition) -> Iterator[list[list[str]]]:
    """Provide hosts on cables to a hub, each as the command that starts a command there."""
    ends = [f"hub{k}" for k in range(count)]
    with contextlib.ExitStack() as stack:
        entries = [stack.enter_context(_host(k, end)) for k, end in enumerate(ends)]
        handing = multiprocessing.get_context("fork").Process(
            target=hub, args=(ends, condition.loss, condition.delay)
        )
        handing.start()
        stack.callback(handing.join)
        stack.callback(handing.kill)
        yield entries


@contextlib.contextmanager
def _host(k: int, end: str) -> Iterator[list[str]]:
    """Make a host: the namespaces of a process that does nothing, and a cable."""
    subprocess.run(f"ip link add {end} type veth peer name eth{k}".split(), check=True)
    whole_checksums(f"eth{k}")
    script = "mount -t tmpfs none /dev/shm && echo ready && exec sleep infinity"
    with subprocess.Popen(
        ["unshare", "--net", "--mount", "sh", "-c", script],
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        try:
            assert holder.stdout is not None
            if holder.stdout.readline() != "ready\n":
                raise RuntimeError("a namespace could not be made; see the line above")
            enter = ["nsenter", "-t", str(holder.pid), "--net", "--mount"]
            subprocess.run(f"ip link set eth{k} netns {holder.pid}".split(), check=True)
            subprocess.run(f"ip link set {end} up promisc on".split(), check=True)
            for line in (
                f"ip address add 10.77.0.{k + 2}/24 dev eth{k}",
                "ip link set lo up",
                f"ip link set eth{k} up",
                f"ip route add 224.0.0.0/4 dev eth{k}",
            ):
                subprocess.run([*enter, *line.split()], check=True)
            yield enter
        finally:
            holder.kill()


def whole_checksums(card: str) -> None:
    """Let a host compute checksums itself: a virtual cable would leave them to a card."""
    set_checksum = 0x17
    ioctl = 0x8946  # ETHTOOL_STXCSUM, SIOCETHTOOL
    wish = ctypes.create_string_buffer(struct.pack("II", set_checksum, 0))
    request = struct.pack("16sP", card.encode(), ctypes.addressof(wish)) + bytes(16)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, ioctl, request)


def hub(ends: Sequence[str], loss: float, delay: float) -> None:
    """Hand each frame that comes in at one end to all others, until this process is killed."""
    every_protocol = 3  # ETH_P_ALL
    cables = {}
    for end in ends:
        cable = socket.socket(
            socket.AF_PACKET, socket.SOCK_RAW, socket.htons(every_protocol)
        )
        cable.bind((end, 0))
        cables[cable.fileno()] = cable
    chance = random.Random(0)
    count = itertools.count()
    waiting: list[tuple[float, int, int, bytes]] = []
    poll = select.poll()
    for number in cables:
        poll.register(number, select.POLLIN)
    while True:
        rest = max(0.0, waiting[0][0] - time.monotonic()) if waiting else 1.0
        for number, _ in poll.poll(1000 * rest):
            frame, (_, _, kind, *_) = cables[number].recvfrom(FRAME_BYTES)
            if kind == socket.PACKET_OUTGOING:
                continue
            due = time.monotonic() + delay
            for other in cables:
                if other != number and chance.random() >= loss:
                    heapq.heappush(waiting, (due, next(count), other, frame))
        while waiting and waiting[0][0] <= time.monotonic():
            _, _, other, frame = heapq.heappop(waiting)
            with contextlib.suppress(OSError):  # a cable that is full loses a frame
                cables[other].send(frame)


def row(condition: Condition) -> str:
    """Run a team of env1 on hosts of its own and return the row of the table."""
    with tempfile.TemporaryDirectory(prefix="sparse_coord_hosts_") as folder:
        out = Path(folder) / "run"
        problem = {"scenario": "env1", "steps": condition.steps}
        nodes = [command("world_simulator", *node_words(WORLD, out=out, **problem))]
        nodes += [command("robot", *node_words(name, out=out)) for name in ROBOTS]
        with hosts(len(nodes), condition) as entries:
            members = [
                subprocess.Popen([*enter, *node])
                for enter, node in zip(entries, nodes, strict=True)
            ]
            try:
                codes = [member.wait(PATIENCE_SECONDS) for member in members]
            finally:
                for member in members:
                    member.kill()
                    member.wait()
        if any(codes):
            raise RuntimeError(
                f"a node failed: exit codes {codes}; see the lines above"
            )
        summary = yaml.safe_load((out / "summary.yaml").read_text())
        verdict = "the same bits" if same_tables(out) else "others"
    rate = summary["steps_per_second"]
    timeouts = summary["timeouts"]
    return f"| {condition.name} | {rate:.0f} | {timeouts} | {verdict} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, in namespaces of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only", type=int, choices=range(len(CONDITIONS)), help="one condition"
    )
    options = parser.parse_args(arguments)
    if INSIDE not in os.environ:
        why = refusal()
        if why:
            print(f"no namespaces here: {why}", file=sys.stderr)
            return 2
        own = ["unshare", "-rnm", sys.executable, __file__]
        own += sys.argv[1:] if arguments is None else arguments
        subnet = {INSIDE: "1", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
        return subprocess.run(own, env={**os.environ, **subnet}, check=False).returncode
    print("| between the hosts | steps/s | timeouts | tables |\n|---|--:|--:|---|")
    for condition in CONDITIONS if options.only is None else [CONDITIONS[options.only]]:
        print(row(condition), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
