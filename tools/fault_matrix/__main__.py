# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m tools.fault_matrix`: every process, every signal, every moment; a Markdown table.

Each cell starts a recorded team of processes, sends one of them a signal at a moment, waits for
the run's end, resumes it where it ended too early, compares the tables with those of a run without
ROS, and verifies the bag.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import yaml

from sparse_coord_ros.learn.run_config import load_run
from sparse_coord_ros.learn.simulation import learn, tables_equal
from sparse_coord_ros.learn.tables import load_team
from sparse_coord_ros.lockstep.checkpoints import CHECKPOINTS, steps_of

WHO = {"robot": "robot_2", "world": "world_simulator", "recorder": "recorder"}
SIGNALS = ("INT", "TERM", "HUP", "KILL", "STOP")
STOP_SECONDS = 8.0
STEPS = 2000
MOMENTS: dict[str, list[str]] = {
    "startup": [],
    "learning": [],
    "coordinate": ["--set", "epsilon=constant:1"],
    "save": ["--checkpoint", "25"],
}
"""What is given beside: a robot that explores all the time asks in a fifth of its steps; one that
saves each 25 steps is often caught at it."""

BEGIN, END = "<!-- fault matrix: begin -->", "<!-- fault matrix: end -->"
HEAD = (
    "| process | signal | moment | ends | exit code | lost | tables | verify |",
    "|---|---|---|--:|--:|---|---|---|",
)
LIMIT = 120.0

UNFINISHED, NO_END = "file: logged unfinished", "the file has no end"
"""What `verify` says of the bag of a recorder that was killed, and the table."""


class Cell(NamedTuple):
    """One trial."""

    who: str
    number: str
    moment: str


def cells() -> Iterator[Cell]:
    """Yield all trials."""
    for moment in ("learning", "save", "coordinate", "startup"):
        for number in ("KILL", "INT", "STOP", "TERM", "HUP"):
            for who in WHO:
                yield Cell(who, number, moment)


def cli(*words: str) -> list[str]:
    """Return a command line of `sparse_coord`."""
    return [sys.executable, "-m", "sparse_coord_ros.executables", "sparse_coord", *words]


def child(parent: int, name: str) -> int | None:
    """Return the process that runs a node; None: it is not there yet."""
    try:
        children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
        for pid in map(int, children):
            if f"__node:={name}" in Path(f"/proc/{pid}/cmdline").read_text().split("\0"):
                return pid
    except OSError:
        pass
    return None


def newest(out: Path) -> int:
    """Return the newest checkpoint that all nodes have; 0 before the first."""
    of_each = [set(steps_of(out / CHECKPOINTS, n)) for n in ("robot_1", "robot_2", WHO["world"])]
    return max(set.intersection(*of_each), default=0)


