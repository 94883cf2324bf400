# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord run`: a team learns live over ROS 2."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.errors import BagError, RunError
from sparse_coord_ros.learn.run_config import RUN_SETTINGS, load_run
from sparse_coord_ros.learn.tables import TEAM_FILE
from sparse_coord_ros.lockstep.checkpoints import CHECKPOINTS

if TYPE_CHECKING:
    from sparse_coord_ros.look.page.server import Server
    from sparse_coord_ros.nodes.spin import Stop

EXAMPLE = "sparse_coord run env1 --steps 2000 --seed 7\n  sparse_coord run --resume runs/a"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    shared.add_run(
        parser,
        resume="go on with a run that ended too early, from its last common checkpoint, instead "
        "of SCENARIO; DIR is its output directory",
    )
    parser.add_argument(
        "--executor",
        choices=("events", "single"),
        default="events",
        help="what runs the callbacks (default: events)",
    )
    parser.add_argument("--processes", action="store_true", help="every node in its own process")
    parser.add_argument("--rate", default="0", metavar="HZ", help="time steps a second, to watch")
    parser.add_argument("--no-record", action="store_true", help="write no bag")
    parser.add_argument(
        "--compression",
        choices=("zstd", "lz4", "none"),
        default="zstd",
        help="of the bag (default: zstd)",
    )
    parser.add_argument(
        "--max-bagfile-size", metavar="BYTES", help="begin another file of the bag after so many"
    )
    parser.add_argument(
        "--max-bagfile-duration",
        metavar="SECONDS",
        help="begin another file of the bag after so many simulated seconds",
    )
    parser.add_argument(
        "--checkpoint",
        metavar="STEPS",
        help="record the tables and save what --resume needs each so many steps (default: 10000; "
        "0: only at the end)",
    )
    parser.add_argument("--tables", metavar="DIR", help="begin with the tables of that run")
    parser.add_argument("--greedy", action="store_true", help="act on --tables without learning")
    shared.add_watch(parser)
    shared.add_json(parser)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise shared.ros_missing(error, "sparse_coord train") from None
    if options.resume is not None:
        shared.nothing_else_given(options, "run")
        values = {"resume": True, "out": str(options.resume), "scenario": "", "set": [""]}
    else:
        values = _new(options)
    for name in ("executor", "rate", "compression", "max_bagfile_size", "max_bagfile_duration"):
        if getattr(options, name) is not None:
            values[name] = getattr(options, name)
    if options.watch:
        return _watched(options, values)
    return _run(options, values)


def _watched(options: argparse.Namespace, values: dict[str, Any]) -> int:
    """Run teams one after the other, as the page wants them."""
    from sparse_coord_ros.cli import page
    from sparse_coord_ros.nodes.spin import signals

    if options.processes:
        raise RunError(
            "--watch shows a team in one process: leave out --processes, or run 'sparse_coord "
            "watch' beside it"
        )
    # One handler for all runs and what is between them: no signal falls into a gap.
    with page.served(options) as server, signals() as stop:
        page.announce(server, options)
        while True:
            code = _run(options, values, server, stop)
            if code:
                return code
            out = Path(values["out"])
            try:
                with stop.at_once():
                    page.show_end(server, load_run(out), out)
                    wish = page.next_wish(server, lambda: bool(stop))
            except KeyboardInterrupt:
                return 0
            kept = [text for text in values["set"] if text and not text.startswith("penalty=")]
            values["scenario"], values["resume"] = wish["scenario"], False
            values["set"] = [*kept, f"penalty={wish['penalty']}"]
            values["out"] = str(shared.new_directory(wish["scenario"]))


def _run(
    options: argparse.Namespace,
    values: dict[str, Any],
    page: "Server | None" = None,
    stop: "Stop | None" = None,
) -> int:
    from sparse_coord_ros.cli import live

    out = Path(values["out"])
    summary = live.run(
        values, processes=options.processes, quiet=options.json, page=page, stop=stop
    )
    if options.json:
        shared.print_json({"directory": str(out), **summary})
    else:
        _print(out, summary)
    if not summary["interrupted"] and not (out / TEAM_FILE).exists():
        sys.stdout.flush()
        raise RunError(
            f"{out}: not all tables could be saved there (see above); make room, then: "
            f"sparse_coord run --resume {out}"
        )
    if "recording_error" in summary:
        sys.stdout.flush()  # the error comes last, wherever both go
        raise BagError(summary["recording_error"])
    return 130 if summary["interrupted"] else 0


def _new(options: argparse.Namespace) -> dict[str, Any]:
    """Return the parameters of a team that begins a run."""
    if options.scenario is None:
        raise RunError("a SCENARIO is missing, or --resume DIR; see sparse_coord run --help")
    scenario = shared.scenario_of(options)
    if options.greedy and not options.tables:
        raise RunError("--greedy needs --tables DIR, the output directory of a run to act on")
    checkpoint = {} if options.checkpoint is None else {"checkpoint": options.checkpoint}
    RUN_SETTINGS.parse({"seed": options.seed, **checkpoint})
    return {
        "scenario": options.scenario,
        "set": [f"{name}={value}" for name, value in shared.settings_of(options).items()] or [""],
        "seed": options.seed,
        "learner": options.learner,
        "out": str(shared.output_directory(options, scenario.name)),
        "record": not options.no_record,
        "tables": options.tables or "",
        "greedy": options.greedy,
        **checkpoint,
    }


def _print(out, summary) -> None:
    print(
        f"\n{summary.get('transitions', 0)} steps in {summary.get('seconds', 0)} s: "
        f"{summary.get('steps_per_second', 0)} steps/s, {summary.get('episodes', 0)} episodes, "
        f"{summary.get('timeouts', 0)} timeouts"
    )
    if summary.get("transitions_dropped"):
        print(f"{summary['transitions_dropped']} transitions were not learned from")
    for robot, asks in summary.get("asks", {}).items():
        print(f"{robot} asked: " + ", ".join(f"{count} {how}" for how, count in asks.items()))
    if (out / TEAM_FILE).exists():
        print(f"tables  {out / TEAM_FILE}")
    print(f"run     {out / 'run.yaml'}")
    saved = summary["interrupted"] or (out / TEAM_FILE).exists()
    if saved and (out / CHECKPOINTS).is_dir():
        print(f"not finished; go on with: sparse_coord run --resume {out}")
    if (out / "bag").exists():
        print(f"bag     {out / 'bag'}")
