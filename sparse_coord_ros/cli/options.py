# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options and output that several verbs share."""

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.scenario import Scenario, load_scenario, scenario_names
from sparse_coord_ros.game.settings import Setting, parse_assignments
from sparse_coord_ros.learn.learners import LEARNERS
from sparse_coord_ros.learn.run_config import RUN_SETTINGS
from sparse_coord_ros.look.page.controls import HOST, PORT

FIXED = (
    *("scenario", "penalty", "assignments", "steps", "seed", "out", "learner"),
    *("checkpoint", "tables", "greedy", "no_record"),
)
"""What a run that is resumed has already, by the options' names in the namespace."""


def ros_missing(error: ImportError, alternative: str | None = None) -> RunError:
    """Return what to say where ROS 2 cannot be imported, and a command that does without it."""
    ways = [
        "source a ROS 2 Jazzy installation",
        "install this package with the extra 'ros' (pip install '.[ros]')",
    ]
    ways += [] if alternative is None else [f"use '{alternative}'"]
    return RunError(f"ROS 2 is not there ({error}); {', '.join(ways[:-1])}, or {ways[-1]}")


def add_setting(
    parser: argparse.ArgumentParser, setting: Setting, help: str | None = None, **more: Any
) -> None:
    """Add the option of a setting; one without a default must be given.

    Args:
        parser: of the verb.
        setting: its name is the option's; a bad value raises `SettingError`.
        help: what it is, instead of the setting's own words.
        more: further arguments of `add_argument`.
    """
    known = setting.default is not None
    parser.add_argument(
        f"--{setting.name.replace('_', '-')}",
        type=setting.parse,
        required=not known,
        default=setting.default,
        help=(help or setting.help) + f" (default: {setting.default})" * known,
        **more,
    )


def add_bag(parser: argparse.ArgumentParser) -> None:
    """Add BAG."""
    parser.add_argument(
        "bag", metavar="BAG", type=_bag, help="a bag's or a run's directory, or a file"
    )


def _bag(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("is empty: give a bag's directory or its file")
    return Path(text)


def add_scenario(parser: argparse.ArgumentParser, *, optional: bool = False) -> None:
    """Add SCENARIO and the options that change it."""
    scenario = parser.add_argument(
        "scenario",
        nargs="?" if optional else None,
        metavar="SCENARIO",
        help=f"path of a scenario file, or one of: {', '.join(scenario_names())}",
    )
    completed_by(scenario, scenario_names)
    parser.add_argument("--penalty", help="r^C of a miscoordination, e.g. -20")
    add_set(parser, "change a scenario setting, e.g. perception=probability:0.7; may be repeated")


def completed_by(option: argparse.Action, names: Callable[[], Iterable[str]]) -> None:
    """Let the Tab key offer names for an option's value; argcomplete calls its `completer`."""
    setattr(option, "completer", lambda **_: names())  # noqa: B010 - argcomplete's way


def add_set(parser: argparse.ArgumentParser, help: str) -> None:
    """Add --set."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="assignments",
        help=help,
    )


def add_run(parser: argparse.ArgumentParser, *, resume: str) -> None:
    """Add the options of a learning run: what learns, where it goes, and whether it goes on.

    Args:
        parser: of the verb.
        resume: help of --resume.
    """
    add_scenario(parser, optional=True)
    parser.add_argument("--steps", help="step budget in transitions (default: the scenario's)")
    add_setting(parser, RUN_SETTINGS["seed"])
    parser.add_argument(
        "--out", type=Path, help="output directory, must not exist (default: runs/<name>_<time>)"
    )
    known = [f"{name}: {learner.summary}" for name, learner in LEARNERS.registered.items()]
    learner = parser.add_argument(
        "--learner",
        default=RUN_SETTINGS["learner"].default,
        help=f"{'; '.join(known)}; or one of your own as module:Class (default: %(default)s)",
    )
    completed_by(learner, lambda: LEARNERS.names)
    parser.add_argument("--resume", type=Path, metavar="DIR", help=resume)


def add_page(parser: argparse.ArgumentParser) -> None:
    """Add what says where the page is served."""
    parser.add_argument(
        "--port",
        default=str(PORT),
        metavar="N",
        help=f"of the page (default: {PORT}; 0: one that is free)",
    )
    parser.add_argument(
        "--host",
        default=HOST,
        metavar="ADDRESS",
        help="serve the page on this address, also for other machines: who reaches it can watch "
        f"(default: {HOST}, this machine only)",
    )
    parser.add_argument("--browser", action="store_true", help="open the page in the browser")


def add_watch(parser: argparse.ArgumentParser) -> None:
    """Add --watch, and where the page is served."""
    parser.add_argument(
        "--watch",
        action="store_true",
        help="show the run on a page in the browser, which stays when it is over",
    )
    add_page(parser)


def nothing_else_given(options: argparse.Namespace) -> None:
    """Refuse what would change a run that is resumed.

    Raises:
        RunError: something is given beside --resume.
    """
    names = {name: f"--{name.replace('_', '-')}" for name in FIXED}
    names |= {"scenario": "SCENARIO", "assignments": "--set"}
    given = [
        shown
        for name, shown in names.items()
        if getattr(options, name, None) != options.parser.get_default(name)
    ]
    if given:
        raise RunError(
            f"{', '.join(given)} cannot change a run that is resumed; leave it out: "
            f"sparse_coord {options.verb} --resume {options.resume}"
        )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add --json."""
    parser.add_argument("--json", action="store_true", help="print one JSON object for machines")


def settings_of(options: argparse.Namespace) -> dict[str, str]:
    """Return the scenario settings that the options change.

    Raises:
        SettingError: a --set without '='.
    """
    values = parse_assignments(options.assignments)
    for name in ("penalty", "steps"):
        if getattr(options, name, None) is not None:
            values[name] = getattr(options, name)
    return values


def scenario_of(options: argparse.Namespace) -> Scenario:
    """Return the scenario that the options describe.

    Raises:
        RunError: none is given.
        ScenarioError: no such scenario, or a malformed one.
        SettingError: a bad --set, --penalty or --steps.
    """
    if options.scenario is None:
        raise RunError(
            f"a SCENARIO is missing, or --resume DIR; see sparse_coord {options.verb} --help"
        )
    return load_scenario(options.scenario).with_settings(settings_of(options))


def output_directory(options: argparse.Namespace, name: str) -> Path:
    """Return the output directory: --out, or one with a time stamp."""
    return options.out or Path("runs") / f"{name}_{datetime.now():%Y%m%d_%H%M%S}"


def note(text: str) -> None:
    """Say on stderr what a user should know while something goes on."""
    print(text, file=sys.stderr, flush=True)


def print_json(data: Any) -> None:
    """Print one JSON object, of records too; numbers that are none (NaN) are null."""
    print(json.dumps(_plain(data), indent=2, allow_nan=False))


def _plain(data: Any) -> Any:
    """Return records as mappings, paths as texts."""
    if hasattr(data, "_asdict"):
        data = data._asdict()
    elif is_dataclass(data):
        data = {field.name: getattr(data, field.name) for field in fields(data)}
    if isinstance(data, Mapping):
        return {name: _plain(value) for name, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    if isinstance(data, Path):
        return str(data)
    return None if isinstance(data, float) and not math.isfinite(data) else data


def format_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a text table, first column left, others right."""
    table = [list(head), *[list(row) for row in rows]]
    widths = [max(len(row[column]) for row in table) for column in range(len(head))]
    lines = []
    for row in table:
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        lines.append("  ".join(cells).rstrip())
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)
