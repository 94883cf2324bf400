# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joins the files of a run's nodes in its output directory."""

import os
import stat
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.errors import (
    BagError,
    RunError,
    TablesError,
    os_error_text,
)
from sparse_coord_ros.base.files import read_text, rescue, take_lock, write_whole
from sparse_coord_ros.base.yaml_text import to_yaml, yaml_value
from sparse_coord_ros.core.engine.training_checkpoint import CHECKPOINT_FILE
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.memory import taught
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.core.runs.evaluation import check_tables
from sparse_coord_ros.core.runs.run_config import (
    RUN_FILE,
    SUMMARY_FILE,
    RunConfig,
    load_run,
)
from sparse_coord_ros.core.runs.saved_tables import (
    TEAM_FILE,
    load_saved,
    load_team,
    robot_file,
    save_team,
)
from sparse_coord_ros.protocol.lockstep.node_checkpoints import (
    CHECKPOINTS,
    Checkpoints,
    CheckpointStore,
)
from sparse_coord_ros.protocol.lockstep.robot_side import ASKS, RobotState
from sparse_coord_ros.protocol.lockstep.world_side import WorldState
from sparse_coord_ros.ros.nodes.parameters import ParameterNode, run_from_parameters


def gather(
    out: Path,
    scenario: Scenario,
    *,
    interrupted: bool,
    recording_error: BagError | None = None,
) -> dict[str, Any]:
    """Join the robots' tables into `tables.npz` and complete `summary.yaml`.

    Args:
        out: the output directory, in which world and robots have written.
        scenario: the problem.
        interrupted: whether the run was stopped before its budget was used up.
        recording_error: the error that ended the recording before the run; None: it did not.

    Returns:
        The summary; `asks` says for each robot how its requests ended.
    """
    path = out / SUMMARY_FILE
    text = read_text(path, RunError, "remove it") if path.exists() else ""
    summary = (
        yaml_value(text, where=str(path), error=RunError) or {}
    )  # empty after a full disk
    summary["interrupted"] = interrupted
    if recording_error is not None:
        summary["recording_error"] = str(recording_error)
    summary |= _join_tables(out, scenario)
    write_whole(path, to_yaml(summary))
    finished = summary.get("transitions", 0) >= scenario.steps
    if finished and not interrupted and (out / TEAM_FILE).exists():
        Checkpoints.remove(out)
    return summary


def _join_tables(out: Path, scenario: Scenario) -> dict[str, Any]:
    """Join the robots' tables if all exist; return their counts of the run."""
    parts = [robot_file(out, robot.name) for robot in scenario.robots]
    if not all(part.exists() for part in parts):
        return {}
    saved = [load_saved(part, [k])[0] for k, part in enumerate(parts, start=1)]
    save_team(out, [robot.memory for robot in saved])
    for part in parts:
        part.unlink()
    pairs = zip(scenario.names, saved, strict=True)
    asks = {name: {how: robot.counts[how] for how in ASKS} for name, robot in pairs}
    return {
        "transitions_dropped": sum(robot.counts["dropped"] for robot in saved),
        "asks": asks,
    }


def holds_run(out: str) -> bool:
    """Return whether an output directory holds a run, which then goes on."""
    return bool(out) and (Path(out) / RUN_FILE).exists()


def is_finished(out: Path) -> bool:
    """Return whether a run was finished, so that there is nothing to continue."""
    left = (CHECKPOINTS, CHECKPOINT_FILE)
    return (out / TEAM_FILE).exists() and not any(
        (out / name).exists() for name in left
    )


def run_of(values: Mapping[str, Any]) -> RunConfig:
    """Return a world's run: the one in its output directory, or else a new one.

    Args:
        values: of the parameter `out`; of `scenario` and the parameters that belong to it. Where
            `out` holds a run, `scenario` may be empty.

    Raises:
        SparseCoordError: bad input; the run in `out` is finished, or another than the one
            described.
    """
    if not holds_run(values["out"]):
        return replace(run_from_parameters(values), id=uuid.uuid4().hex)
    out = Path(values["out"])
    run = load_run(out)
    if (out / CHECKPOINT_FILE).exists():
        raise RunError(
            f"{out}: holds a run of train; continue with: sparse_coord train --resume {out}"
        )
    if is_finished(out):
        raise RunError(f"{out}: the run is finished, there is nothing to continue")
    run.check_code()
    if values["scenario"]:
        asked = run_from_parameters(values)
        if asked.digest != run.digest:
            raise RunError(
                f"output directory {out}: holds another run ({run.scenario.name}, learner "
                f"{run.learner}, seed {run.seed}) than the one given ({asked.scenario.name}, "
                f"learner {asked.learner}, seed {asked.seed}, or other settings); choose "
                "another directory, or leave the scenario and its settings out"
            )
    return run


