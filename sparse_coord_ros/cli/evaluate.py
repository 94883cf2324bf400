# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord evaluate`: what learned tables are worth, beside the paper and the optimum."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.core.best_team import shipped_best_team
from sparse_coord_ros.core.class_bound import shipped_class_bound
from sparse_coord_ros.core.evaluation import TRIALS, Evaluation, Measure, check_tables, evaluate
from sparse_coord_ros.core.optimum import Optimum, joint_optimum
from sparse_coord_ros.core.run_config import RUN_SETTINGS, RunConfig, load_run
from sparse_coord_ros.core.tables import load_team

if TYPE_CHECKING:
    from sparse_coord_ros.engine.exact import ExactEvaluation

PAPER_PENALTY = -20.0


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs,
        "evaluate",
        example="sparse_coord train env1 --out runs/a && sparse_coord evaluate runs/a",
    )
    parser.add_argument("directory", metavar="DIR", type=Path, help="output of run or train")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--trials", default="1000", help="Monte-Carlo trials (default: 1000)")
    how.add_argument(
        "--exact",
        action="store_true",
        help="compute the measures instead, for one or two robots: no trials, no standard error",
    )
    parser.add_argument("--seed", default="0", help="seed of the trials (default: 0)")
    shared.add_json(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    trials = TRIALS.parse(options.trials)
    seed = RUN_SETTINGS["seed"].parse(options.seed)
    run = load_run(options.directory)
    tables = load_team(options.directory, run.scenario)
    check_tables(run.scenario, tables, run.learner)
    result: Evaluation | ExactEvaluation
    if options.exact:
        from sparse_coord_ros.engine.exact import evaluate_exact

        result = evaluate_exact(run.scenario, tables, learner=run.rule)
    else:
        result = evaluate(run.scenario, tables, trials=trials, seed=seed, learner=run.rule)
    bound = shipped_class_bound(run.scenario)
    optimum = joint_optimum(run.scenario)
    team = shipped_best_team(run.scenario)
    bag = options.directory / "bag"
    if options.json:
        shared.print_json(
            {
                "scenario": run.scenario.name,
                "learner": run.learner,
                **result.to_dict(),
                "paper": paper_row(run),
                "optimum": optimum.value,
                "optimum_exact": optimum.exact,
                "class_bound": None if bound is None else bound.value,
                "best_team": None if team is None else team.value,
            }
        )
        return 0
    print(result_table(run, result, optimum))
    if isinstance(result, Evaluation) and result.not_arrived:
        print(f"in {result.not_arrived} of {trials} trials some robot did not arrive")
    if bag.is_dir():
        print(f"bag: {bag}")
    return 0


def paper_row(run: RunConfig) -> dict:
    """Return what the paper prints for this run's learner; nothing for another game."""
    return dict(run.scenario.paper.get(run.learner, {})) if same_game_as_paper(run) else {}


def same_game_as_paper(run: RunConfig) -> bool:
    """Whether the run's rewards are those of the paper's Tables 1 to 3."""
    return run.scenario.penalty == PAPER_PENALTY


def result_table(run: RunConfig, result: Evaluation | ExactEvaluation, optimum: Optimum) -> str:
    """Return the table that `evaluate` prints: ours, the paper's, class bound and optimum."""
    learner = run.rule.title or run.learner
    if isinstance(result, Evaluation):
        how = f"{result.trials} trials"
        arrived = f"{result.trials - result.not_arrived} of {result.trials}"
    else:
        how, arrived = "exact", f"{100 * result.all_arrived:.2f} %"
    rows = [
        [
            f"{learner}, {how}",
            _pair(result.reward),
            _pair(result.time_to_goal),
            _pair(result.miscoordinations),
            f"{result.asks.mean:.2f}",
            arrived,
        ]
    ]
    paper = paper_row(run)
    if paper:
        measures = ("reward", "time_to_goal", "miscoordinations")
        cells = [
            "{:.2f} ± {:.2f}".format(*paper[measure]) if measure in paper else "-"
            for measure in measures
        ]
        rows.append([f"{learner}, paper", *cells, "-", "-"])
    bound = shipped_class_bound(run.scenario)
    if bound is not None:
        rows.append(["class bound", f"{bound.value:.2f}", "-", "-", "-", "-"])
    team = shipped_best_team(run.scenario)
    if team is not None:
        rows.append(["best known team", f"{team.value:.2f}", "-", "-", "-", "-"])
    name = "exact joint optimum" if optimum.exact else "bound (robots alone)"
    rows.append([name, f"{optimum.value:.2f}", "-", "-", "-", "-"])
    head = ["reward", "time to goal", "miscoordinations", "asks", "all arrived"]
    penalty = f"penalty {run.scenario.penalty:g}"
    return shared.format_table([f"{run.scenario.name}, {penalty}", *head], rows)


def _pair(measure: Measure) -> str:
    return f"{measure.mean:.2f} ± {measure.spread:.2f}"
