# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the tools that make live runs share: commands, processes, and what a run is to come to."""

import sys
from pathlib import Path

from sparse_coord_ros.learn.run_config import load_run
from sparse_coord_ros.learn.simulation import learn, tables_equal
from sparse_coord_ros.learn.tables import load_team


def command(executable: str, *words: str) -> list[str]:
    """Return the command line of one of the package's executables."""
    return [sys.executable, "-m", "sparse_coord_ros.executables", executable, *words]


def node_words(name: str, **parameters: object) -> list[str]:
    """Return what a node is given on its command line: its name, and its parameters."""
    given = [word for key, value in parameters.items() for word in ("-p", f"{key}:={value}")]
    return ["--ros-args", "-r", f"__node:={name}", *given]


def children(parent: int) -> dict[str, int]:
    """Return the processes that a process has started: nodes by their names, others by modules."""
    found = {}
    for child in Path(f"/proc/{parent}/task/{parent}/children").read_text().split():
        words = Path(f"/proc/{child}/cmdline").read_text().split("\0")
        if len(words) > 2:  # else it has just ended
            names = [word.partition(":=")[2] for word in words if word.startswith("__node:=")]
            found[names[0] if names else words[2]] = int(child)
    return found


def same_tables(out: Path) -> bool:
    """Whether a run learned the tables, bit for bit, of the same run without ROS.

    Raises:
        TablesError: there are none, or no readable ones.
    """
    run = load_run(out)
    return tables_equal(load_team(out, run.scenario), learn(run.scenario, run.learner, run.seed))
