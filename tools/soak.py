# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m tools.soak`: a long recorded run; memory of each process and speed, over time.

With `--stranger` somebody says anything on every topic meanwhile (`tools.strangers`); `--hostile`:
and uses what the world grants to anybody (pause, reset, step): the run is then another one, and
only `verify` can tell. Prints what is there every few seconds; at the end the longest time between
two steps, what was dropped, whether the learned tables are those of a run without ROS, what
`verify` says, and what is left in /dev/shm.
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import rclpy
import yaml
from rosgraph_msgs.msg import Clock

from sparse_coord_ros.nodes.interface import STEP_QOS
from sparse_coord_ros.nodes.shared_memory import FOLDER, leftovers
from sparse_coord_ros.nodes.spin import ros_context
from sparse_coord_ros.runlog import verify
from tools.teams import children, command, same_tables

PROGRESS = re.compile(rb" (\d+) of \d+ steps, ")
MEGABYTE = 1 << 20


class Onlooker:
    """Hears when time steps begin.

    Attributes:
        longest: seconds between two of them, at most.
        steps: how many it has heard of.
    """

    def __init__(self) -> None:
        self.longest, self.steps = 0.0, 0
        self._heard = self._at = 0.0

    def hear(self, said: Any) -> None:
        """Take a message of /clock; a stranger's time does not follow the last."""
        at, now = said.clock.sec + said.clock.nanosec / 1e9, time.monotonic()
        if 0 < at - self._at < 1.0:
            self.longest = max(self.longest, now - self._heard if self.steps else 0.0)
            self._heard, self._at, self.steps = now, at, self.steps + 1


def look(pid: int, log: Path) -> str:
    """Return the newest step that the world has told of, and what each process holds.

    Raises:
        OSError: one of them has just ended.
    """
    steps = [int(found) for found in PROGRESS.findall(log.read_bytes()[-4096:])][-1:]
    told = []
    for name, own in {"run": pid, **children(pid)}.items():
        pages = int(Path(f"/proc/{own}/statm").read_text().split()[1])
        told.append(f"{name} {pages * os.sysconf('SC_PAGE_SIZE') / MEGABYTE:.1f} MB")
    return f"step {steps[0] if steps else 0}: {', '.join(told)}"


def watch(run: subprocess.Popen[bytes], log: Path, every: float, stranger: list[str]) -> float:
    """Look at a run until it has ended; return the longest time between two steps.

    Args:
        run: its process.
        log: what it prints.
        every: seconds between two looks.
        stranger: the command of one that comes once it is under way; empty: nobody.
    """
    onlooker, guest, due = Onlooker(), None, time.monotonic() + every
    with ros_context() as context:
        node = rclpy.create_node("onlooker", context=context)
        node.create_subscription(Clock, "/clock", onlooker.hear, STEP_QOS)
        executor = rclpy.executors.SingleThreadedExecutor(context=context)
        executor.add_node(node)
        while run.poll() is None:
            executor.spin_once(timeout_sec=0.05)
            if stranger and guest is None and onlooker.steps:
                guest = subprocess.Popen(stranger)
            if time.monotonic() > due:
                due += every
                with suppress(OSError):
                    print(look(run.pid, log), flush=True)
        if guest is not None:
            guest.send_signal(signal.SIGINT)
            guest.wait()
        node.destroy_node()
    return onlooker.longest


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, watch, print."""
    parser = argparse.ArgumentParser(prog="python -m tools.soak", description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--rate", default="0", help="time steps a second (default: all it can)")
    parser.add_argument("--processes", action="store_true", help="every node its own process")
    parser.add_argument("--every", type=float, default=10.0, help="seconds between two looks")
    parser.add_argument("--stranger", action="store_true", help="who says anything everywhere")
    parser.add_argument("--hostile", action="store_true", help="who also pauses, resets and steps")
    options = parser.parse_args(arguments)
    stranger = [sys.executable, "-m", "tools.strangers", "--seconds", "99999"]
    stranger += ["--hostile"] * options.hostile
    before = set(leftovers())
    with tempfile.TemporaryDirectory(prefix="sparse_coord_soak_") as name:
        out, log = Path(name) / "run", Path(name) / "log"
        words = ["run", "env1", "--steps", str(options.steps), "--rate", options.rate]
        words += ["--processes"] * options.processes
        with log.open("wb") as file:
            run = subprocess.Popen(
                command("sparse_coord", *words, "--out", str(out)), stdout=file, stderr=file
            )
            hostile = options.stranger or options.hostile
            longest = watch(run, log, options.every, stranger if hostile else [])
        summary = yaml.safe_load((out / "summary.yaml").read_text())
        size = sum(path.stat().st_size for path in out.glob("bag/*.mcap"))
        print(
            f"{summary['transitions']} steps in {summary['seconds']:.0f} s, exit code "
            f"{run.returncode}, {summary['timeouts']} timeouts, {longest:.2f} s between two steps "
            f"at most, {summary['messages_dropped']} messages dropped, "
            f"{'a' if b'Traceback' in log.read_bytes() else 'no'} traceback, bag of "
            f"{size / 1e6:.0f} MB, tables {'as' if same_tables(out) else 'OTHER than'} without ROS"
        )
        found = verify(out)
        odd = "; ".join(str(one) for one in (*found.differences, *found.open)[:3])
        print(f"verify: {found.foreign} foreign messages, {odd or 'identical'}")
    left = [path.name for path in leftovers() if path not in before]
    print(f"left in {FOLDER}: {', '.join(left) or 'nothing'}")
    return run.returncode


if __name__ == "__main__":
    sys.exit(main())