def trial(cell: Cell, folder: Path, chance: random.Random) -> list[str]:
    """Run one cell and return its row."""
    out, log = folder / "run", folder / "log"
    more = MOMENTS[cell.moment]
    if "--checkpoint" not in more:
        more = [*more, "--checkpoint", "250"]
    words = ["run", "env1", "--processes", "--steps", str(STEPS), "--seed", "7", *more]
    with log.open("wb") as file:
        team = subprocess.Popen(
            cli(*words, "--out", str(out)), stdout=file, stderr=file, start_new_session=True
        )
        pid = None
        while pid is None and team.poll() is None:
            pid = child(team.pid, WHO[cell.who])
            time.sleep(0.005)
        if cell.moment == "startup":
            time.sleep(chance.uniform(0.2, 1.5))
        else:
            while newest(out) == 0 and team.poll() is None:
                time.sleep(0.005)
            time.sleep(chance.uniform(0.0, 0.3))
        alive = team.poll() is None and pid is not None
        began = time.monotonic()
        if alive and pid is not None:
            os.kill(pid, getattr(signal, f"SIG{cell.number}"))
            if cell.number == "STOP":
                time.sleep(STOP_SECONDS)
                os.kill(pid, signal.SIGCONT)
        try:
            code = team.wait(LIMIT)
        except subprocess.TimeoutExpired:
            team.send_signal(signal.SIGINT)  # it ends its nodes
            team.wait(LIMIT)
            raise
    took = time.monotonic() - began
    lost, tables = "nothing", "-"
    first = "" if alive else " (too late)"
    resumable = (out / CHECKPOINTS).is_dir()
    if resumable:
        step, reached = newest(out), last_step(out)
        lost = f"{max(0, reached - step)} steps, until resumed"
        done = subprocess.run(
            cli("run", "--resume", str(out), "--processes", "--json"),
            capture_output=True,
            timeout=LIMIT,
            check=False,
        )
        if done.returncode:  # a robot that has left by itself is not in the last checkpoint
            tables = f"resume ended with {done.returncode}: {done.stderr.decode()[-90:].strip()}"
    if (out / "tables.npz").exists() and tables == "-":
        run = load_run(out)
        same = tables_equal(
            load_team(out, run.scenario), learn(run.scenario, run.learner, run.seed)
        )
        summary = yaml.safe_load((out / "summary.yaml").read_text())
        late = sum(asks["late"] for asks in summary.get("asks", {}).values())
        tables = (
            "the same bits" if same else f"others ({summary['timeouts']} timeouts, {late} late)"
        )
    verdict = "-"
    if (out / "bag").is_dir():
        found = subprocess.run(
            cli("verify", str(out)), capture_output=True, timeout=LIMIT, check=False
        )
        names = {0: "identical", 1: "differs", 2: "unreadable", 3: "cannot tell"}
        verdict = names.get(found.returncode, str(found.returncode))
        if found.returncode == 1:
            lines = [one for one in found.stdout.decode().splitlines() if "differs:" in one]
            first_line = lines[0].partition("differs: ")[2][:60] if lines else ""
            verdict += f" ({NO_END if first_line.startswith(UNFINISHED) else first_line})"
    return [
        cell.who,
        cell.number,
        cell.moment,
        f"{took:.1f} s{first}",
        str(code),
        lost,
        tables,
        verdict.replace("|", "/"),
    ]


def last_step(out: Path) -> int:
    """Return the newest time step that world or bag tell of."""
    from sparse_coord_ros.bags.reader import open_bag
    from sparse_coord_ros.errors import SparseCoordError

    try:
        period = load_run(out).step_period * 1e9
        return round(open_bag(out).end_ns / period)
    except SparseCoordError:
        return 0


def main() -> int:
    """Run the cells and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--who", choices=WHO, action="append")
    parser.add_argument("--signal", choices=SIGNALS, action="append")
    parser.add_argument("--moment", choices=MOMENTS, action="append")
    parser.add_argument("--seconds", type=float, default=1e9, help="begin no cell after so long")
    parser.add_argument(
        "--document",
        type=Path,
        help="put the rows into the table of this page; what it has already is not run again",
    )
    parser.add_argument("--again", action="store_true", help="run also what the page has")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    chance, began = random.Random(options.seed), time.monotonic()
    rows = {} if options.document is None else rows_of(options.document)
    for cell in cells():
        chosen = zip((options.who, options.signal, options.moment), cell, strict=True)
        if not all(wanted is None or said in wanted for wanted, said in chosen):
            continue
        if cell in rows and not options.again:
            continue
        if time.monotonic() - began > options.seconds:
            break
        with tempfile.TemporaryDirectory(prefix="fault_matrix_") as folder:
            try:
                row = trial(cell, Path(folder), chance)
            except subprocess.TimeoutExpired:
                row = [*cell, f"> {LIMIT:.0f} s", "-", "-", "-", "-"]
        rows[cell] = f"| {' | '.join(row)} |"
        print(rows[cell], flush=True)
        if options.document is not None:
            write_rows(options.document, rows)
    return 0


def rows_of(page: Path) -> dict[Cell, str]:
    """Return the rows of a page's table."""
    table = page.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    lines = table.strip().splitlines()[len(HEAD) :]
    return {Cell(*(word.strip() for word in line.split("|")[1:4])): line for line in lines}


def write_rows(page: Path, rows: dict[Cell, str]) -> None:
    """Put rows into a page's table, in the order of `cells`."""
    head, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    table = [*HEAD, *(rows[cell] for cell in cells() if cell in rows)]
    text = "\n".join((BEGIN, *table, END))
    page.write_text(f"{head}{text}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
