# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Teams as processes: the commands that start them, and the expected results."""

import json
import sys
from pathlib import Path

import yaml
from rclpy.serialization import deserialize_message
from teams import learn, tables_equal

from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run_config import SUMMARY_FILE, load_run
from sparse_coord_ros.core.runs.saved_tables import load_team
from sparse_coord_ros.log.bags import open_bag
from sparse_coord_ros.log.runlog import Verification
from sparse_coord_ros.protocol.wire.status import read_status, values_of
from sparse_coord_ros.ros.nodes import ros_topics


def command(executable: str, *words: str) -> list[str]:
    """Return the command line of one of the package's executables."""
    return [sys.executable, "-m", "sparse_coord_ros.executables", executable, *words]


def node_words(name: str, **parameters: object) -> list[str]:
    """Return what a node is given on its command line: its name, and its parameters."""
    words = ["--ros-args", "-r", f"__node:={name}"]
    for key, value in parameters.items():
        text = json.dumps(value) if isinstance(value, bool | list) else str(value)
        words += ["-p", f"{key}:={text}"]
    return words


def child_of(parent: int, module: str) -> int:
    """Return the process of a parent's children that runs a module, or one of our executables."""
    children = Path(f"/proc/{parent}/task").glob("*/children")
    for pid in map(int, " ".join(one.read_text() for one in children).split()):
        words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
        run = words[words.index("-m") + 1 :] if "-m" in words else []
        if run[:1] == [module] or run[:2] == ["sparse_coord_ros.executables", module]:
            return pid
    raise AssertionError(f"no child of process {parent} runs {module}")


def same_tables(out: Path) -> bool:
    """Whether a run learned the tables, bit for bit, of the same run without ROS.

    Raises:
        TablesError: there are none, or no readable ones.
    """
    run = load_run(out)
    return tables_equal(
        load_team(out, run.scenario, run.rule),
        learn(run.scenario, run.learner, run.seed),
    )


def odd_counts(out: Path, found: Verification | None = None) -> list[str]:
    """Return in what summary, history and log of a run contradict one another.

    Args:
        out: the output directory of a run that has ended.
        found: what `verify` says of its bag; None: it has none, or not the end of the run.
    """
    summary = yaml.safe_load((out / SUMMARY_FILE).read_text())
    history = load_history(out)
    names = [r.name for r in load_run(out).scenario.robots]
    asks = dict(zip(names, history.asks.sum(axis=0).tolist(), strict=True))
    due = {
        "transitions, and those of history.npz": (
            summary["transitions"],
            int(history.length.sum()),
        ),
        "miscoordinations, and those of history.npz": (
            summary["miscoordinations"],
            int(history.miscoordinations.sum()),
        ),
    }
    quiet = not summary["timeouts"]
    if quiet and "asks" in summary:
        for name, said in summary["asks"].items():
            own = said["answered"] + said["refused"] + said["late"]
            due[f"how often {name} asked, and history.npz"] = (own, asks[name])
    if found is not None:
        due |= _of_the_log(summary, found)
        if quiet:
            for name, times in zip(
                names, found.log.asked.sum(axis=0).tolist(), strict=True
            ):
                due[f"how often {name} asked, in history.npz and the bag"] = (
                    asks[name],
                    times,
                )
    return [
        f"{what}: {one} and {other}"
        for what, (one, other) in due.items()
        if one != other
    ]


def _of_the_log(summary: dict, found: Verification) -> dict[str, tuple[object, object]]:
    """Return pairs that are to be equal: what the summary counts, and what the bag says last."""
    last: dict[str, str] = {}
    bag = open_bag(found.log.path)
    for message in bag.messages([ros_topics.DIAGNOSTICS.name]):
        for said in deserialize_message(
            message.data, ros_topics.DIAGNOSTICS.type
        ).status:
            last = values_of(said) if said.name.endswith(": run") else last
    status = None
    for message in bag.messages([f"/{ros_topics.STATUS.name}"]):
        status = read_status(deserialize_message(message.data, ros_topics.STATUS.type))
    assert status is not None
    due: dict[str, tuple[object, object]] = {
        f"{name}, in summary and diagnostics": (str(value), last[name])
        for name, value in summary.items()
        if name in last and name != "steps_per_second"
    }
    due["transitions, in summary and status"] = (
        summary["transitions"],
        status.transitions,
    )
    if found.same:
        due["transitions, in summary and bag"] = (summary["transitions"], found.steps)
    return due
