# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From what the nodes of a run wrote to the files of its output directory."""

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from rclpy.node import Node

from sparse_coord_ros.errors import BagError, RunError, os_error_text
from sparse_coord_ros.files import take_lock, write_whole
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.evaluation import check_tables
from sparse_coord_ros.learn.run_config import RUN_FILE, RunConfig, load_run
from sparse_coord_ros.learn.tables import (
    TEAM_FILE,
    load_saved,
    load_team,
    robot_file,
    save_team,
)
from sparse_coord_ros.lockstep.checkpoints import (
    CHECKPOINTS,
    Checkpoints,
    Store,
    remove_checkpoints,
)
from sparse_coord_ros.lockstep.robot_side import ASKS, RobotState
from sparse_coord_ros.lockstep.world_side import WorldState
from sparse_coord_ros.nodes.parameters import ParameterNode, run_from_parameters
from sparse_coord_ros.version import __version__

SUMMARY_FILE = "summary.yaml"


def gather(
    out: Path, scenario: Scenario, *, interrupted: bool, recording_error: BagError | None = None
) -> dict[str, Any]:
    """Join the robots' tables into `tables.npz` and complete `summary.yaml`.

    Args:
        out: the output directory, in which world and robots have written.
        scenario: the problem.
        interrupted: whether the run was stopped before its budget was used up.
        recording_error: why the recording ended before the run, where it did.

    Returns:
        The summary; `asks` says for each robot how its requests ended.
    """
    path = out / SUMMARY_FILE
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    summary = yaml.safe_load(text) or {}  # empty after a full disk
    summary["interrupted"] = interrupted
    if recording_error is not None:
        summary["recording_error"] = str(recording_error)
    summary |= _join_tables(out, scenario)
    write_whole(path, yaml.safe_dump(summary, sort_keys=False))
    finished = summary.get("transitions", 0) >= scenario.steps
    if finished and not interrupted and (out / TEAM_FILE).exists():
        remove_checkpoints(out)
    return summary


def _join_tables(out: Path, scenario: Scenario) -> dict[str, Any]:
    """Join the robots' tables where all are there; return what they say of the run."""
    parts = [robot_file(out, robot.name) for robot in scenario.robots]
    if not all(part.exists() for part in parts):
        return {}
    saved = [load_saved(part, [k])[0] for k, part in enumerate(parts, start=1)]
    save_team(out, [one.tables for one in saved], [one.memory for one in saved])
    for part in parts:
        part.unlink()
    asks = {
        robot.name: {how: one.counts[how] for how in ASKS}
        for robot, one in zip(scenario.robots, saved, strict=True)
    }
    return {"transitions_dropped": sum(one.counts["dropped"] for one in saved), "asks": asks}


def resumed_run(values: Mapping[str, Any]) -> RunConfig:
    """Return the run that is to go on: that of the output directory.

    Args:
        values: of the parameters `out` and, where the run is described again, `scenario` and all
            that goes with it.

    Raises:
        SparseCoordError: there is none, it is finished, of another version, or another run than
            the one described.
    """
    if not values["out"]:
        raise RunError("parameter resume: needs parameter 'out', the output directory of the run")
    out = Path(values["out"])
    run = load_run(out)
    if (out / TEAM_FILE).exists() and not (out / CHECKPOINTS).is_dir():
        raise RunError(f"{out}: the run is finished, there is nothing to go on with")
    wrote = run.versions.get("sparse_coord_ros")
    if wrote != __version__:
        raise RunError(
            f"{out}: is a run of version {wrote} of sparse_coord_ros, this is {__version__}; go "
            "on with that version, or begin the run anew"
        )
    if values["scenario"]:
        asked = run_from_parameters(values)
        if asked.digest != run.digest:
            raise RunError(
                f"{out}: holds another run ({run.scenario.name}, learner {run.learner}, seed "
                f"{run.seed}) than the one given ({asked.scenario.name}, learner "
                f"{asked.learner}, seed {asked.seed}, or other settings); leave them out"
            )
    return run


