# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord run`: a team learns live over ROS 2."""

import argparse
import atexit
import shutil
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sparse_coord_ros.base.errors import EXIT_INTERRUPTED, BagError, RunError
from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.base.yaml_text import to_yaml
from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.evaluate import (
    add_result,
    evaluation_of,
    result_can_wait,
)
from sparse_coord_ros.core.game.scenario import SETTINGS, Scenario
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS, load_run
from sparse_coord_ros.core.runs.saved_tables import TEAM_FILE, load_team
from sparse_coord_ros.protocol.lockstep.node_checkpoints import CHECKPOINTS
from sparse_coord_ros.show.page.message_board import MessageBoard

if TYPE_CHECKING:
    from sparse_coord_ros.ros.nodes.spin import Stop

EXAMPLE = (
    "sparse_coord run env1 --steps 2000 --seed 7\n  sparse_coord run --resume runs/a"
)


OPTIONS = (
    *shared.run_options(
        "continue an interrupted run from its last common checkpoint; DIR is its output "
        "directory; replaces SCENARIO"
    ),
    shared.Option("--processes", bool, "start each node in its own process"),
    shared.Option(
        "--rate HZ",
        None,
        "limit the speed to this many time steps a second (default: no limit)",
    ),
    shared.Option("--no-record", bool, "do not record a bag"),
    shared.Option(
        "--checkpoint STEPS",
        RUN_SETTINGS["checkpoint"],
        "save a checkpoint and record the tables every STEPS time steps: steps of learning, and "
        "two more for each new episode (default: 10000; 0: only at the end)",
        {"default": None},
    ),
    shared.Option("--tables DIR", None, "start from the tables of this run directory"),
    shared.Option("--greedy", bool, "act greedily on --tables, without learning"),
    *shared.WATCH,
    shared.ALLOW,
    shared.JSON,
)


def execute(options: argparse.Namespace) -> int | None:
    """Run the verb."""
    with shared.ros_needed("sparse_coord train"):
        import rclpy  # noqa: F401
    if not options.watch:
        shared.allowed_with(options, "--watch", shared.PAGE_NAMES)
        return _run(options, *_begin(options))
    from sparse_coord_ros.cli import page
    from sparse_coord_ros.ros.nodes.spin import signals

    if options.processes:
        why = "leave out --processes, or run 'sparse_coord watch' beside it"
        raise RunError(f"--watch shows a team in one process: {why}")
    # One handler for all runs and the time between them, so that no signal is lost.
    with signals() as stop:
        return page.one_by_one(options, _begin, partial(_run, stop=stop), stop)


def _run(
    options: argparse.Namespace,
    out: Path,
    values: dict[str, Any],
    page: MessageBoard | None = None,
    *,
    stop: "Stop | None" = None,
) -> int:
    """Let one team learn; return the exit code."""
    from sparse_coord_ros.cli import live
    from sparse_coord_ros.ros.nodes.outputs import is_finished

    if options.resume is not None and is_finished(out):
        shared.note(f"{out}: the run is finished already")
        result, sentences = _result(options, out)
        shared.tell(options, {"directory": out, **result}, *sentences)
        return 0
    summary = live.run(
        values, processes=options.processes, quiet=options.json, page=page, stop=stop
    )
    saved = (out / TEAM_FILE).exists()
    lines = list(_lines(options, out, summary))
    if saved and summary.get("steps_per_second", 0) and not summary["interrupted"]:
        result, sentences = _result(options, out)
        summary |= result
        lines += sentences
    shared.tell(options, {"directory": out, **summary}, *lines)
    if not summary["interrupted"] and not saved:
        remedy = f"make room, then: sparse_coord run --resume {out}"
        raise RunError(
            f"{out}: not all tables could be saved there (see above); {remedy}"
        )
    if "recording_error" in summary:
        raise BagError(summary["recording_error"])
    return EXIT_INTERRUPTED if summary["interrupted"] else 0


def _begin(options: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    """Return a team's output directory and its parameters."""
    from sparse_coord_ros.ros.nodes.parameters import TEAM_PARAMETERS

    names = ["rate"]
    if options.resume is not None:
        shared.nothing_else_given(options)
        out = options.resume
        load_run(out)  # an error in one line where there is none
        values: dict[str, Any] = {"scenario": ""}
    else:
        scenario = shared.scenario_of(options)
        out = shared.output_directory(options, scenario.name)
        if options.greedy and not options.tables:
            raise RunError(
                "--greedy needs --tables DIR, the output directory of a run to act on"
            )
        names += [
            "scenario",
            "seed",
            "learner",
            "tables",
            "greedy",
            "checkpoint",
        ]
        values = {**shared.settings_of(options), "record": not options.no_record}
    for name in names:
        value = getattr(options, name)
        if value is not None:
            option = f"--{name.replace('_', '-')}"
            values[name] = TEAM_PARAMETERS[name].parse(value, called=option)
    if options.start or options.goal:
        values["scenario"] = _scenario_file(scenario)
    return out, {**values, "out": str(out)}


def _scenario_file(scenario: Scenario) -> str:
    """Write a scenario to a temporary file, which the nodes read at their start."""
    folder = Path(tempfile.mkdtemp(prefix="sparse_coord_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    file = folder / f"{scenario.name}.yaml"
    data = scenario.to_dict()
    left_out = set(SETTINGS) - scenario.given  # a learner may have its own defaults
    chosen = {name: value for name, value in data.items() if name not in left_out}
    write_whole(file, to_yaml(chosen))
    return str(file)


def _counted(options: argparse.Namespace, summary: dict[str, Any]) -> Iterator[str]:
    pace = summary.get("steps_per_second", 0)
    pace_in_words = f"in {summary.get('seconds', 0)} s: {pace} steps/s"
    if options.resume is not None and not pace and not summary["interrupted"]:
        pace_in_words = "(the run was already finished)"
    yield (
        f"\n{summary.get('transitions', 0)} steps {pace_in_words}, "
        f"{summary.get('episodes', 0)} episodes, "
        f"{summary.get('timeouts', 0)} timeouts"
    )
    if summary.get("transitions_dropped"):
        yield f"{summary['transitions_dropped']} transitions were not used for learning"
    for robot, asks in summary.get("asks", {}).items():
        yield f"{robot} asked: " + ", ".join(
            f"{count} {outcome}" for outcome, count in asks.items()
        )


def _lines(
    options: argparse.Namespace, out: Path, summary: dict[str, Any]
) -> Iterator[str]:
    yield from _counted(options, summary)
    saved = (out / TEAM_FILE).exists()
    interrupted = summary["interrupted"]
    if saved:
        yield f"tables  {out / TEAM_FILE}"
    yield f"run     {out / 'run.yaml'}"
    if (interrupted or saved) and (out / CHECKPOINTS).is_dir():
        yield f"not finished; continue with: sparse_coord run --resume {out}"
    if (out / "bag").exists():
        yield f"bag     {out / 'bag'}"


def _result(options: argparse.Namespace, out: Path) -> tuple[dict[str, Any], list[str]]:
    """Evaluate the learned team of a finished run; return the result as data and as lines.

    Nothing is evaluated of a greedy run, and beside a page, which does so itself.
    """
    run = load_run(out)
    if run.greedy or options.watch:
        return {}, []
    tables = load_team(out, run.scenario, run.rule)
    with result_can_wait(out, "run"):
        measures = evaluation_of(run, tables, None)
    result = add_result(out, run, measures)
    return result, [result["verdict"]]
