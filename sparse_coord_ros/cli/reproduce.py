# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord reproduce`: the paper's tables and figures, and its open questions."""

import argparse
import os
import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.evaluate import result_table
from sparse_coord_ros.core.evaluation import Trials, play, summary
from sparse_coord_ros.core.optimum import joint_optimum
from sparse_coord_ros.core.run_config import RUN_FILE, RUN_SETTINGS, make_run
from sparse_coord_ros.core.settings import Setting
from sparse_coord_ros.core.tables import load_team, save_team
from sparse_coord_ros.engine.batch import ENGINES, Run, run_batch, uses_numba
from sparse_coord_ros.engine.conditions import Condition, parse_id
from sparse_coord_ros.engine.experiments import NAMES, Experiment, experiment
from sparse_coord_ros.engine.results import (
    ConditionResult,
    Plan,
    Results,
    collect,
    digest,
    open_results,
    unusable_file,
)
from sparse_coord_ros.errors import ResultsError, SettingError, did_you_mean

RUNS = Setting("runs", int, 100, "independent learning runs of a cell", low=2, high=1_000_000)
TRIALS = Setting("trials", int, 1000, "Monte-Carlo trials of a run", low=2, high=1_000_000)
JOBS = Setting("jobs", int, 1, "threads (or processes) at once", low=1, high=4096)


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs,
        "reproduce",
        example="sparse_coord reproduce table1 table2 --out results\n"
        "  sparse_coord reproduce env2-4r/coop/penalty=-20/3 --out results",
    )
    parser.add_argument(
        "targets",
        metavar="WHAT",
        nargs="*",
        help=f"experiments ({', '.join(NAMES)}), cells such as env1/coop/penalty=-20, or single "
        "runs such as env1/coop/penalty=-20/3 (default: every experiment)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("results"),
        help="results directory; one that is there is gone on with (default: results)",
    )
    parser.add_argument("--runs", default="100", help=f"{RUNS.help} (default: 100)")
    parser.add_argument("--trials", default="1000", help=f"{TRIALS.help} (default: 1000)")
    parser.add_argument("--seed", default="0", help="seed of run 0; run i has seed + i (0)")
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        default="auto",
        help="numba, python, or auto: numba where it is installed; the results are the same",
    )
    parser.add_argument("--jobs", help=f"{JOBS.help} (default: all cores)")
    parser.add_argument("--list", action="store_true", help="list the cells and stop")
    shared.add_json(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    plan = Plan(
        RUN_SETTINGS["seed"].parse(options.seed),
        RUNS.parse(options.runs),
        TRIALS.parse(options.trials),
    )
    jobs = None if options.jobs is None else JOBS.parse(options.jobs)
    uses_numba(options.engine)
    chosen, cells, runs = parse_targets(options.targets)
    for cell, number in runs:
        if number >= plan.runs:
            raise SettingError(
                f"id {cell.id}/{number}: run {number} is not one of {plan.runs}; choose a number "
                f"below {plan.runs} or more --runs"
            )
    if options.list:
        listed = {"cells": [c.id for c in cells], "runs": [f"{c.id}/{n}" for c, n in runs]}
        if options.json:
            shared.print_json(listed)
        else:
            print("\n".join(listed["cells"] + listed["runs"]))
        return 0
    work = {"engine": options.engine, "jobs": jobs}
    with open_results(options.out, plan) as results:
        found = compute(results, cells, work)
        played = [one_run(results, cell, number, work) for cell, number in runs]
        if chosen:
            from sparse_coord_ros.engine.report import write_report

            try:
                write_report(options.out, plan, *complete(results, chosen, found))
            except OSError as error:  # Matplotlib's: without the file's name
                raise unusable_file(options.out / "figures", error, "written") from None
    if options.json:
        data = {"cells": [result.to_dict() for result in found.values()]}
        shared.print_json(data | ({"runs": [_run_dict(one) for one in played]} if runs else {}))
        return 0
    _print(options.out, chosen, cells, found)
    for one in played:
        scenario = one.cell.scenario
        learned = make_run(scenario, {"seed": one.seed, "learner": one.cell.learner})
        print(result_table(learned, summary(one.trials), joint_optimum(scenario)))
        print(f"tables  {one.folder / 'tables.npz'}")
    return 0


def parse_targets(
    targets: Sequence[str],
) -> tuple[list[Experiment], list[Condition], list[tuple[Condition, int]]]:
    """Return the experiments, the cells (theirs and those named), and single runs, each once.

    Raises:
        SettingError: neither an experiment nor an id; two scenario files of one name.
        ScenarioError: an id with an unknown scenario.
    """
    named = [name for name in NAMES if name in targets or not targets]
    chosen = [experiment(name) for name in named]
    cells: dict[str, Condition] = {}
    runs: dict[str, tuple[Condition, int]] = {}
    digests: dict[str, str] = {}
    for target in targets:
        if target in NAMES:
            continue
        if "/" not in target:
            raise SettingError(
                f"unknown experiment {target!r}{did_you_mean(target, NAMES)}; allowed: "
                f"{', '.join(NAMES)}, or an id such as env1/coop/penalty=-20"
            )
        cell, number = parse_id(target)
        if digests.setdefault(cell.id, digest(cell)) != digest(cell):
            raise SettingError(
                f"id {target!r}: another scenario file of the name {cell.scenario.name!r} is "
                "asked for too; give one of them another with the field 'name'"
            )
        if number is None:
            cells[cell.id] = cell
        else:
            runs[f"{cell.id}/{number}"] = cell, number
    cells = {cell.id: cell for one in chosen for cell in one.cells} | cells
    return chosen, list(cells.values()), list(runs.values())


def compute(
    results: Results, cells: Iterable[Condition], work: dict
) -> dict[str, ConditionResult]:
    """Return every cell's result; compute and save those that are not there yet."""
    found = {cell.id: results.load(cell) for cell in cells}
    missing = [cell for cell in cells if found[cell.id] is None]
    plan = results.plan
    total = sum(_agent_steps(cell) * plan.runs for cell in missing)
    with tqdm(
        total=total,
        unit=" agent-steps",
        unit_scale=True,
        disable=None if missing else True,
        file=sys.stderr,
        smoothing=0.05,
    ) as bar:
        for cell in missing:
            bar.set_description(cell.id)
            runs = run_batch(cell.scenario, cell.learner, plan.seeds, trials=plan.trials, **work)
            result = collect(cell, plan.trials, _counted(runs, bar, _agent_steps(cell)))
            results.save(cell, result)
            found[cell.id] = result
    return found


def complete(
    results: Results, chosen: Sequence[Experiment], found: dict[str, ConditionResult]
) -> tuple[list[Experiment], dict[str, ConditionResult]]:
    """Return every experiment whose cells are all there, in the order of `NAMES`, and its cells.

    Args:
        results: the results directory.
        chosen: experiments whose cells are found.
        found: results of cells.
    """
    shown, found = [], dict(found)
    asked = {one.name: one for one in chosen}
    for name in NAMES:
        one = asked.get(name) or experiment(name)
        if name in asked or all(_there(results, cell, found) for cell in one.cells):
            shown.append(one)
    return shown, found


def _there(results: Results, cell: Condition, found: dict[str, ConditionResult]) -> bool:
    """Whether a cell's result is found, or in the directory: then it is put to those found."""
    if cell.id not in found:
        try:
            result = results.load(cell)
        except ResultsError:  # of another protocol: not asked for, so nothing to complain about
            return False
        if result is None:
            return False
        found[cell.id] = result
    return True


class Played(NamedTuple):
    """A single run: its cell, its seed, its trials, and the folder of what it learned."""

    cell: Condition
    seed: int
    trials: Trials
    folder: Path


def one_run(results: Results, cell: Condition, number: int, work: dict) -> Played:
    """Compute one run of a cell and save what it learned, as `train` does.

    Where that run is there already, only its trials are played again.

    Raises:
        ResultsError: something else is in its place, or it cannot be written.
    """
    seed, trials = results.plan.seed + number, results.plan.trials
    folder = results.run_folder(cell, number)
    text = make_run(cell.scenario, {"seed": seed, "learner": cell.learner}).to_yaml()
    try:
        if folder.exists():
            return Played(cell, seed, _played_again(folder, text, cell, seed, trials), folder)
    except OSError as error:
        raise unusable_file(folder, error, "read") from None
    [run] = run_batch(cell.scenario, cell.learner, [seed], trials=trials, **work)
    partial = folder.with_name(f"{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)  # of an interrupted call
    try:
        partial.mkdir(parents=True)
        (partial / RUN_FILE).write_text(text, encoding="utf-8")
        save_team(partial, run.tables)
        os.rename(partial, folder)
    except OSError as error:
        raise unusable_file(folder, error, "written") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return Played(cell, seed, run.trials, folder)


def _played_again(folder: Path, text: str, cell: Condition, seed: int, trials: int) -> Trials:
    try:
        same = (folder / RUN_FILE).read_text(encoding="utf-8") == text
    except (OSError, UnicodeDecodeError):
        same = False
    if not same:
        raise ResultsError(
            f"{folder}: exists already and is another run than this would be (scenario, learning "
            "protocol, seed or versions); nothing is overwritten: remove it, or choose another "
            "--out"
        )
    return play(cell.scenario, load_team(folder, cell.scenario), trials=trials, seed=seed)


def _agent_steps(cell: Condition) -> int:
    return cell.scenario.steps * len(cell.scenario.robots)


def _counted(runs: Iterable[Run], bar: tqdm, size: int) -> Iterable[Run]:
    for run in runs:
        bar.update(size)
        yield run


def _run_dict(one: Played) -> dict:
    return {
        "id": one.cell.id,
        "seed": one.seed,
        "directory": str(one.folder),
        **summary(one.trials).to_dict(),
    }


def _print(
    out: Path, chosen: list[Experiment], cells: list[Condition], found: dict[str, ConditionResult]
) -> None:
    own = {cell.id for one in chosen for cell in one.cells}
    rows = []
    for cell in cells:
        if cell.id in own and len(chosen) > 1:
            continue
        result = found[cell.id]
        reward, asks = result.measure("reward"), result.measure("asks")
        rows.append(
            [
                cell.id,
                f"{reward.mean:.2f} ± {reward.spread:.2f}",
                f"{reward.standard_error:.2f}",
                f"{result.measure('miscoordinations').mean:.2f}",
                f"{asks.mean:.2f}",
                f"{result.arrived:.2%}",
                f"{result.optimum:.2f}" if result.optimum_exact else f"<= {result.optimum:.2f}",
            ]
        )
    if rows:
        head = ["cell", "reward", "s.e.", "miscoord.", "asks", "all arrived", "optimum"]
        print(shared.format_table(head, rows))
    if chosen:
        print(f"report: {out / 'reproduction.md'}")
