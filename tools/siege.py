# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m tools.siege`: a recorded team while a stranger says anything on every topic.

Prints the longest time between two steps, the memory of each process, what was dropped, whether
the learned tables are those of a run without ROS, and what `verify` says. `--hostile` also uses
what the world grants to anybody (pause, reset, step): the run is then another one, and only
`verify` can tell. `--alone`: without a stranger, to compare.
"""

import argparse
import itertools
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
import yaml
from rosgraph_msgs.msg import Clock

from sparse_coord_ros.nodes.interface import STEP_QOS
from sparse_coord_ros.nodes.spin import ros_context
from sparse_coord_ros.runlog import verify
from tools.soak import MEGABYTE, resident
from tools.teams import children, command, same_tables

RATE = 50
"""Time steps a second."""
SETTLED = 10.0
"""Seconds until memory is compared with the end's."""


def hear(times: list[tuple[float, float]], said: Any) -> None:
    """Note when a time step began, and the run's time; a stranger's does not follow the last."""
    at = said.clock.sec + said.clock.nanosec / 1e9
    if 0 < at - times[-1][1] < 1.0:
        times.append((time.monotonic(), at))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, watch, print."""
    parser = argparse.ArgumentParser(prog="python -m tools.siege", description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--hostile", action="store_true", help="also pause, reset and step")
    parser.add_argument("--alone", action="store_true", help="no stranger")
    options = parser.parse_args(arguments)
    steps, seed = str(round(options.seconds * RATE)), str(options.seed)
    with tempfile.TemporaryDirectory(prefix="sparse_coord_siege_") as name:
        out, log = Path(name) / "run", Path(name) / "log"
        words = ["run", "env1", "--processes", "--rate", str(RATE), "--steps", steps]
        words += ["--set", "perception=probability:0.7", "--checkpoint", "5000"]
        with log.open("wb") as file, ros_context() as context:
            run = subprocess.Popen(
                command("sparse_coord", *words, "--out", str(out)), stdout=file, stderr=file
            )
            node, times = rclpy.create_node("onlooker", context=context), [(0.0, 0.0)]
            node.create_subscription(Clock, "/clock", partial(hear, times), STEP_QOS)
            stranger = None
            begun, first, most = 0.0, dict[str, float](), dict[str, float]()
            executor = rclpy.executors.SingleThreadedExecutor(context=context)
            executor.add_node(node)
            while run.poll() is None:
                executor.spin_once(timeout_sec=0.05)
                if len(times) > RATE and stranger is None and not options.alone:
                    words = ["-m", "tools.strangers", "--seconds", "9999", "--seed", seed]
                    words += ["--hostile"] * options.hostile
                    stranger = subprocess.Popen([sys.executable, *words])
                begun = begun or time.monotonic()
                with suppress(OSError):
                    for who, pid in {"run": run.pid, **children(run.pid)}.items():
                        held = resident(pid) / MEGABYTE
                        most[who] = max(held, most.get(who, 0.0))
                        if time.monotonic() - begun > SETTLED:
                            first.setdefault(who, held)
            if stranger is not None:
                stranger.kill()
                stranger.wait()
        gaps = sorted(b[0] - a[0] for a, b in itertools.pairwise(times[1:]))
        if gaps:  # else the run was over before this heard of two steps
            late = gaps[-max(1, len(gaps) // 1000)]
            print(f"between two steps: {gaps[-1]:.3f} s at most, {late:.3f} s for 999 of 1,000")
        for who, held in most.items():
            print(f"{who}: {first.get(who, 0):.0f} MB after {SETTLED:g} s, {held:.0f} MB at most")
        summary = yaml.safe_load((out / "summary.yaml").read_text())
        text = log.read_text(errors="replace")
        print(
            f"exit code {run.returncode}, {summary['transitions']} steps, "
            f"{summary['timeouts']} timeouts, {summary['messages_dropped']} messages dropped by "
            f"the world, {'a' if 'Traceback' in text else 'no'} traceback"
        )
        print(f"tables: {'the same bits' if same_tables(out) else 'OTHERS'}")
        found = verify(out)
        told = [str(one) for one in (*found.differences, *found.open)][:3]
        said = f"{found.foreign} foreign messages, identical"
        print(f"verify: {said if found.same else '; '.join(told)}")
    return run.returncode


if __name__ == "__main__":
    sys.exit(main())
