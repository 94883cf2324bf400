# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord improve`: a team plans on what its robots have learned."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sparse_coord_ros.cli.evaluate import (
    Evaluated,
    evaluation_of,
    facts_of,
    result_table,
)
from sparse_coord_ros.cli.options import JSON, Option, tell
from sparse_coord_ros.core.engine.improve import IMPROVED, improve, save_improved
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.evaluation import TRIALS
from sparse_coord_ros.core.runs.run_config import RunConfig, load_run
from sparse_coord_ros.core.runs.tables import load_team

EXAMPLE = (
    "sparse_coord train env2-2r --learner factored --penalty -100 --out runs/f\n"
    "  sparse_coord improve runs/f"
)

IMPROVE = Option("--improve", bool, f"run 'improve' at the end; writes DIR/{IMPROVED}")

OPTIONS = (
    Option(
        "directory DIR",
        Path,
        f"output directory of run or train; the plan is written to DIR/{IMPROVED}",
    ),
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    out = options.directory
    run = load_run(options.directory)
    run.check_code()
    tell(options, *planned(out, run, load_team(out, run.scenario, run.rule)))


def planned(
    out: Path, run: RunConfig, tables: Sequence[Tables]
) -> tuple[dict[str, Any], str]:
    """Plan on the learned memories of a run, and save the plan; return its value, and words.

    Raises:
        SettingError: the robots do not learn the model that it needs.
        RunError: a plan exists already.
    """
    found = improve(run.scenario, run.rule, [table.memory for table in tables])
    folder = save_improved(out, run, found)
    results = [
        Evaluated(where, run, evaluation_of(run, one, TRIALS.default, 0, exact=None))
        for where, one in ((out, tables), (folder, found.tables))
    ]
    unfelt = sorted(run.scenario.map.doorways - set(found.doorways))
    model = {"before": found.before, "value": found.value, "doorways": found.doorways}
    lines = [result_table(results)]
    lines.append(f"on the learned model: {found.before:.2f} -> {found.value:.2f}")
    if unfelt:
        where = ", ".join(str(run.scenario.map.cells[x]) for x in unfelt)
        lines.append(
            f"no robot ever paid r^C in doorway {where}: the plan treats it as free cells"
        )
    facts = {
        "learned_model": {**model, "unfelt": unfelt},
        "runs": list(map(facts_of, results)),
    }
    return facts, "\n".join([*lines, f"tables   {folder}"])
