# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord settings`: every setting, its default, its allowed values and its meaning."""

import argparse
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from typing import Any, NamedTuple

from sparse_coord_ros.base.errors import SettingError, did_you_mean
from sparse_coord_ros.cli.options import JSON, Option, tell
from sparse_coord_ros.core.game.scenario import DIALOGUE_SETTINGS, PROTOCOL, SETTINGS
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import LEARNERS
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS
from sparse_coord_ros.lab.driving.trials import DRIVE_SETTINGS

WIDEST = 100
"""Most characters of a line."""

wrap = partial(
    textwrap.wrap, width=WIDEST, break_long_words=False, break_on_hyphens=False
)

GROUPS = ("scenario", "questions", "protocol", "run", "drive", "learners")
"""Groups that exist also without ROS 2."""

EXAMPLE = "sparse_coord settings\n  sparse_coord settings perception starts"


class Described(NamedTuple):
    """A setting, or a learner.

    Attributes:
        lines: its description, the first line beside its name.
        forms: the forms of its value, one per line; shown if it is requested by name.
        facts: its plain data.
    """

    lines: list[str]
    forms: list[str]
    facts: dict[str, Any]


OPTIONS = (
    Option(
        "[names NAME...]", None, f"settings, learners, or groups: {', '.join(GROUPS)}"
    ),
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    names = options.names
    everything = list(groups())
    known = [name for group, _, entries in everything for name in (group, *entries)]
    for name in names:
        if name not in known:
            raise SettingError(
                f"unknown setting {name!r}{did_you_mean(name, known)}; allowed: the name of a "
                "setting, a learner or a group; 'sparse_coord settings' lists them all"
            )
    facts = {}
    parts = []
    for group, title, entries in everything:
        chosen = {
            k: v
            for k, v in entries.items()
            if not names or group in names or k in names
        }
        if chosen:
            facts[group] = {name: entry.facts for name, entry in chosen.items()}
            parts.append("\n".join([title, "", *lines_of(chosen, forms=bool(names))]))
    if not names:
        parts.append(
            "The forms of a setting with their numbers: sparse_coord settings NAME"
        )
    tell(options, facts, "\n\n".join(parts))


def groups() -> Iterator[tuple[str, str, dict[str, Described]]]:
    """Yield name, title and entries of each group, in the order of the output."""
    by_hand = "--set NAME=VALUE; in a scenario file; ROS parameters of the world"
    others = [name for name in SETTINGS if name not in (*DIALOGUE_SETTINGS, *PROTOCOL)]
    for group, about, names in (
        ("scenario", "The problem", others),
        ("questions", "Questions and answers", DIALOGUE_SETTINGS),
        ("protocol", "Learning", PROTOCOL),
    ):
        yield group, f"{about} ({by_hand})", _entries(SETTINGS[name] for name in names)
    where = "ROS parameters of the world; options of run and train, where they have one"
    yield "run", f"A run ({where})", _entries(RUN_SETTINGS.values())
    yield (
        "drive",
        "Simulated bodies (drive --set NAME=VALUE)",
        _entries(DRIVE_SETTINGS.values()),
    )
    with suppress(ImportError):  # without ROS 2 there are no nodes
        from sparse_coord_ros.ros.nodes.parameters import PARAMETERS

        for node, table in PARAMETERS.items():
            settings = (
                setting
                for name, setting in table.items()
                if setting is not RUN_SETTINGS.get(name)
            )
            yield node, f"The node {node} (ROS parameters)", _entries(settings)
    learners = {name: _learner(LEARNERS.find(name)) for name in LEARNERS.names}
    yield "learners", "Learners (--learner NAME)", learners


def _entries(settings: Iterable[Setting]) -> dict[str, Described]:
    return {setting.name: _setting(setting) for setting in settings}


def _setting(setting: Setting) -> Described:
    default = setting.default if setting.default not in ("", [""]) else "none"
    default_text = str(default)
    if isinstance(default, float):
        default_text = f"{default:g}"
    if isinstance(default, bool):
        default_text = default_text.lower()
    lines = []
    facts = []
    for form in () if isinstance(setting.kind, type) else setting.kind.forms:
        ranges = ", ".join(f"{n.name.upper()}: {n.allowed}" for n in form.numbers)
        lines.append(
            f"{form.text}: {form.meaning}" + (f" ({ranges})" if ranges else "")
        )
        numbers = [asdict(number) for number in form.numbers]
        facts.append({"form": form.text, "meaning": form.meaning, "numbers": numbers})
    names = ("default", "allowed", "low", "high", "choices")
    plain = {
        "meaning": setting.help,
        **{name: getattr(setting, name) for name in names},
        "forms": facts,
    }
    return Described(
        [f"{default_text}   [{setting.allowed}]", setting.help], lines, plain
    )


def _learner(learner: Learner) -> Described:
    defaults = ", ".join(f"{key}={value}" for key, value in learner.defaults.items())
    lines = [learner.summary, *[f"defaults of its own: {defaults}"] * bool(defaults)]
    names = ("summary", "asks", "alone", "defaults")
    return Described(lines, [], {name: getattr(learner, name) for name in names})


def lines_of(entries: dict[str, Described], *, forms: bool) -> Iterator[str]:
    """Write entries, their names first, with or without the forms of their values."""
    indent = max(len(name) for name in entries) + 2
    for name, entry in entries.items():
        first, *more = entry.lines
        texts = [(f"{name:<{indent}}{first}", indent)]
        texts += [(" " * indent + text, indent) for text in more]
        texts += [
            (" " * (indent + 2) + text, indent + 4) for text in entry.forms if forms
        ]
        for text, further in texts:
            yield from wrap(text, subsequent_indent=" " * further)
