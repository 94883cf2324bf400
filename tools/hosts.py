# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m tools.hosts`: a team on several hosts, with frames lost and late between them.

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

import sparse_coord_ros as sc
from sparse_coord_ros.learn.run_config import load_run
from sparse_coord_ros.learn.simulation import tables_equal
from sparse_coord_ros.learn.tables import load_team
from sparse_coord_ros.wire import WORLD

INSIDE = "SPARSE_COORD_HOSTS"
"""Set in the environment once this program runs in namespaces of its own."""

PATIENCE_SECONDS = 300.0
FRAME_BYTES = 65536
FIRST = 2
"""The first host's address is 10.77.0.2."""


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
            ["unshare", "-rnm", "ip", "link", "add", "sc0", "type", "veth", "peer", "name", "sc1"],
            capture_output=True,
            text=True,
            check=False,
        )
    except FileNotFoundError as error:
        return f"{error.filename} is missing: install iproute2 and util-linux"
    return " ".join(done.stderr.split())


class Hosts:
    """Hosts on cables to a hub.

    Args:
        count: how many hosts.
        loss, delay: as `Condition`.
        seed: of the losses.
    """

    def __init__(self, count: int, loss: float, delay: float, seed: int = 0) -> None:
        self._stack = contextlib.ExitStack()
        self._holders: list[int] = []
        ends = [f"hub{k}" for k in range(count)]
        try:
            for k, end in enumerate(ends):
                self._add(k, end)
            words = [sys.executable, __file__, "--hub", *ends]
            self._start([*words, "--loss", str(loss), "--delay", str(delay), "--seed", str(seed)])
        except BaseException:
            self.close()
            raise

    def _start(self, command: Sequence[str], **options) -> subprocess.Popen:
        process = subprocess.Popen(command, **options)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process

    def _add(self, k: int, end: str) -> None:
        """Make a host: the namespaces of a process that does nothing, and a cable."""
        script = "mount -t tmpfs none /dev/shm && echo ready && exec sleep infinity"
        holder = self._start(
            ["unshare", "--net", "--mount", "sh", "-c", script], stdout=subprocess.PIPE, text=True
        )
        assert holder.stdout is not None
        if holder.stdout.readline() != "ready\n":
            raise RuntimeError("a namespace could not be made; see the line above")
        self._holders.append(holder.pid)
        cable = f"ip link add {end} type veth peer name eth0 netns {holder.pid}"
        subprocess.run(cable.split(), check=True)
        subprocess.run(f"ip link set {end} up promisc on".split(), check=True)
        inside = [
            f"ip address add 10.77.0.{FIRST + k}/24 dev eth0",
            "ip link set lo up",
            "ip link set eth0 up",
            "ip route add 224.0.0.0/4 dev eth0",
        ]
        for line in inside:
            subprocess.run(self._enter(k) + line.split(), check=True)
        whole = [sys.executable, __file__, "--whole-checksums"]
        subprocess.run(self._enter(k) + whole, check=True)

    def _enter(self, host: int) -> list[str]:
        return ["nsenter", "-t", str(self._holders[host]), "--net", "--mount"]

    def start(self, host: int, command: Sequence[str], **options) -> subprocess.Popen:
        """Start a process on a host; `close` ends it."""
        return self._start(self._enter(host) + list(command), **options)

    def close(self) -> None:
        """End all that was started; the namespaces go with it."""
        self._stack.close()


def whole_checksums() -> None:
    """Let this host compute checksums itself: a virtual cable would leave them to a card."""
    set_checksum, ioctl = 0x17, 0x8946  # ETHTOOL_STXCSUM, SIOCETHTOOL
    wish = ctypes.create_string_buffer(struct.pack("II", set_checksum, 0))
    request = struct.pack("16sP", b"eth0", ctypes.addressof(wish)) + bytes(16)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, ioctl, request)