def check_place(out: str) -> None:
    """Refuse an output directory that cannot be made.

    Raises:
        RunError: another file is in its place, or in its way, or the place cannot be written.
    """
    folder = Path(out).absolute()
    while not os.path.lexists(folder):
        folder = folder.parent
    if out and not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise RunError(
            f"output directory {out}: cannot be written, as {folder} is "
            f"{'read-only' if folder.is_dir() else 'no directory'}; choose another one"
        )


class Output:
    """Saves files of a node in the directory of its parameter `out`, if that is set.

    Args:
        node: the node.
        name: the name of its checkpoints: `wire.WORLD`, or the robot's name.
        run: the run.
        files: names of the files that the node will write there.

    Attributes:
        node: as above.
        store: its checkpoints.

    Raises:
        RunError: the directory holds another run, or one of the files without its run.
        OSError: it cannot be made or written.
    """

    def __init__(
        self, node: ParameterNode, name: str, run: RunConfig, files: Sequence[str]
    ) -> None:
        self.node = node
        self._text = run.to_yaml()
        self._out = Path(node.values["out"]) if node.values["out"] else None
        self.store = CheckpointStore()
        if self._out is not None:
            self._open(self._out, files)
            self.store = checkpoints = Checkpoints(self._out, name, run)
            node.at_end.callback(checkpoints.close)
            checkpoints.steps()
            for line in checkpoints.broken:
                node.get_logger().warning(line)

    def _open(self, out: Path, files: Sequence[str]) -> None:
        """Make or join the directory: the first node to come writes `run.yaml`.

        A node that finds its run there goes on with it.
        """
        out.mkdir(parents=True, exist_ok=True)
        held: list[str] = []
        if not holds_run(str(out)):
            held = [name for name in files if (out / name).exists()]
        if not held:
            self._describe(out)
            remedy = "choose another output directory"
            if read_text(out / RUN_FILE, RunError, remedy) != self._text:
                held = [f"another run's {RUN_FILE}"]
        if held:
            why = f"exists already and holds {held[0]}, nothing is overwritten; choose another one"
            raise RunError(f"output directory {out}: {why}")

    def _describe(self, out: Path) -> None:
        """Write `run.yaml` into a directory without it; only the first of several nodes does."""
        folder = os.open(out, os.O_RDONLY | os.O_DIRECTORY)
        try:
            take_lock(folder, wait=True)
            if not (out / RUN_FILE).exists():
                write_whole(out / RUN_FILE, self._text)
        finally:
            os.close(folder)

    def checkpoint(self, state: WorldState | RobotState) -> None:
        """Save the node's state; if that fails, the run continues with earlier files."""
        try:
            if self._out is not None and not self._out.exists():
                self.save(lambda _: None)
            self.store.save(state)
        except OSError as error:
            self.node.get_logger().error(
                f"checkpoint not saved: {os_error_text(error)}; the run continues, the earlier "
                "checkpoints are kept: make room"
            )

    def save(self, write: Callable[[Path], None]) -> Path | None:
        """Write files into the directory, or beside it if that fails.

        A directory that is gone is made again. If it cannot be written (a full disk), another
        takes its place (`files.rescue`), the same for all nodes of the run. One line reports it.

        Args:
            write: writes the files into a directory.

        Returns:
            The directory; None: not set.

        Raises:
            OSError: no place can be written; the first place's error.
        """
        if self._out is None:
            return None
        out = self._out
        say = self.node.get_logger()

        def fill(directory: Path) -> None:
            self._describe(directory)
            write(directory)

        gone = not out.exists()
        try:
            out.mkdir(parents=True, exist_ok=True)
            fill(out)
        except OSError as error:
            try:
                elsewhere = rescue(out.absolute(), fill, self._joins)
            except OSError:
                raise error from None
            say.error(f"{os_error_text(error)}; saved in {elsewhere} instead")
            return elsewhere
        if gone:
            say.warning(f"output directory {out}: it was gone and was made again")
        return out

    def _joins(self, out: Path) -> bool:
        """Return whether a node of this user and this run made a directory; an OSError passes."""
        status = out.lstat()
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
            return False
        self._describe(out)  # its maker may not have written it yet
        return (out / RUN_FILE).read_bytes() == self._text.encode()


def begin_with(directory: Path, run: RunConfig, number: int) -> Memory:
    """Return the initial memory of a robot (from 0) from another run's tables.

    A greedy robot has that run's whole memory: a learner may act by its counts, too.

    Raises:
        SparseCoordError: no such run, or its map, robots or learner are others.
    """
    source = load_run(directory)
    learned_on = source.scenario.map
    if learned_on.cells != run.scenario.map.cells:
        raise TablesError(
            f"{directory}: its tables are of map {learned_on.name}, whose free cells are not "
            f"those of map {run.scenario.map.name}; give a run of scenario {run.scenario.name}"
        )
    tables = load_team(directory, source.scenario, source.rule)
    check_tables(run.scenario, tables, run.rule)
    memory = tables[number].memory
    if run.greedy:
        return memory
    return taught(run.scenario, run.rule, number, memory)
