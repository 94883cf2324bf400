# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord evaluate`: the value of learned tables, beside the paper and the optimum."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.base.files import read_text, write_whole
from sparse_coord_ros.base.yaml_text import to_yaml, yaml_value
from sparse_coord_ros.cli.computing import Bar
from sparse_coord_ros.cli.options import (
    ALLOW,
    JSON,
    SEED,
    Option,
    format_table,
    note,
    tell,
)
from sparse_coord_ros.core.engine.training_checkpoint import CHECKPOINT_FILE
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.evaluation import TRIALS, play
from sparse_coord_ros.core.runs.measures import (
    ERRORS,
    EXACT,
    HEADINGS,
    SPREAD,
    Measures,
)
from sparse_coord_ros.core.runs.run_config import SUMMARY_FILE, RunConfig, load_run
from sparse_coord_ros.core.runs.saved_tables import load_team, missing_files
from sparse_coord_ros.core.solve import shipped
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths
from sparse_coord_ros.core.solve.verdict import verdict_on
from sparse_coord_ros.protocol.lockstep.node_checkpoints import (
    CHECKPOINTS,
    robots_elsewhere,
)
from sparse_coord_ros.studies.paper import paper_row

EXAMPLE = (
    "sparse_coord train env1 --out runs/a && sparse_coord evaluate runs/a\n"
    "  sparse_coord train env1 --learner noncoop --out runs/b\n"
    "  sparse_coord evaluate runs/a runs/b"
)


OPTIONS = (
    Option(
        "directories DIR...",
        Path,
        "output directories of run or train; several are compared",
    ),
    Option(
        "--trials",
        TRIALS,
        f"{TRIALS.help} (default: exact values where that is quick, else {TRIALS.default} trials)",
        {"default": None},
    ),
    Option("--seed", SEED, "seed of the trials"),
    Option(
        "--spread",
        bool,
        "also show standard deviations over robots and trials, which the paper gives",
    ),
    ALLOW,
    JSON,
)


RESULT = ("returns", "asks", "miscoordinations", "arrived", "time_to_goal")
"""The measures in `summary.yaml`, the most important one first."""


class Evaluated(NamedTuple):
    """A run, its directory, and its measures."""

    directory: Path
    run: RunConfig
    measures: Measures


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    runs = [
        evaluated(path, options.trials, options.seed) for path in options.directories
    ]
    for run in runs:
        _complete(run)
    facts = [facts_of(run) for run in runs]
    parts = [result_table(group, spread=options.spread) for group in by_game(runs)]
    if len(runs) == 1:
        parts.append(facts[0]["verdict"].text)
        tell(options, facts[0], "\n".join(parts))
    else:
        tell(options, {"runs": facts}, "\n\n".join(parts))


def _complete(result: Evaluated) -> None:
    """Add the result to the summary of a finished run that lacks it.

    It is one of nodes that were started by hand, or of `train --trials 0`.
    """
    directory, run, measures = result
    summary = _summary(directory)
    made = summary.get("transitions", summary.get("learning_steps"))
    missing = not isinstance(summary.get("result"), dict)
    if missing and made == run.scenario.steps:
        with suppress(OSError):  # a directory that can only be read
            add_result(directory, run, measures)


def evaluated(directory: Path, trials: int | None, seed: int) -> Evaluated:
    """Evaluate one run.

    Args:
        directory: the run's directory.
        trials: number of Monte-Carlo trials; None: none where exact values are quick.
        seed: seed of the trials.

    Raises:
        SparseCoordError: the run does not exist, or cannot be evaluated in this way.
    """
    run = load_run(directory)
    for kept, verb in ((CHECKPOINTS, "run"), (CHECKPOINT_FILE, "train")):
        if (directory / kept).exists() and not (
            robots_elsewhere(directory, run.scenario) or _made_all_steps(directory, run)
        ):
            remedy = f"continue with: sparse_coord {verb} --resume {directory}"
            what = f"{directory}: the run is not finished"
            if missing_files(directory, run.scenario):
                raise RunError(f"{what} and has no tables yet; {remedy}")
            note(f"{what}, its tables are those of a checkpoint; {remedy}")
    tables = load_team(directory, run.scenario, run.rule)
    return Evaluated(directory, run, evaluation_of(run, tables, trials, seed))


def _made_all_steps(directory: Path, run: RunConfig) -> bool:
    """Return whether nodes that were started by hand have made all steps of their run."""
    made = _summary(directory).get("transitions")
    return not missing_files(directory, run.scenario) and made == run.scenario.steps


def _summary(directory: Path) -> dict[str, Any]:
    """Return the content of `summary.yaml`; empty: there is none."""
    path = directory / SUMMARY_FILE
    if not path.exists():
        return {}
    return yaml_value(read_text(path, RunError, "remove it"), where=str(path)) or {}


def evaluation_of(
    run: RunConfig, tables: Sequence[Tables], trials: int | None, seed: int = 0
) -> Measures:
    """Evaluate tables that fit their run; arguments as in `evaluated`."""
    from sparse_coord_ros.core.solve.exact import evaluate_best

    options: dict[str, Any] = {"trials": trials or TRIALS.default, "seed": seed}
    with Bar("trials", "evaluating the learned tables") as bar:
        options |= {"learner": run.rule, "progress": bar.show}
        if trials is None:
            return evaluate_best(run.scenario, tables, **options)
        return play(run.scenario, tables, **options)


