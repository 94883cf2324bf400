# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m tools.soak`: a long recorded run; memory of each process and speed, over time.

Prints what is there every few seconds; at the end whether the learned tables are those of a run
without ROS, and what is left in /dev/shm.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import yaml

from sparse_coord_ros.nodes.shared_memory import FOLDER, leftovers
from tools.teams import children, command, same_tables

PROGRESS = re.compile(rb" (\d+) of \d+ steps, ")
MEGABYTE = 1 << 20


def resident(pid: int) -> int:
    """Return the bytes of memory that a process holds."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def look(pid: int, log: Path) -> str:
    """Return the newest step that the world has told of, and what each process holds.

    Raises:
        OSError: one of them has just ended.
    """
    steps = [int(found) for found in PROGRESS.findall(log.read_bytes()[-4096:])][-1:]
    held = {name: resident(own) / MEGABYTE for name, own in {"run": pid, **children(pid)}.items()}
    told = ", ".join(f"{name} {megabytes:.1f} MB" for name, megabytes in held.items())
    return f"step {steps[0] if steps else 0}: {told}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, watch, print."""
    parser = argparse.ArgumentParser(prog="python -m tools.soak", description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--processes", action="store_true", help="every node its own process")
    parser.add_argument("--every", type=float, default=10.0, help="seconds between two looks")
    options = parser.parse_args(arguments)
    before = set(leftovers())
    with tempfile.TemporaryDirectory(prefix="sparse_coord_soak_") as name:
        out, log = Path(name) / "run", Path(name) / "log"
        words = ["run", "env1", "--steps", str(options.steps), "--out", str(out)]
        words += ["--processes"] * options.processes
        with log.open("wb") as file:
            run = subprocess.Popen(command("sparse_coord", *words), stdout=file, stderr=file)
            while run.poll() is None:
                try:
                    run.wait(options.every)
                except subprocess.TimeoutExpired:
                    with suppress(OSError):
                        print(look(run.pid, log), flush=True)
        summary = yaml.safe_load((out / "summary.yaml").read_text())
        size = sum(path.stat().st_size for path in out.glob("bag/*.mcap"))
        print(
            f"{summary['transitions']} steps in {summary['seconds']:.0f} s, exit code "
            f"{run.returncode}, {summary['timeouts']} timeouts, bag of {size / 1e6:.0f} MB, "
            f"tables {'as' if same_tables(out) else 'OTHER than'} without ROS"
        )
    left = [path.name for path in leftovers() if path not in before]
    print(f"left in {FOLDER}: {', '.join(left) or 'nothing'}")
    return run.returncode


if __name__ == "__main__":
    sys.exit(main())
