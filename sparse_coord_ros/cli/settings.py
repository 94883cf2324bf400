# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord settings`: every setting, its default, what it allows and what it means."""

import argparse
import shutil
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.driving.trials import DRIVE_SETTINGS
from sparse_coord_ros.errors import SettingError, did_you_mean
from sparse_coord_ros.game.scenario import DIALOGUE, PROTOCOL, SETTINGS
from sparse_coord_ros.game.settings import Setting, SettingTable
from sparse_coord_ros.learn.learners import LEARNERS, Learner
from sparse_coord_ros.learn.run_config import RUN_SETTINGS

WIDEST = 100
"""Characters of a line."""

LEARNER_GROUP = "learners"
ALWAYS = ("scenario", "dialogue", "protocol", "run", "drive", LEARNER_GROUP)
"""Groups that there are without ROS 2, too."""

LEARNER_FACTS = ("title", "summary", "asks", "alone", "defaults")


class Group(NamedTuple):
    """Settings that belong together: what they are about, how one is set, and the settings."""

    about: str
    how: str
    settings: Mapping[str, Setting]


EXAMPLE = "sparse_coord settings\n  sparse_coord settings link starts"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        "names",
        metavar="NAME",
        nargs="*",
        help=f"settings, learners, or groups: {', '.join(ALWAYS)} (default: all)",
    )
    shared.add_json(parser)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    names, everything = options.names, groups()
    learners = {name: LEARNERS.find(name) for name in LEARNERS.names}
    _check_names(names, everything, learners)
    chosen = {
        group: {name: one for name, one in known.settings.items() if _asked(names, group, name)}
        for group, known in everything.items()
    }
    learners = {name: one for name, one in learners.items() if _asked(names, LEARNER_GROUP, name)}
    if options.json:
        facts: dict[str, Any] = {
            group: {name: setting_facts(one) for name, one in some.items()}
            for group, some in chosen.items()
            if some
        }
        if learners:
            facts[LEARNER_GROUP] = {
                name: {fact: getattr(one, fact) for fact in LEARNER_FACTS}
                for name, one in learners.items()
            }
        shared.print_json(facts)
        return 0
    parts = [
        [f"{everything[group].about} ({everything[group].how})", "", *lines_of(some, not names)]
        for group, some in chosen.items()
        if some
    ]
    if learners:
        parts.append(["Learners (--learner NAME)", "", *lines_of_learners(learners)])
    print("\n\n".join("\n".join(lines) for lines in parts))
    if not names:
        print("\nThe forms of a setting with their numbers: sparse_coord settings NAME")
    return 0


def groups() -> dict[str, Group]:
    """Return the groups of settings, in the order in which they are shown."""
    by_hand = "--set NAME=VALUE; in a scenario file; ROS parameters of the world"
    others = [name for name in SETTINGS if name not in (*DIALOGUE, *PROTOCOL)]
    found = {
        group: Group(about, by_hand, {name: SETTINGS[name] for name in names})
        for group, about, names in (
            ("scenario", "What is played", others),
            ("dialogue", "Who asks whom, and who answers", DIALOGUE),
            ("protocol", "How robots learn", PROTOCOL),
        )
    }
    how = "options of run and train; ROS parameters of the world"
    found["run"] = Group("A run", how, RUN_SETTINGS)
    found["drive"] = Group("Simulated bodies", "drive --set NAME=VALUE", DRIVE_SETTINGS)
    for node, table in _nodes().items():
        own = {name: one for name, one in table.items() if one is not RUN_SETTINGS.get(name)}
        found[node] = Group(f"The node {node}", "ROS parameters", own)
    return found


def _nodes() -> Mapping[str, SettingTable]:
    """Return the parameters of each node; nothing where there is no ROS 2."""
    try:
        from sparse_coord_ros.nodes import parameters
    except ImportError:
        return {}
    return {
        "world_simulator": parameters.WORLD_PARAMETERS,
        "robot": parameters.ROBOT_PARAMETERS,
        "recorder": parameters.RECORDER_PARAMETERS,
        "driver": parameters.DRIVER_PARAMETERS,
        "body": parameters.BODY_PARAMETERS,
        "player": parameters.PLAYER_PARAMETERS,
        "watch": parameters.WATCH_PARAMETERS,
    }


def _check_names(
    names: list[str], everything: Mapping[str, Group], learners: Mapping[str, Learner]
) -> None:
    known = [*everything, LEARNER_GROUP, *learners]
    known += [name for one in everything.values() for name in one.settings]
    for name in names:
        if name not in known:
            raise SettingError(
                f"unknown setting {name!r}{did_you_mean(name, known)}; allowed: the name of a "
                "setting, a learner or a group; 'sparse_coord settings' lists them all"
            )


def _asked(names: list[str], group: str, name: str) -> bool:
    """Whether something of a group is asked for."""
    return not names or group in names or name in names


def lines_of(settings: Mapping[str, Setting], whole: bool) -> Iterator[str]:
    """Write settings; where it is not the whole list, with the numbers of each form."""
    indent = max(len(name) for name in settings) + 2
    for name, one in settings.items():
        yield from _wrapped(f"{name:<{indent}}{_default(one)}   [{one.allowed}]", indent)
        yield from _wrapped(" " * indent + one.help, indent)
        if whole or isinstance(one.kind, type):
            continue
        for form in one.kind.forms:
            ranges = [f"{n.name.upper()}: {n.allowed}" for n in form.numbers]
            numbers = f" ({', '.join(ranges)})" if ranges else ""
            said = f"{form.text}: {form.meaning}{numbers}"
            yield from _wrapped(" " * (indent + 2) + said, indent + 4)


def lines_of_learners(learners: Mapping[str, Learner]) -> Iterator[str]:
    """Write learners."""
    indent = max(len(name) for name in learners) + 2
    for name, one in learners.items():
        yield from _wrapped(f"{name:<{indent}}{one.summary}", indent)
        if one.defaults:
            own = ", ".join(f"{key}={value}" for key, value in one.defaults.items())
            yield from _wrapped(f"{'':<{indent}}defaults of its own: {own}", indent)


def _default(setting: Setting) -> str:
    value = setting.default
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    return str(value) if value not in ("", [""]) else "none"


def _wrapped(text: str, indent: int) -> list[str]:
    width = min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns)
    return textwrap.wrap(
        text,
        max(width, indent + 30),
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def setting_facts(setting: Setting) -> dict[str, Any]:
    """Return plain data of a setting."""
    kind = setting.kind
    facts = {name: getattr(setting, name) for name in ("default", "allowed", "low", "high")}
    facts |= {"meaning": setting.help, "choices": list(setting.choices)}
    if isinstance(kind, type):
        return {"type": kind.__name__, **facts}
    forms = [
        {
            "form": form.text,
            "meaning": form.meaning,
            "numbers": [asdict(number) for number in form.numbers],
        }
        for form in kind.forms
    ]
    return {"type": "form", **facts, "forms": forms}