@contextmanager
def result_can_wait(out: Path, verb: str) -> Iterator[None]:
    """Say how to come back to the result of a finished run if its evaluation is interrupted.

    Args:
        out: the run's directory.
        verb: the verb that has made the run.
    """
    try:
        yield
    except KeyboardInterrupt:
        again = f"sparse_coord {verb} --resume {out}"
        note(f"the run is finished and saved in {out}; its result: {again}")
        raise


def by_game(runs: list[Evaluated]) -> list[list[Evaluated]]:
    """Return the runs in groups of the same game, in the order given."""
    groups: dict[tuple[str, str], list[Evaluated]] = {}
    for run in runs:
        scenario = run.run.scenario
        groups.setdefault((scenario.name, shipped.game_digest(scenario)), []).append(
            run
        )
    return list(groups.values())


def facts_of(result: Evaluated) -> dict[str, Any]:
    """Return plain data of a run and its value."""
    directory, run, measures = result
    scenario = run.scenario
    bound = shipped.shipped_asking_team(scenario)
    team = shipped.shipped_best_team(scenario)
    optimum = shipped.known_optimum(scenario)
    return {
        "directory": directory,
        "scenario": scenario.name,
        "penalty": scenario.penalty,
        "learner": run.learner,
        "seed": run.seed,
        "steps": scenario.steps,
        "peers_seen": scenario.peers_seen,
        **measures.to_dict(),
        "verdict": verdict_on(scenario, run.rule, measures),
        "robots": measures.by_robot(),
        "paper": paper_row(scenario, run.learner),
        "shortest_paths": shortest_paths(scenario).to_dict(),
        "optimum": optimum.value,
        "optimum_exact": optimum.exact,
        "best_asking_team": None if bound is None else bound.value,
        "best_team": None if team is None else team.value,
    }


def facts_of_result(scenario: Scenario, measures: Measures) -> dict[str, Any]:
    """Return the result of a run for `summary.yaml`: its measures, and the reference values."""
    asking = shipped.shipped_asking_team(scenario)
    means: dict[str, Any] = {}
    for name in RESULT:
        means[name] = measures.mean(name)
        if measures.error(name) > 0.0:
            means[f"{name}_error"] = measures.error(name)
    return {
        **means,
        "source": measures.how,
        "shortest_paths": shortest_paths(scenario).mean("returns"),
        "best_asking_team": None if asking is None else asking.value,
        "optimum": shipped.known_optimum(scenario).value,
    }


def add_result(directory: Path, run: RunConfig, measures: Measures) -> dict[str, Any]:
    """Put the result of a run and its verdict at the beginning of `summary.yaml`; return both."""
    result = {
        "result": facts_of_result(run.scenario, measures),
        "verdict": verdict_on(run.scenario, run.rule, measures).text,
    }
    text = to_yaml(result | _summary(directory) | result)
    write_whole(directory / SUMMARY_FILE, text)
    return result


def result_table(runs: Sequence[Evaluated], *, spread: bool = False) -> str:
    """Return the table of runs of one game: ours, the paper's, and the reference values.

    Directories distinguish the runs of one learner.

    Args:
        runs: the runs.
        spread: whether standard deviations have columns of their own.
    """
    scenario = runs[0].run.scenario
    head = [f"{scenario.name}, penalty {scenario.penalty:g}", *HEADINGS.values()]
    head.append("source")
    if spread:
        head += [f"s.d. of {HEADINGS[name]}" for name in SPREAD]
    rows = [*_learned_rows(runs), *_reference_rows(scenario)]
    table = format_table(head, [row[: len(head)] for row in rows])
    return f"{table}\n{ERRORS}" if "±" in table else table


def _learned_rows(runs: Sequence[Evaluated]) -> list[list[str]]:
    """Return a row for each run, and the paper's rows of their learners."""
    optimum = shipped.known_optimum(runs[0].run.scenario).value
    rows = []
    titles = [run.title for _, run, _ in runs]
    papers: dict[str, Mapping[str, Any]] = {}
    for directory, run, measures in runs:
        title = run.title
        named = title if titles.count(title) == 1 else f"{directory}: {title}"
        papers[title] = paper_row(run.scenario, run.learner)
        cells = measures.cells(optimum=optimum).values()
        rows.append([named, *cells, *measures.spreads()])
    for title, paper in papers.items():
        if paper:
            pairs = [paper.get(name) for name in HEADINGS]
            means = ["-" if pair is None else f"{pair[0]:.2f}" for pair in pairs]
            spreads = ["-" if pair is None else f"{pair[1]:.2f}" for pair in pairs]
            rows.append([title, *means, "paper", *spreads[: len(SPREAD)]])
    return rows


def _reference_rows(scenario: Scenario) -> list[list[str]]:
    """Return the rows of the reference values."""
    paths = shortest_paths(scenario)
    rows = [["fixed shortest paths", *paths.cells().values(), *paths.spreads()]]
    team = shipped.shipped_best_team(scenario)
    for name, value in shipped.yardsticks(scenario):
        cell = f"{value:.2f}"
        source = EXACT
        if team is not None and name == shipped.LEARNED_TEAM:
            cell = f"{cell} ± {team.standard_error:.2f}"
            source = f"{team.trials} trials"
        rows.append([name, cell, *["-"] * 4, source, *["-"] * len(SPREAD)])
    return rows