def open_output(text: str, run_text: str, own: Sequence[str]) -> Path | None:
    """Make or join the output directory of a run; None where `text` names none.

    Args:
        text: the directory.
        run_text: the run's `run.yaml`, written by whoever comes first.
        own: names of the files that the caller is going to write there.

    Raises:
        RunError: the directory cannot be made, holds another run, or one of the files.
    """
    if not text:
        return None
    path = Path(text)
    try:
        path.mkdir(parents=True, exist_ok=True)
        for name in own:
            if (path / name).exists():
                raise _taken(path, name)
        _join(path, run_text)
    except OSError as error:
        raise RunError(
            f"output directory {path}: cannot be written ({error.strerror}); choose another one"
        ) from None
    return path


def _join(path: Path, run_text: str) -> None:
    """Write `run.yaml`, or see that it is the same; of several nodes one after the other."""
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        take_lock(folder, wait=True)
        file = path / RUN_FILE
        if not file.exists():
            write_whole(file, run_text)
        elif file.read_text(encoding="utf-8") != run_text:
            raise _taken(path, f"another run's {RUN_FILE}")
    finally:
        os.close(folder)


def _taken(path: Path, what: str) -> RunError:
    return RunError(
        f"output directory {path}: exists already and holds {what}, nothing is overwritten; "
        "choose another one"
    )


class Output:
    """Where a node of a run saves: in the directory of its parameter `out`; nowhere without one.

    Args:
        node: the node.
        name: what its checkpoints are called: `wire.WORLD`, or the robot's name.
        run: the run.
        own: names of the files that it is going to write there.

    Attributes:
        store: its checkpoints.

    Raises:
        RunError: the directory cannot be used, or not be gone on with.
    """

    def __init__(self, node: ParameterNode, name: str, run: RunConfig, own: Sequence[str]) -> None:
        self._node, self._text = node, run.to_yaml()
        resumed = node.values["resume"]
        self._out = open_output(node.values["out"], self._text, [] if resumed else own)
        self.store = Store()
        if self._out is not None:
            self.store = checkpoints = Checkpoints(self._out, name, run)
            checkpoints.steps()
            for line in checkpoints.broken:
                node.get_logger().warning(line)
        elif resumed:
            raise RunError(
                f"node {name}: parameter resume needs parameter 'out', the output directory"
            )

    def checkpoint(self, state: WorldState | RobotState) -> None:
        """Save where the node is; where that fails, the run goes on with earlier ones."""
        try:
            self.store.save(state)
        except OSError as error:
            self._node.get_logger().error(
                f"checkpoint not saved: {os_error_text(error)}; the run goes on, the earlier "
                "checkpoints are kept: make room"
            )

    def save(self, write: Callable[[Path], None]) -> Path | None:
        """Write files as `save_somewhere` does, and return the directory; None: there is none."""
        if self._out is None:
            return None
        return save_somewhere(self._node, self._out, self._text, write)


def save_somewhere(node: Node, out: Path, run_text: str, write: Callable[[Path], None]) -> Path:
    """Write files of a run into its output directory, or beside it where that cannot be.

    A directory that is gone is made again; one that cannot be written (a full disk) is stood in
    for by `<out>_rescued` beside it, or in the folder for temporary files. One line says so.

    Args:
        node: says it.
        out: the output directory.
        run_text: the run's `run.yaml`, written where it is missing.
        write: writes the files into a directory.

    Returns:
        The directory.

    Raises:
        OSError: none of the places can be written; that of the first.
    """
    name = f"{out.absolute().name}_rescued"
    refusal: OSError | None = None
    for place in (out, out.absolute().with_name(name), Path(tempfile.gettempdir()) / name):
        gone = not place.exists()
        try:
            place.mkdir(parents=True, exist_ok=True)
            if not (place / RUN_FILE).exists():
                write_whole(place / RUN_FILE, run_text)
            write(place)
        except OSError as error:
            refusal = refusal or error
            continue
        if refusal is not None:
            node.get_logger().error(f"{os_error_text(refusal)}; saved in {place} instead")
        elif gone:
            node.get_logger().warning(f"output directory {out}: it was gone and was made again")
        return place
    raise refusal or OSError(f"{out} cannot be written")


def begin_with(directory: Path, run: RunConfig) -> list[Tables]:
    """Read the tables that a run is to begin with, and check that they fit.

    Raises:
        SparseCoordError: no such run, or its map, robots or learner are others.
    """
    tables = load_team(directory, load_run(directory).scenario)
    check_tables(run.scenario, tables, run.learner)
    return tables
