# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make study`: search for one learning protocol that serves all nine scenarios.

`python -m tools.study --out study`, in a checkout; `--learner factored` searches for that
learner's; `--help` lists the options.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import pandas as pd
from tqdm import tqdm

from sparse_coord_ros.cli.computing import COMPUTING
from sparse_coord_ros.cli.options import add_options
from sparse_coord_ros.cli.verbs import Parser
from sparse_coord_ros.engine.cluster import cluster_at
from sparse_coord_ros.errors import EXIT_BAD_INPUT, SparseCoordError
from sparse_coord_ros.experiments.conditions import Condition
from sparse_coord_ros.experiments.runner import Computing, compute
from sparse_coord_ros.experiments.store import (
    ConditionResult,
    Plan,
    Results,
    open_results,
    write_result,
)
from tools.study.document import protocol_document
from tools.study.factored import FACTORED
from tools.study.search import (
    COOP,
    FINAL_RUNS,
    FINALISTS,
    Judgement,
    final,
    search,
    settings_of,
    vary,
)

FINAL_SEEDS = 10**6
"""How far the seeds of the final lie from those of the search."""

TASKS = {task.learner: task for task in (COOP, FACTORED)}

T = TypeVar("T")


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, search, and return the exit code."""
    parser = Parser(prog="python -m tools.study", description=__doc__)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("study"),
        help="results directory; where it is there, the search is continued (default: study)",
    )
    parser.add_argument("--learner", choices=TASKS, default="coop", help="whose protocol")
    for name, default, what in (
        ("candidates", 40, "protocols to try"),
        ("runs", 100, "learning runs of a protocol in a scenario"),
        ("trials", 100, "Monte-Carlo trials of a run"),
        ("seed", 10000, "seed of run 0; run i has seed + i"),
    ):
        parser.add_argument(f"--{name}", type=int, default=default, help=what)
    add_options(parser, COMPUTING)
    try:
        return execute(parser.parse_args(arguments))
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT


def execute(options: argparse.Namespace) -> int:
    """Search, judge the best again, vary the winner; write protocol.md and protocols.csv."""
    plan = Plan(options.seed, options.runs, options.trials)
    final_plan = Plan(plan.seed + FINAL_SEEDS, FINAL_RUNS * plan.runs, plan.trials)
    task = TASKS[options.learner]
    with (
        open_results(options.out / "search", plan) as searched,
        open_results(options.out / "final", final_plan) as finals,
        cluster_at(options.scheduler) as cluster,
    ):
        by = Computing(options.engine, options.jobs, cluster)
        result = partial(_result, searched, by)
        tried = search(result, options.candidates, task=task)
        outcomes = _listed(tried, "search", options.candidates)
        again = final(outcomes, partial(_result, finals, by), task)
        finalists = _listed(again, "final", FINALISTS)
        best = min(finalists, key=lambda one: one.loss)
        reference = task.judge(best.choices, result, float("inf"))
        changes = sum(map(len, task.space.values())) - len(task.space)
        variations = _listed(vary(reference, result, task), "one choice at a time", changes)
    document = protocol_document(
        task, plan, final_plan, outcomes, finalists, reference, variations
    )
    write_result(options.out / "protocol.md", document)
    write_result(options.out / "protocols.csv", _csv(outcomes))
    for name, value in settings_of(best.choices).items():
        print(f"{name}: {value}")
    print(f"loss {best.loss:.2f}; report: {options.out / 'protocol.md'}")
    return 0


def _listed(items: Iterator[T], title: str, total: int) -> list[T]:
    """Return the items, with a progress bar."""
    return list(tqdm(items, desc=title, total=total, disable=None, file=sys.stderr))


def _result(results: Results, by: Computing, condition: Condition) -> ConditionResult:
    return compute([condition], results.plan, by, results=results)[condition.id]


def _csv(outcomes: Sequence[Judgement]) -> str:
    rows = [
        {**one.choices, "loss": one.loss, "whole": one.whole}
        | {f"closed_{name}": value for name, value in one.closed.items()}
        | {f"difference_{name}": value for name, value in one.difference.items()}
        | {"failed_teams": one.failed_teams, "teams": one.teams}
        for one in outcomes
    ]
    return pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n")


if __name__ == "__main__":
    sys.exit(main())
