# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options and output that several verbs share."""

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import fields, is_dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from sparse_coord_ros.base.errors import RunError, SettingError, in_line, needed
from sparse_coord_ros.core.game.scenario import (
    SETTINGS,
    Scenario,
    load_scenario,
    scenario_names,
)
from sparse_coord_ros.core.game.settings import Setting, parse_assignments
from sparse_coord_ros.core.learners.registry import LEARNERS
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS
from sparse_coord_ros.show.page.controls import PAGE_SETTINGS

FIXED = (
    *("scenario", "penalty", "assignments", "steps", "seed", "out", "learner"),
    *("checkpoint", "tables", "greedy", "no_record", "start", "goal"),
)
"""Options that a resumed run has already, by their names in the namespace."""


def ros_needed(alternative: str | None = None) -> AbstractContextManager[None]:
    """Import ROS 2; if it is missing, the RunError names a command that does not need it."""
    ways = [
        "source a ROS 2 Jazzy installation",
        "install this package with the extra 'ros' (pip install '.[ros]')",
    ]
    ways += [] if alternative is None else [f"use '{alternative}'"]
    return needed("ROS 2 is not there", f"{', '.join(ways[:-1])}, or {ways[-1]}")


class Option(NamedTuple):
    """An option or an argument of a verb.

    Attributes:
        words: its name and the placeholder of its value, as in usage lines: "--out FILE", "[bag
            BAG]" if it is optional, "learners LEARNER..." if there can be several.
        kind: bool: a flag; a `Setting`: its values, with its default, and required without one; a
            tuple of texts: one of these, the first by default; else the reader of the value: a
            type, a function, or None for a text; without a default.
        help: its help text.
        more: further arguments of `add_argument`; and `names`, the completions of the Tab key.
    """

    words: str
    kind: Setting | tuple[str, ...] | Callable[[str], Any] | None
    help: str
    more: Mapping[str, Any] = {}


def add_options(
    parser: argparse.ArgumentParser, options: Iterable[Option | Setting]
) -> None:
    """Add options to a parser; a `Setting` stands for the option of its name."""
    for option in options:
        if isinstance(option, Setting):
            option = Option(f"--{option.name}", option, option.help)
        name, _, _ = option.words.strip("[]").partition(" ")
        arguments = _arguments(name, option)
        offered = arguments.pop("names", None)
        action = parser.add_argument(name, **arguments)
        if offered is not None:  # argcomplete calls its `completer`
            setattr(action, "completer", lambda offered=offered, **_: offered())  # noqa: B010


def _arguments(name: str, option: Option) -> dict[str, Any]:
    """Return the arguments of `add_argument` for an option; and its `names`, if it has any."""
    arguments = {
        "help": _help(option),
        **_values(option.words),
        **_reading(name, option.kind),
    }
    arguments |= option.more
    default = arguments.get("default")
    if isinstance(default, tuple):
        default = " ".join(default)
    if default not in (None, [], ""):
        arguments["help"] += f" (default: {default})"
    return arguments


def _help(option: Option) -> str:
    """Return an option's help, with the numbers that it allows."""
    if isinstance(option.kind, Setting) and option.kind.kind in (int, float):
        return f"{option.help}; {option.kind.allowed}"
    return option.help


def _values(words: str) -> dict[str, Any]:
    """Return the placeholder and the number of an option's values, from its words."""
    required = words.strip("[]")
    optional = words != required
    several = required.endswith("...")
    _, _, metavar = required.removesuffix("...").partition(" ")
    arguments: dict[str, Any] = {"metavar": metavar} if metavar else {}
    if several:
        arguments["nargs"] = "*" if optional else "+"
    elif optional:
        arguments["nargs"] = "?"
    return arguments


def _reading(
    name: str,
    kind: Setting | tuple[str, ...] | Callable[[str], Any] | None,
) -> dict[str, Any]:
    """Return how the value of an option with this name is read; `kind`: as in `Option`."""
    if kind is bool:
        return {"action": "store_true"}
    if isinstance(kind, tuple):
        return {"choices": kind, "default": kind[0]}
    if isinstance(kind, Setting):
        required = kind.default is None
        return {
            "type": partial(kind.parse, called=name),
            "default": kind.default,
            "required": required,
        }
    if kind is Path:
        return {"type": _path}
    return {} if kind is None else {"type": kind}


