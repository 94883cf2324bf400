# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From what the nodes of a run wrote to the files of its output directory."""

from pathlib import Path
from typing import Any

import yaml

from sparse_coord_ros.core.run_config import RunConfig
from sparse_coord_ros.core.scenario import Scenario
from sparse_coord_ros.core.tables import load_counts, load_tables, robot_file, save_team
from sparse_coord_ros.errors import RunError


def gather(out: Path, scenario: Scenario, *, interrupted: bool) -> dict[str, Any]:
    """Join the robots' tables into `tables.npz` and complete `summary.yaml`.

    Args:
        out: the output directory, in which world and robots have written.
        scenario: the problem.
        interrupted: whether the run was stopped before its budget was used up.

    Returns:
        The summary; `asks` says for each robot how its requests ended.
    """
    path = out / "summary.yaml"
    summary = yaml.safe_load(path.read_text(encoding="utf-8")) if path.exists() else {}
    summary["interrupted"] = interrupted
    parts = [robot_file(out, robot.name) for robot in scenario.robots]
    if all(part.exists() for part in parts):
        tables = [load_tables(part, [k])[0] for k, part in enumerate(parts, start=1)]
        summary["asks"] = {
            robot.name: load_counts(part)
            for robot, part in zip(scenario.robots, parts, strict=True)
        }
        save_team(out, tables)
        for part in parts:
            part.unlink()
    path.write_text(yaml.safe_dump(summary, sort_keys=False), encoding="utf-8")
    return summary


def prepare_world_out(text: str, run: RunConfig) -> Path | None:
    """Create the world's output directory and write `run.yaml`; None where there is to be none.

    Raises:
        RunError: the directory holds a run already.
    """
    if not text:
        return None
    path = Path(text)
    path.mkdir(parents=True, exist_ok=True)
    try:
        with (path / "run.yaml").open("x", encoding="utf-8") as file:
            file.write(run.to_yaml())
    except FileExistsError:
        raise RunError(
            f"output directory {path}: holds a run already (run.yaml), nothing is overwritten; "
            "choose another one"
        ) from None
    return path
