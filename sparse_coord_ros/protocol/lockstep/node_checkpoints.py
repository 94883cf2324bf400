# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The checkpoints of one node of a team on its disk.

World and robots save under the same time steps, each its own file `<node>_<step>.npz` in the
directory `checkpoint` of the output directory. A team continues from the newest step for which
all nodes have a file: the last common checkpoint. Step 0 is the run's beginning, without a file.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import RunError, TablesError
from sparse_coord_ros.base.files import PARTIAL, HeldError, hold, write_whole
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.runs import checkpoint_bytes
from sparse_coord_ros.core.runs.history import history_from
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.runs.saved_tables import memory_from, saved_arrays
from sparse_coord_ros.protocol.lockstep.robot_side import RobotState
from sparse_coord_ros.protocol.lockstep.world_side import WorldState
from sparse_coord_ros.protocol.wire import WORLD

CHECKPOINTS = "checkpoint"
"""The directory's name."""

BEGINNING = 0
"""The step of the checkpoint that all nodes always have: the run's beginning."""


class CheckpointStore:
    """A store without checkpoints; `Checkpoints` has them on disk."""

    def steps(self) -> list[int]:
        """Return the steps from which the node can continue, the newest first, and finally 0."""
        return [BEGINNING]

    def load(self, step: int) -> Any:
        """Return the `WorldState` or `RobotState` of a step; None: at the beginning."""
        return None

    def save(self, state: WorldState | RobotState) -> None:
        """Save the node's state."""

    def forget_after(self, step: int) -> None:
        """Remove the checkpoints of later steps: the team does these again."""

    def forget_before(self, step: int) -> None:
        """Remove the checkpoints of earlier steps: the team never goes back to them."""


