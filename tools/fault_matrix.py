# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m tools.fault_matrix`: every process, every signal, every moment; a Markdown table.

Each cell starts a recorded team of processes, sends one of them a signal at a moment, waits for
the run's end, resumes it where it ended too early, compares the tables with those of a run without
ROS, and verifies the bag.
"""

import itertools
import os
import random
import signal
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import yaml

from sparse_coord_ros.bags.reader import open_bag
from sparse_coord_ros.errors import SparseCoordError
from sparse_coord_ros.learn.run_config import load_run
from sparse_coord_ros.learn.tables import TEAM_FILE
from sparse_coord_ros.lockstep.checkpoints import CHECKPOINTS, steps_of
from sparse_coord_ros.runlog import verify
from sparse_coord_ros.wire import RECORDER, WORLD
from tools.teams import children, command, odd_counts, same_tables

WHO = {"robot": "robot_2", "world": WORLD, "recorder": RECORDER}
SIGNALS = ("KILL", "INT", "STOP")
STOP_SECONDS = 8.0
MOMENTS = ("learning", "startup")

HEAD = "| process | signal | moment | ends | exit code | lost | tables | verify |"
LIMIT = 120.0


def newest(out: Path) -> int:
    """Return the newest checkpoint that all nodes have; 0 before the first."""
    of_each = [set(steps_of(out / CHECKPOINTS, n)) for n in ("robot_1", "robot_2", WORLD)]
    return max(set.intersection(*of_each), default=0)


def signalled(team: subprocess.Popen, who: str, name: str, moment: str, out: Path) -> bool:
    """Wait for the moment and send the signal; return whether it came in time."""
    pid = None
    while team.poll() is None and (pid is None or (moment != "startup" and newest(out) == 0)):
        time.sleep(0.005)
        with suppress(OSError):
            pid = children(team.pid).get(WHO[who], pid)
    time.sleep(random.uniform(0.2, 1.5) if moment == "startup" else random.uniform(0.0, 0.3))
    if team.poll() is not None or pid is None:
        return False
    os.kill(pid, getattr(signal, f"SIG{name}"))
    if name == "STOP":
        time.sleep(STOP_SECONDS)
        os.kill(pid, signal.SIGCONT)
    return True


def trial(who: str, name: str, moment: str, folder: Path) -> list[str]:
    """Run one cell and return what its row says of the outcome.

    Raises:
        TimeoutExpired: the team does not end.
    """
    out = folder / "run"
    words = ["run", "env1", "--processes", "--steps", "2000", "--seed", "7", "--checkpoint", "250"]
    with (folder / "log").open("wb") as log:
        team = subprocess.Popen(
            command("sparse_coord", *words, "--out", str(out)), stdout=log, stderr=log
        )
        in_time = signalled(team, who, name, moment, out)
        began = time.monotonic()
        try:
            code = team.wait(LIMIT)
        except subprocess.TimeoutExpired:
            team.send_signal(signal.SIGINT)  # it ends its nodes
            team.wait(LIMIT)
            raise
    took = f"{time.monotonic() - began + STOP_SECONDS * (name == 'STOP'):.1f} s"
    return [took if in_time else f"{took} (too late)", str(code), *resumed(out), verdict(out)]


def resumed(out: Path) -> tuple[str, str]:
    """Resume a run that ended too early; return what was lost, and what it learned."""
    lost = "nothing"
    if (out / CHECKPOINTS).is_dir():
        with suppress(SparseCoordError):
            reached = round(open_bag(out).end_ns / (load_run(out).step_period * 1e9))
            lost = f"{max(0, reached - newest(out))} steps, until resumed"
        again = command("sparse_coord", "run", "--resume", str(out), "--processes", "--json")
        done = subprocess.run(again, capture_output=True, timeout=LIMIT, check=False)
        if done.returncode:  # a robot that has left by itself is not in the last checkpoint
            return lost, f"resume ended with {done.returncode}: {done.stderr.decode()[-90:]!r}"
    if not (out / TEAM_FILE).exists():
        return lost, "-"
    if same_tables(out):
        return lost, "the same bits"
    summary = yaml.safe_load((out / "summary.yaml").read_text())
    late = sum(asks["late"] for asks in summary.get("asks", {}).values())
    return lost, f"others ({summary['timeouts']} timeouts, {late} late)"


def verdict(out: Path) -> str:
    """Return what `verify` says of the bag, and where the run's counts contradict one another."""
    if not (out / "bag").is_dir():
        return "-"
    try:
        found = verify(out)
        odd = odd_counts(out, found if found.same else None) if (out / TEAM_FILE).exists() else []
    except SparseCoordError:
        return "unreadable"
    if odd:
        return f"counts differ ({odd[0]})"
    if found.same or found.cannot_tell:
        return "identical" if found.same else "cannot tell"
    return f"differs ({found.differences[0]})".replace("|", "/")


def main() -> None:
    """Run the cells and print the table."""
    print(f"{HEAD}\n|---|---|---|--:|--:|---|---|---|", flush=True)
    for moment, name, who in itertools.product(MOMENTS, SIGNALS, WHO):
        with tempfile.TemporaryDirectory(prefix="fault_matrix_") as folder:
            try:
                outcome = trial(who, name, moment, Path(folder))
            except subprocess.TimeoutExpired:
                outcome = [f"> {LIMIT:.0f} s", "-", "-", "-", "-"]
        print(f"| {' | '.join([who, name, moment, *outcome])} |", flush=True)


if __name__ == "__main__":
    main()