def _path(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("is empty: give a path")
    return Path(text)


BAG = Option("bag BAG", Path, "a run or bag directory, or a bag file")
ALLOW = Option(
    "--allow MODULE",
    None,
    "allow this Python module to be imported when a file refers to it; may be repeated",
    {"action": "append", "default": []},
)
"""Of each verb that may need code that a file names."""

JSON = Option("--json", bool, "print the result as JSON")
SEED = RUN_SETTINGS["seed"]
PAGE = (
    *PAGE_SETTINGS.values(),
    Option("--browser", bool, "open the page in the browser"),
)
"""The options of the page's address."""

PAGE_NAMES = (*PAGE_SETTINGS, "browser")
"""Their names in the namespace."""

WATCH = (
    Option(
        "--watch",
        bool,
        "show the run on a page in the browser; the page stays open at the end",
    ),
    *PAGE,
)


def changes(help: str) -> Option:
    """Return --set."""
    arguments = {"action": "append", "default": [], "dest": "assignments"}
    return Option("--set KEY=VALUE", None, help, arguments)


def scenario_options(*, optional: bool = False) -> tuple[Option, ...]:
    """Return SCENARIO and the options that change it."""
    words = "[scenario SCENARIO]" if optional else "scenario SCENARIO"
    known = f"scenario file, or one of: {', '.join(scenario_names())}"
    what = "change a scenario setting, e.g. perception=probability:0.7; may be repeated"
    return (
        Option(words, None, known, {"names": scenario_names}),
        Option("--penalty", None, "penalty of a miscoordination (r^C), e.g. -20"),
        changes(what),
        _place("start"),
        _place("goal"),
    )


def _place(which: str) -> Option:
    """Return --start or --goal."""
    text = (
        f"another {which} of a robot: row and column of a free cell, from 0 at the top left; "
        "may be repeated"
    )
    arguments = {"action": "append", "default": []}
    return Option(f"--{which} ROBOT=ROW,COLUMN", None, text, arguments)


def run_options(resume: str) -> tuple[Option | Setting, ...]:
    """Return the options of a learning run: scenario, learner, output and resuming.

    Args:
        resume: help of --resume.
    """
    known = [
        f"{name}: {learner.summary}" for name, learner in LEARNERS.registered.items()
    ]
    learner = {
        "default": RUN_SETTINGS["learner"].default,
        "names": lambda: LEARNERS.names,
    }
    return (
        *scenario_options(optional=True),
        Option("--steps", None, "learning steps (default: the scenario's)"),
        SEED,
        Option(
            "--out",
            Path,
            "output directory; must not exist (default: runs/<name>_<time>)",
        ),
        Option(
            "--learner",
            None,
            f"{'; '.join(known)}; or your own learner as module:Class",
            learner,
        ),
        Option("--resume DIR", Path, resume),
    )


def nothing_else_given(options: argparse.Namespace) -> None:
    """Refuse options that would change a resumed run.

    Raises:
        RunError: another option is given with --resume.
    """
    names = {name: f"--{name.replace('_', '-')}" for name in FIXED}
    names |= {"scenario": "SCENARIO", "assignments": "--set"}
    given = [
        shown
        for name, shown in names.items()
        if getattr(options, name, None) != options.parser.get_default(name)
    ]
    if given:
        what = "it" if len(given) == 1 else "them"
        remedy = (
            f"leave {what} out: sparse_coord {options.verb} --resume {options.resume}"
        )
        raise RunError(
            f"{', '.join(given)} cannot change a run that is resumed; {remedy}"
        )


def allowed_with(
    options: argparse.Namespace, partner: str, names: Iterable[str]
) -> None:
    """Refuse options that do nothing without another one.

    Args:
        options: of the verb; the other option is not among them.
        partner: the other option, as the user writes it.
        names: the options' names in the namespace.

    Raises:
        SettingError: one of them is given.
    """
    for name in names:
        if getattr(options, name) != options.parser.get_default(name):
            shown = f"--{name.replace('_', '-')}"
            raise SettingError(f"{shown}: allowed with {partner} only; add {partner}")


def settings_of(options: argparse.Namespace) -> dict[str, str]:
    """Return the scenario settings that the options change.

    Raises:
        SettingError: a --set without '='; a setting that another option changes, too.
    """
    values = parse_assignments(options.assignments)
    for name in ("penalty", "steps"):
        if getattr(options, name, None) is not None:
            if name in values:
                raise SettingError(
                    f"setting {name}: given by --{name} and by --set; give one of them"
                )
            values[name] = getattr(options, name)
            SETTINGS[name].parse(values[name], called=f"--{name}")
    return values


def scenario_of(options: argparse.Namespace) -> Scenario:
    """Return the scenario that the options describe.

    Raises:
        RunError: no scenario is given.
        ScenarioError: the scenario does not exist, or is malformed.
        SettingError: a bad --set, --penalty or --steps.
    """
    if options.scenario is None:
        remedy = f"see sparse_coord {options.verb} --help"
        raise RunError(f"a SCENARIO is missing, or --resume DIR; {remedy}")
    scenario = load_scenario(options.scenario).with_settings(settings_of(options))
    return scenario.with_places(_places(options, "start"), _places(options, "goal"))


def _places(options: argparse.Namespace, which: str) -> dict[str, object]:
    """Return the places of --start or --goal, by robot.

    Raises:
        SettingError: a text is not ROBOT=ROW,COLUMN.
    """
    cells: dict[str, object] = {}
    for text in getattr(options, which):
        robot, _, cell = text.partition("=")
        numbers = cell.split(",")
        if not robot or not all(number.strip().isdecimal() for number in numbers):
            raise SettingError(
                f"--{which} {text}: write it as ROBOT=ROW,COLUMN, e.g. robot_1=0,3"
            )
        cells[robot.strip()] = [int(number) for number in numbers]
    return cells


def output_directory(options: argparse.Namespace, name: str) -> Path:
    """Return the output directory: --out, or one with a time stamp."""
    return options.out or Path("runs") / f"{name}_{datetime.now():%Y%m%d_%H%M%S}"


def note(text: str) -> None:
    """Print a note for the user on stderr."""
    print(text, file=sys.stderr, flush=True)


def tell(options: argparse.Namespace, facts: Any, *lines: str) -> None:
    """Print the result of a verb: lines, or with --json one JSON object of the facts.

    Facts may contain records and paths; NaN becomes null.
    """
    if options.json:
        lines = (json.dumps(_plain(facts), indent=2, allow_nan=False),)
    print("\n".join(lines), flush=True)  # so that a later error comes after it


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
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data


def format_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a text table, first column left, others right; its cells may be foreign texts."""
    table = [list(map(in_line, row)) for row in (head, *rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    table.insert(1, ["-" * width for width in widths])
    form = "  ".join(
        f"{{:{'>' if column else '<'}{n}}}" for column, n in enumerate(widths)
    )
    return "\n".join(form.format(*row).rstrip() for row in table)