def hub(ends: Sequence[str], loss: float, delay: float, seed: int) -> None:
    """Hand each frame that comes in at one end to all others, until this process is killed."""
    every_protocol = 3  # ETH_P_ALL
    cables = {}
    for end in ends:
        cable = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(every_protocol))
        cable.bind((end, 0))
        cables[cable.fileno()] = cable
    chance, count = random.Random(seed), itertools.count()
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


def node(executable: str, name: str, **parameters: str) -> list[str]:
    """Return the command of a node."""
    command = [sys.executable, "-m", "sparse_coord_ros.executables", executable, "--ros-args"]
    command += ["-r", f"__node:={name}"]
    for key, value in parameters.items():
        command += ["-p", f"{key}:={value}"]
    return command


def team(condition: Condition, scenario: str, seed: int) -> tuple[dict, bool]:
    """Run a team on hosts of its own.

    Returns:
        The world's summary, and whether the tables are those of a run without ROS.
    """
    problem = sc.load_scenario(scenario, steps=condition.steps)
    names = [robot.name for robot in problem.robots]
    with tempfile.TemporaryDirectory(prefix="sparse_coord_hosts_") as folder:
        out = Path(folder) / "run"
        with (
            contextlib.closing(
                Hosts(1 + len(names), condition.loss, condition.delay, seed)
            ) as hosts,
            (Path(folder) / "log").open("w+") as log,
        ):
            said = {"stdout": log, "stderr": log}
            given = {"scenario": scenario, "set": f"['steps={condition.steps}']", "out": str(out)}
            members = [hosts.start(0, node("world_simulator", WORLD, **given), **said)]
            for k, name in enumerate(names):
                robot = node("robot", name, out=str(out))
                members.append(hosts.start(1 + k, robot, **said))
            for member in members:
                if member.wait(PATIENCE_SECONDS):
                    log.seek(0)
                    raise RuntimeError(f"a node failed:\n{log.read()}")
        summary = yaml.safe_load((out / "summary.yaml").read_text())
        alone = sc.train(problem)
        same = tables_equal(load_team(out, load_run(out).scenario), alone.tables)
    return summary, same


def table(conditions: Sequence[Condition], scenario: str, seed: int) -> Iterator[str]:
    """Yield the lines of a Markdown table, as they are measured."""
    yield "| between the hosts | steps/s | timeouts | tables |"
    yield "|---|--:|--:|---|"
    for condition in conditions:
        summary, same = team(condition, scenario, seed)
        verdict = "the same bits" if same else "others"
        said = f"{summary['steps_per_second']:.0f} | {summary['timeouts']} | {verdict}"
        yield f"| {condition.name} | {said} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, or be one of the processes that this needs."""
    parser = argparse.ArgumentParser(prog="python -m tools.hosts", description=__doc__)
    parser.add_argument("--scenario", default="env1")
    parser.add_argument("--seed", type=int, default=0, help="of the losses")
    parser.add_argument("--only", type=int, choices=range(len(CONDITIONS)), help="one condition")
    parser.add_argument("--hub", nargs="+", help=argparse.SUPPRESS)
    parser.add_argument("--loss", type=float, default=0.0, help=argparse.SUPPRESS)
    parser.add_argument("--delay", type=float, default=0.0, help=argparse.SUPPRESS)
    parser.add_argument("--whole-checksums", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.hub:
        hub(options.hub, options.loss, options.delay, options.seed)
    elif options.whole_checksums:
        whole_checksums()
    elif INSIDE not in os.environ:
        why = refusal()
        if why:
            print(f"no namespaces here: {why}", file=sys.stderr)
            return 2
        command = ["unshare", "-rnm", sys.executable, __file__]
        command += sys.argv[1:] if arguments is None else arguments
        subnet = {INSIDE: "1", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
        return subprocess.run(command, env={**os.environ, **subnet}, check=False).returncode
    else:
        chosen = CONDITIONS if options.only is None else [CONDITIONS[options.only]]
        for line in table(chosen, options.scenario, options.seed):
            print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