class Checkpoints(CheckpointStore):
    """One node's checkpoints on disk.

    Args:
        out: the output directory; it must exist.
        node: the node's name: `wire.WORLD`, or that of a robot.
        run: the run.

    Attributes:
        broken: the errors of unreadable files, one line each.

    Raises:
        RunError: another process uses this node's checkpoints there.
        OSError: the directory cannot be written.
    """

    def __init__(self, out: Path, node: str, run: RunConfig) -> None:
        self._node = node
        self._run = run
        self._names = run.scenario.names
        self.broken: list[str] = []
        self._readable: set[int] = set()
        self._oldest = BEGINNING
        self._folder = out / CHECKPOINTS
        try:
            self._folder.mkdir(exist_ok=True)
            self._lock = hold(self._folder / f"{node}.lock")
        except HeldError as error:
            what = (
                f"output directory {out}: another process runs {node} there ({error})"
            )
            raise RunError(
                f"{what}; stop that one, or choose another directory"
            ) from None

    @staticmethod
    def remove(out: Path) -> None:
        """Remove the checkpoints of a run that is finished and saved."""
        folder = out / CHECKPOINTS
        with suppress(OSError):
            for path in folder.iterdir():
                if path.name.endswith((".npz", f".npz{PARTIAL}", ".lock")):
                    path.unlink()
            folder.rmdir()

    def close(self) -> None:
        """Unlock the checkpoints for other processes; the end of the process does so too."""
        self._lock.close()

    def steps(self) -> list[int]:
        """Return the steps from which this node can continue, the newest first, and finally 0.

        Raises:
            RunError: a file is of another run, or in another format.
        """
        files = steps_of(self._folder, self._node)
        for step in set(files) - self._readable:
            try:
                self.load(step)
                self._readable.add(step)
            except checkpoint_bytes.BrokenCheckpointError as error:
                line = str(error).replace(
                    "begin the run anew", "an earlier one is used"
                )
                if line not in self.broken:
                    self.broken.append(line)
        return [*(step for step in files if step in self._readable), BEGINNING]

    def save(self, state: WorldState | RobotState) -> None:
        """Save the node's state; an OSError leaves the earlier checkpoints unchanged."""
        self._folder.mkdir(exist_ok=True)
        self._write(state.step, self._arrays(state))
        self._readable.add(state.step)

    def forget_after(self, step: int) -> None:
        """Remove the checkpoints of later steps: the team does these again."""
        self._remove(
            [later for later in steps_of(self._folder, self._node) if later > step]
        )

    def forget_before(self, step: int) -> None:
        """Remove the checkpoints of earlier steps: the team never goes back to them."""
        if step > self._oldest:
            self._oldest = step
            saved = steps_of(self._folder, self._node)
            self._remove([earlier for earlier in saved if earlier < step])

    def _remove(self, steps: Iterable[int]) -> None:
        for step in steps:
            self._readable.discard(step)
            with suppress(OSError):
                self._path(step).unlink()

    def load(self, step: int) -> Any:
        """Return a saved `WorldState` or `RobotState`; None: the beginning of the run.

        Raises:
            RunError: the checkpoint is missing, broken or of another run.
        """
        if step == BEGINNING:
            return None
        arrays = self._read(step)
        try:
            return self._state(step, arrays)
        except (KeyError, ValueError, IndexError, TypeError, TablesError) as error:
            raise checkpoint_bytes.broken(self._path(step), error) from None

    def _arrays(self, state: WorldState | RobotState) -> dict[str, np.ndarray]:
        """Return a state as named arrays; its step is in the file's name."""
        fields = state._asdict()
        del fields["step"]
        if isinstance(state, WorldState):
            arrays = checkpoint_bytes.position_arrays([fields.pop("position")])
            history = fields.pop("history")._asdict()
            arrays |= {f"history_{name}": array for name, array in history.items()}
        else:
            number = self._names.index(self._node) + 1
            arrays = saved_arrays({number: fields.pop("memory")})
        return arrays | {name: np.array(value) for name, value in fields.items()}

    def _state(
        self, step: int, arrays: Mapping[str, np.ndarray]
    ) -> WorldState | RobotState:
        """Return the state from the arrays of `_arrays`."""
        kind: type[WorldState] | type[RobotState] = RobotState
        fields: dict[str, Any] = {"step": step}
        if self._node == WORLD:
            kind = WorldState
            fields["position"] = checkpoint_bytes.positions_from(
                arrays, self._run.scenario
            )[0]
            fields["history"] = history_from(arrays, "history_")
        else:
            scenario = self._run.scenario
            k = self._names.index(self._node)
            memory = memory_from(arrays, k + 1)
            fields["memory"] = check_memory(scenario, self._run.rule, k, memory)
        for name in set(kind._fields) - set(fields):
            value = arrays[name].tolist()
            fields[name] = tuple(value) if isinstance(value, list) else value
        return kind(**fields)

    def _path(self, step: int) -> Path:
        return self._folder / f"{self._node}_{step}.npz"

    def _write(self, step: int, arrays: Mapping[str, np.ndarray]) -> None:
        path = self._path(step)
        data = checkpoint_bytes.pack(self._run.digest, arrays)
        write_whole(path, data, sync=True)

    def _read(self, step: int) -> dict[str, np.ndarray]:
        path = self._path(step)
        run = self._run
        in_words = f"{run.scenario.name}, learner {run.learner}, seed {run.seed}"
        return checkpoint_bytes.read(path, run.digest, run_in_words=in_words)


def steps_of(folder: Path, node: str) -> list[int]:
    """Return the time steps of a node's files in a directory, the newest first."""
    texts = (
        path.stem.removeprefix(f"{node}_") for path in folder.glob(f"{node}_*.npz")
    )
    return sorted((int(text) for text in texts if text.isdecimal()), reverse=True)


def robots_elsewhere(out: Path, scenario: Scenario) -> list[str]:
    """Return the robots of a resumed run without files in its directory."""
    folder = out / CHECKPOINTS
    names = scenario.names
    begun = any(steps_of(folder, name) for name in (WORLD, *names))
    return [name for name in names if begun and not (folder / f"{name}.lock").exists()]


def check_robots(out: Path, scenario: Scenario) -> None:
    """Refuse to continue with this package's robots in place of other robots.

    Raises:
        RunError: a robot is the user's own, or has its files elsewhere.
    """
    away = robots_elsewhere(out, scenario)
    if away:
        raise RunError(
            f"{out}: holds nothing of {', '.join(away)} (a custom robot, or one with another "
            "'out'), so the run cannot continue; begin a new one, or start each of its nodes"
        )
