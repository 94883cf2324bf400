# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord settings`: every setting, its default, what it allows and what it means."""

import argparse
import shutil
import textwrap
from collections.abc import Iterator, Mapping
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


class Group(NamedTuple):
    """Settings that belong together: what they are about, how one is set, and the settings."""

    about: str
    how: str
    settings: Mapping[str, Setting]


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs, "settings", example="sparse_coord settings\n  sparse_coord settings link starts"
    )
    parser.add_argument(
        "names",
        metavar="NAME",
        nargs="*",
        help=f"settings, learners, or groups: {', '.join(group_names())} (default: all)",
    )
    shared.add_json(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    known = groups()
    check_names(options.names, known)
    chosen = {name: chosen_settings(name, one, options.names) for name, one in known.items()}
    learners = chosen_learners(options.names)
    if options.json:
        facts: dict[str, Any] = {
            name: {key: setting_facts(one) for key, one in some.items()}
            for name, some in chosen.items()
            if some
        }
        if learners:
            facts[LEARNER_GROUP] = {name: learner_facts(one) for name, one in learners.items()}
        shared.print_json(facts)
        return 0
    whole = not options.names
    parts = [
        "\n".join([f"{known[name].about} ({known[name].how})", "", *lines_of(some, whole)])
        for name, some in chosen.items()
        if some
    ]
    if learners:
        parts.append("\n".join(["Learners (--learner NAME)", "", *lines_of_learners(learners)]))
    print("\n\n".join(parts))
    if whole:
        print("\nThe forms of a setting with their numbers: sparse_coord settings NAME")
    return 0


def groups() -> dict[str, Group]:
    """Return the groups of settings, in the order in which they are shown."""
    by_hand = "--set NAME=VALUE; in a scenario file; ROS parameters of the world"
    others = [name for name in SETTINGS if name not in (*DIALOGUE, *PROTOCOL)]
    found = {
        "scenario": Group("What is played", by_hand, _some(others)),
        "dialogue": Group("Who asks whom, and who answers", by_hand, _some(DIALOGUE)),
        "protocol": Group("How robots learn", by_hand, _some(PROTOCOL)),
        "run": Group(
            "A run", "options of run and train; ROS parameters of the world", RUN_SETTINGS
        ),
        "drive": Group("Simulated bodies", "drive --set NAME=VALUE", DRIVE_SETTINGS),
    }
    for node, table in _nodes().items():
        rest = {k: one for k, one in table.items() if one is not RUN_SETTINGS.get(k)}
        found[node] = Group(f"The node {node}", "ROS parameters", rest)
    return found


def group_names() -> list[str]:
    """Return the names of the groups that there always are."""
    return ["scenario", "dialogue", "protocol", "run", "drive", LEARNER_GROUP]


def _some(names) -> dict[str, Setting]:
    return {name: SETTINGS[name] for name in names}


def _nodes() -> Mapping[str, SettingTable]:
    """Return the parameters of each node; nothing where there is no ROS 2."""
    try:
        from sparse_coord_ros.nodes import parameters, player, watch
    except ImportError:
        return {}
    return {
        "world_simulator": parameters.WORLD_PARAMETERS,
        "robot": parameters.ROBOT_PARAMETERS,
        "recorder": parameters.RECORDER_PARAMETERS,
        "driver": parameters.DRIVER_PARAMETERS,
        "body": parameters.BODY_PARAMETERS,
        "player": player.PLAYER_PARAMETERS,
        "watch": watch.WATCH_PARAMETERS,
    }


def check_names(names: list[str], groups: Mapping[str, Group]) -> None:
    """Raise `SettingError` where nothing has one of the names."""
    known = [*groups, LEARNER_GROUP, *LEARNERS.names]
    known += [name for one in groups.values() for name in one.settings]
    for name in names:
        if name not in known:
            raise SettingError(
                f"unknown setting {name!r}{did_you_mean(name, known)}; allowed: the name of a "
                "setting, a learner or a group; 'sparse_coord settings' lists them all"
            )


def chosen_settings(name: str, group: Group, names: list[str]) -> Mapping[str, Setting]:
    """Return those settings of a group that are asked for."""
    if not names or name in names:
        return group.settings
    return {name: one for name, one in group.settings.items() if name in names}


def chosen_learners(names: list[str]) -> Mapping[str, Learner]:
    """Return the learners that are asked for."""
    known = {name: LEARNERS.find(name) for name in LEARNERS.names}
    if not names or LEARNER_GROUP in names:
        return known
    return {name: one for name, one in known.items() if name in names}


def lines_of(settings: Mapping[str, Setting], whole: bool) -> Iterator[str]:
    """Write settings; where it is not the whole list, with the numbers of each form."""
    name_width = max(len(name) for name in settings) + 2
    for name, one in settings.items():
        yield from _wrapped(
            f"{name:<{name_width}}{_default(one)}   [{one.allowed}]", indent=name_width
        )
        yield from _wrapped(" " * name_width + one.help, indent=name_width)
        if whole or isinstance(one.kind, type):
            continue
        for form in one.kind.forms:
            spans = [f"{n.name.upper()} {_span(n.low, n.high)}".strip() for n in form.numbers]
            numbers = f" ({', '.join(spans)})" if spans else ""
            said = f"{form.text}: {form.meaning}{numbers}"
            yield from _wrapped(" " * (name_width + 2) + said, indent=name_width + 4)


def lines_of_learners(learners: Mapping[str, Learner]) -> Iterator[str]:
    """Write learners."""
    width = max(len(name) for name in learners) + 2
    for name, one in learners.items():
        yield from _wrapped(f"{name:<{width}}{one.summary}", indent=width)
        if one.defaults:
            own = ", ".join(f"{key}={value}" for key, value in one.defaults.items())
            yield from _wrapped(f"{'':<{width}}defaults of its own: {own}", indent=width)


def _default(setting: Setting) -> str:
    value = setting.default
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    return str(value) if value not in ("", [""]) else "none"


def _span(low: float, high: float) -> str:
    """Return a range of numbers in words; empty where any number goes."""
    unbounded = (low == float("-inf"), high == float("inf"))
    if all(unbounded):
        return ""
    if unbounded[1]:
        return f"at least {low:g}"
    return f"at most {high:g}" if unbounded[0] else f"from {low:g} to {high:g}"


def _wrapped(text: str, *, indent: int) -> list[str]:
    width = min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns)
    return textwrap.wrap(
        text,
        max(width, indent + 30),
        subsequent_indent=" " * indent,
        drop_whitespace=True,
        break_long_words=False,
        break_on_hyphens=False,
    )


def setting_facts(setting: Setting) -> dict[str, Any]:
    """Return plain data of a setting."""
    kind = setting.kind
    facts: dict[str, Any] = {
        "type": kind.__name__ if isinstance(kind, type) else "form",
        "default": setting.default,
        "allowed": setting.allowed,
        "meaning": setting.help,
        "low": setting.low,
        "high": setting.high,
        "choices": list(setting.choices),
    }
    if not isinstance(kind, type):
        facts["forms"] = [
            {
                "form": form.text,
                "meaning": form.meaning,
                "numbers": [
                    {"name": n.name, "low": n.low, "high": n.high, "repeated": n.repeated}
                    for n in form.numbers
                ],
            }
            for form in kind.forms
        ]
    return facts


def learner_facts(learner: Learner) -> dict[str, Any]:
    """Return plain data of a learner."""
    return {
        "title": learner.title,
        "summary": learner.summary,
        "asks": learner.asks,
        "alone": learner.alone,
        "defaults": dict(learner.defaults),
    }
