# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord tables`: extract the tables of a checkpoint from a bag."""

import argparse
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.cli.computing import read_bag
from sparse_coord_ros.cli.options import BAG, JSON, Option, tell
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.runs.run_config import RUN_FILE, create_output
from sparse_coord_ros.core.runs.saved_tables import TEAM_FILE, save_team

STEP = Setting("step", int, 0, "learning step", low=0)

EXAMPLE = (
    "sparse_coord tables runs/demo/bag\n"
    "  sparse_coord tables runs/demo/bag --step 0 --out runs/then"
)


OPTIONS = (
    BAG,
    Option(
        "--step N",
        STEP,
        "learning step of the checkpoint (default: list the checkpoints)",
        {"default": None},
    ),
    Option("--out DIR", Path, "output directory"),
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    if (options.step is None) != (options.out is None):
        raise RunError(
            "--step N and --out DIR belong together; without both the steps are listed"
        )
    log = read_bag(options.bag, quiet=options.json)
    common = sorted(set.intersection(*map(set, log.table_steps())))
    time_steps = {log.made_before(step): step for step in common}
    facts: dict[str, Any] = {"bag": options.bag, "steps": list(time_steps)}
    facts["damage"] = log.damage
    steps_in_words = ", ".join(map(str, time_steps)) or "none"
    lines = [f"steps with tables of all robots: {steps_in_words}"]
    if options.out is not None:
        step = options.step
        if step not in time_steps:
            raise RunError(
                f"{options.bag}: holds no tables of all robots of step {step}; there are "
                f"those of: {steps_in_words}"
            )
        out = create_output(options.out)
        save_team(
            out, [log.tables[k, time_steps[step]].memory for k in range(len(log.names))]
        )
        write_whole(out / RUN_FILE, log.run.to_yaml())
        facts |= {"step": step, "directory": out}
        lines = [f"tables  {out / TEAM_FILE}", f"run     {out / RUN_FILE}"]
    lost = [] if log.damage is None else [log.damage]
    tell(options, facts, *lost, *lines)
