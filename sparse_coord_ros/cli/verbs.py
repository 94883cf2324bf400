# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The verbs, and a parser whose errors are one line; it has only fast imports."""

import argparse
import importlib
import re
from collections.abc import Mapping
from typing import Any, NoReturn

from sparse_coord_ros.base.errors import EXIT_BAD_INPUT, did_you_mean

GROUPS: Mapping[str, Mapping[str, str]] = {
    "learn": {
        "train": "train a team without ROS; gives the same tables as run",
        "run": "train a team live over ROS 2 nodes, and record it to MCAP",
        "settings": "list all settings with defaults and allowed values",
        "doctor": "check the installation and suggest fixes",
    },
    "evaluate": {
        "evaluate": "evaluate learned tables by trials or exactly, and compare runs",
        "optimum": "compute the joint optimum, shortest paths and the best asking team",
        "benchmark": "compare learners on fixed lists of scenarios",
        "reproduce": "reproduce the tables and figures of the paper",
    },
    "look at runs": {
        "watch": "show live or recorded runs on a page in the browser",
        "plot": "plot policies, questions, learning curves or results",
        "animate": "record an episode as an animated GIF",
    },
    "bags": {
        "info": "show what a bag contains and whether it is complete",
        "verify": "recompute a recorded run from its seed and log, and compare",
        "explain": "explain the questions of a step: answer, choice, update",
        "replay": "play a recorded run back over ROS 2",
        "tables": "extract the tables of a checkpoint from a bag",
    },
    "scenarios and maps": {
        "maps": "list the scenarios and maps, or show one",
        "import-map": "turn a map_server map into a map and a scenario",
    },
    "robots": {
        "drive": "drive a learned team in a simulation with metres and seconds",
    },
}
"""Every verb with its description, in groups; its module is imported if it is chosen."""

VERBS = {name: text for group in GROUPS.values() for name, text in group.items()}

LIVE = ("run", "replay")
"""Verbs that run ROS nodes, which handle signals by themselves."""


MANY_RUNS = (
    "; many runs: sparse_coord benchmark, or train_many(scenario, runs=20) in Python"
)
"""The hint for the options of `MANY` where a verb makes one run."""

MANY = ("--runs", "--seeds")


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line; it reads -3,2 as a value, not as an option."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._negative_number_matcher = re.compile(r"^-[\d.]")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse; but unknown words are an error, which suggests the nearest right one."""
        known, left = super().parse_known_args(args, namespace)
        if left:
            options = [word.partition("=")[0] for word in left if word.startswith("-")]
            known_options = self._option_string_actions
            hints = [
                MANY_RUNS if option in MANY else did_you_mean(option, known_options)
                for option in options
            ]
            self.error(f"unrecognized arguments: {' '.join(left)}{''.join(hints)}")
        return known, left

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """As argparse; the error suggests the nearest right word."""
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            what = f"invalid choice: {value!r}{did_you_mean(str(value), known)}"
            raise argparse.ArgumentError(action, f"{what}; allowed: {', '.join(known)}")

    def error(self, message: str) -> NoReturn:
        """Print the error in one line and exit."""
        self.exit(EXIT_BAD_INPUT, f"error: {message}; see {self.prog} --help\n")


def add_verb(verbs: Any, name: str) -> None:
    """Import a verb's module and add its parser.

    The module has an `EXAMPLE` that works, its `OPTIONS`, and `execute(options)`, which returns
    the exit code; None: 0.

    Args:
        verbs: the subparsers of `sparse_coord`.
        name: the verb.
    """
    from sparse_coord_ros.cli.options import add_options

    module = importlib.import_module(f"sparse_coord_ros.cli.{name.replace('-', '_')}")
    help = VERBS[name]
    parser = verbs.add_parser(
        name,
        help=help,
        description=f"{help[0].upper()}{help[1:]}.",
        epilog=f"example:\n  {module.EXAMPLE}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_options(parser, module.OPTIONS)
    parser.set_defaults(execute=module.execute, parser=parser)
