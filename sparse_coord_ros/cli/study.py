# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord study`: the search for the learning protocol."""

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.core.run_config import RUN_SETTINGS
from sparse_coord_ros.core.settings import Setting
from sparse_coord_ros.engine.batch import ENGINES, run_batch
from sparse_coord_ros.engine.cells import Cell
from sparse_coord_ros.engine.report.protocol import protocol_document
from sparse_coord_ros.engine.results import (
    CellResult,
    Plan,
    Results,
    collect,
    open_results,
    write_whole,
)
from sparse_coord_ros.engine.study import SPACE, Outcome, descend, search, settings_of

RUNS = Setting("runs", int, 40, "learning runs of a protocol in a scenario", low=2, high=10_000)
TRIALS = Setting("trials", int, 100, "Monte-Carlo trials of a run", low=2, high=1_000_000)
CANDIDATES = Setting("candidates", int, 150, "protocols to try", low=1, high=100_000)


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs,
        "study",
        help="search for one learning protocol that serves all nine scenarios",
        example="sparse_coord study --out study",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("study"),
        help="results directory; one that is there is gone on with (default: study)",
    )
    parser.add_argument("--candidates", default="150", help=f"{CANDIDATES.help} (default: 150)")
    parser.add_argument("--runs", default="40", help=f"{RUNS.help} (default: 40)")
    parser.add_argument("--trials", default="100", help=f"{TRIALS.help} (default: 100)")
    parser.add_argument(
        "--seed", default="10000", help="seed of run 0; run i has seed + i (default: 10000)"
    )
    parser.add_argument("--engine", choices=ENGINES, default="auto", help="as of reproduce")
    shared.add_json(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    plan = Plan(
        RUN_SETTINGS["seed"].parse(options.seed),
        RUNS.parse(options.runs),
        TRIALS.parse(options.trials),
    )
    candidates = CANDIDATES.parse(options.candidates)
    with open_results(options.out, plan) as results:

        def compute(cell: Cell) -> CellResult:
            return _result(results, cell, options.engine)

        outcomes: list[Outcome] = []
        with tqdm(total=candidates, unit=" protocols", disable=None, file=sys.stderr) as bar:
            for outcome in search(compute, candidates):
                outcomes.append(outcome)
                bar.set_postfix(best=f"{min(o.loss for o in outcomes if o.whole):.2f}")
                bar.update()
        found = min((one for one in outcomes if one.whole), key=lambda one: one.loss)
        with tqdm(unit=" variations", disable=None, file=sys.stderr) as bar:
            rounds = list(descend(found, compute, bar.update))
        best = rounds[-1].best
        document = protocol_document(plan, outcomes, rounds)
        write_whole(options.out / "protocol.md", document)
        _write_csv(options.out / "protocols.csv", outcomes)
    if options.json:
        data = {"protocol": settings_of(best.choices), "loss": best.loss, "closed": best.closed}
        shared.print_json({**data, "difference": best.difference, "asks": best.asks})
        return 0
    for name, value in settings_of(best.choices).items():
        print(f"{name}: {value}")
    print(f"loss {best.loss:.2f}; report: {options.out / 'protocol.md'}")
    return 0


def _result(results: Results, cell: Cell, engine: str) -> CellResult:
    result = results.load(cell)
    if result is None:
        plan = results.plan
        runs = run_batch(
            cell.scenario, cell.learner, plan.seeds, trials=plan.trials, engine=engine
        )
        result = collect(cell, plan.trials, runs)
        results.save(cell, result)
    return result


def _write_csv(path: Path, outcomes: Sequence[Outcome]) -> None:
    scenarios = sorted({name for one in outcomes for name in one.difference})
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        closed = [f"closed_{name}" for name in outcomes[0].closed]
        writer.writerow(
            [*SPACE, "loss", "whole", *closed]
            + [f"difference_{name}" for name in scenarios]
            + ["failed_teams", "teams"]
        )
        for one in outcomes:
            writer.writerow(
                [*(one.choices[name] for name in SPACE), one.loss, one.whole]
                + [one.closed.get(name.removeprefix("closed_"), "") for name in closed]
                + [one.difference.get(name, "") for name in scenarios]
                + [one.failed_teams, one.teams]
            )
