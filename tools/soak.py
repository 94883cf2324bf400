# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m tools.soak`: a long recorded run; memory of each process and speed, over time.

Prints a Markdown table, and says whether the learned tables are those of a run without ROS and
what is left in /dev/shm.
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
from pathlib import Path
from typing import NamedTuple

import yaml

import sparse_coord_ros as sc
from sparse_coord_ros.learn.run_config import load_run
from sparse_coord_ros.learn.simulation import tables_equal
from sparse_coord_ros.learn.tables import load_team
from sparse_coord_ros.nodes.shared_memory import FOLDER, leftovers

HEAD = "| process | MB after a tenth | at half | at the end | growth in the second half |"
PROGRESS = re.compile(rb" (\d+) of \d+ steps, ")
MEGABYTE = 1 << 20


class Sample(NamedTuple):
    """What one look saw.

    Attributes:
        seconds: since the run was started.
        steps: time steps that the world has made, as it says.
        resident: bytes of memory of each process that is there, by its name.
    """

    seconds: float
    steps: int
    resident: dict[str, int]


def processes(pid: int) -> dict[str, int]:
    """Return a run's processes by name: itself, its nodes, the writer of its bag."""
    found = {"run": pid}
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    for child in map(int, children):
        words = Path(f"/proc/{child}/cmdline").read_text().split("\0")
        if len(words) < 3:
            continue  # it has just ended
        nodes = [word.partition(":=")[2] for word in words if word.startswith("__node:=")]
        found[nodes[0] if nodes else words[2].rpartition(".")[0].rpartition(".")[2]] = child
    return found


def resident(pid: int) -> int:
    """Return the bytes of memory that a process holds."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def watch(run: subprocess.Popen, log: Path, every: float, limit: float) -> list[Sample]:
    """Look at a run every so many seconds until it ends; interrupt it after `limit` seconds."""
    samples: list[Sample] = []
    started = time.monotonic()
    while True:
        try:
            run.wait(every)
            return samples
        except subprocess.TimeoutExpired:
            pass
        now = time.monotonic() - started
        said = PROGRESS.findall(log.read_bytes()[-4096:])
        try:
            memory = {name: resident(pid) for name, pid in processes(run.pid).items()}
        except OSError:  # one of them has just ended
            continue
        samples.append(Sample(now, int(said[-1]) if said else 0, memory))
        print(*samples[-1], file=sys.stderr, flush=True)  # whoever kills this loses nothing
        if now > limit:
            run.send_signal(signal.SIGINT)
            limit = float("inf")


def table(samples: Sequence[Sample]) -> list[str]:
    """Return the lines of the table and one about the speed."""
    everybody = max(len(sample.resident) for sample in samples)
    busy = [one for one in samples if 0 < one.steps and len(one.resident) == everybody]
    last = busy[-1].steps
    tenth = next(sample for sample in busy if sample.steps >= last / 10)
    half = next(sample for sample in busy if sample.steps >= last / 2)
    lines = [HEAD, "|---|--:|--:|--:|--:|"]
    for name in busy[-1].resident:
        sizes = [one.resident[name] / MEGABYTE for one in (tenth, half, busy[-1])]
        growth = sizes[2] - sizes[1]
        lines.append(f"| {name} | " + " | ".join(f"{s:.1f}" for s in (*sizes, growth)) + " |")
    pairs = list(zip(busy, busy[1:], strict=False))
    rates = [(b.steps - a.steps) / (b.seconds - a.seconds) for a, b in pairs]
    parts = [rates[k * len(rates) // 10 : (k + 1) * len(rates) // 10] for k in range(10)]
    means = [sum(part) / len(part) for part in parts if part]
    said = ", ".join(f"{mean:.0f}" for mean in means)
    return [*lines, "", f"steps/s in ten parts of the run: {said}"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, watch, print."""
    parser = argparse.ArgumentParser(prog="python -m tools.soak", description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--processes", action="store_true", help="every node its own process")
    parser.add_argument("--every", type=float, default=10.0, help="seconds between two looks")
    parser.add_argument("--seconds", type=float, default=1e9, help="stop after so long")
    parser.add_argument("--scenario", default="env1")
    options = parser.parse_args(arguments)
    before = set(leftovers())
    with tempfile.TemporaryDirectory(prefix="sparse_coord_soak_") as name:
        out, log = Path(name) / "run", Path(name) / "log"
        words = ["run", options.scenario, "--steps", str(options.steps), "--out", str(out)]
        words += ["--processes"] * options.processes
        with log.open("wb") as file:
            run = subprocess.Popen(
                [sys.executable, "-m", "sparse_coord_ros.executables", "sparse_coord", *words],
                stdout=file,
                stderr=file,
            )
            samples = watch(run, log, options.every, options.seconds)
        summary = yaml.safe_load((out / "summary.yaml").read_text())
        print("\n".join(table(samples)))
        steps, seconds = summary["transitions"], summary["seconds"]
        size = sum(path.stat().st_size for path in out.glob("bag/*.mcap"))
        print(
            f"{steps} steps in {seconds:.0f} s, exit code {run.returncode}, {summary['timeouts']} "
            f"timeouts, bag of {size / 1e6:.0f} MB"
        )
        if not summary["interrupted"]:
            alone = sc.train(sc.load_scenario(options.scenario, steps=options.steps))
            same = tables_equal(load_team(out, load_run(out).scenario), alone.tables)
            print(f"tables {'as' if same else 'OTHER than'} without ROS")
    left = [path.name for path in leftovers() if path not in before]
    print(f"left in {FOLDER}: {', '.join(left) or 'nothing'}")
    return run.returncode


if __name__ == "__main__":
    sys.exit(main())
