# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord reproduce`: the paper's tables and figures, and its open questions."""

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path

from sparse_coord_ros.cli.computing import COMPUTING, Bar, computing_of, first_wait
from sparse_coord_ros.cli.options import (
    ALLOW,
    JSON,
    SEED,
    Option,
    format_table,
    tell,
)
from sparse_coord_ros.core.runs.measures import ERRORS, HEADINGS
from sparse_coord_ros.studies.catalogue import NAMES
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.runner import run_experiment
from sparse_coord_ros.studies.store import RUN_TRIALS, RUNS
from sparse_coord_ros.studies.targets import parse_targets

EXAMPLE = (
    "sparse_coord reproduce table1 table2 --out results\n"
    "  sparse_coord reproduce env2-4r/coop/penalty=-20 --out results"
)


OPTIONS = (
    Option(
        "[targets WHAT...]",
        None,
        f"experiments ({', '.join(NAMES)}), or conditions such as env1/coop/penalty=-20 "
        "(default: every experiment)",
    ),
    Option(
        "--out",
        Path,
        "results directory; existing results are kept and not computed again",
        {"default": Path("results")},
    ),
    RUNS,
    RUN_TRIALS,
    Option("--seed", SEED, "seed of run 0; run i has seed + i"),
    *COMPUTING,
    Option("--list", bool, "list the conditions, compute nothing"),
    ALLOW,
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    asked = options.targets or NAMES
    targets = parse_targets(asked)
    if options.list:
        conditions = [condition.id for condition in targets.conditions]
        tell(options, {"conditions": conditions}, *conditions)
        return
    computing = computing_of(options)
    with Bar("agent-steps", first_wait(options)) as bar:
        results = run_experiment(
            asked,
            progress=lambda name, done, total: bar.show(done, total, name),
            report=True,
            **computing,
        )
    facts = {"conditions": [result.to_dict() for result in results.values()]}
    lines = _lines(options.out, results, report=bool(targets.experiments))
    tell(options, facts, *lines)


def _lines(
    out: Path, results: Mapping[str, ConditionResult], *, report: bool
) -> Iterator[str]:
    rows = []
    for name, result in results.items():
        exact = "" if result.optimum_exact else "<= "
        cells = result.measures.cells(optimum=result.optimum)
        rows.append([name, *cells.values(), f"{exact}{result.optimum:.2f}"])
    if rows:
        head = ["condition", *HEADINGS.values(), "source", "optimum"]
        yield format_table(head, rows)
        yield ERRORS
    if report:
        yield f"tables: {out / 'tables'}, figures: {out / 'figures'}"
