# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The verbs, and a parser whose errors are one line; nothing that takes time to import."""

import argparse
import importlib
import re
from collections.abc import Mapping
from typing import Any, NoReturn

from sparse_coord_ros.base.errors import EXIT_BAD_INPUT, did_you_mean

VERBS: Mapping[str, str] = {
    "run": "let a team learn live over ROS 2 nodes, topics and services, recorded to MCAP",
    "train": "learn without ROS: the same computation, the same bits",
    "improve": "let a team plan on what its robots have learned, after they exchanged it once",
    "evaluate": "evaluate learned tables by Monte-Carlo trials, as in the paper, or exactly",
    "drive": "drive a learned team through a simulator of bodies, in metres and seconds",
    "optimum": "compute the exact joint optimum: full joint state and action, no cost of asking; "
    "the exact worth of fixed shortest paths; and the best team of Algorithm 1's form",
    "doctor": "look whether all is here that a run needs, and say what to do where it is not",
    "settings": "list all settings: defaults, what is allowed, what they mean",
    "maps": "list the maps, or show one",
    "import-map": "make a map and a scenario of a building's map, as map_server reads it",
    "export-map": "write a map as map_server reads it",
    "info": "say what is in a bag: the run, its topics and files, whether it is whole",
    "verify": "compute a recorded run again, from its seed and its log alone, and compare",
    "explain": "trace each COORDINATE of a time step: question, answer, what was learned from it",
    "watch": "show a team that learns on a page in the browser: a live one, or a recorded run",
    "halt": "let all robots of a team stand at once, or go on",
    "conformance": "check whether a robot node of one's own keeps the contract of the interface",
    "replay": "play a recorded run back over ROS 2: same messages, types, QoS and clock",
    "recover": "finish a bag that a crash cut off or that is damaged, as far as it can be read",
    "tables": "take the tables of a checkpoint out of a bag",
    "plot": "draw policies, ask maps, learning curves, sparsity and percepts of runs, or results",
    "animate": "make a film (GIF) of an episode: robots move, ask and are answered",
    "report": "tell all of a run, or of results, in one HTML file: pictures, worth, faults",
    "benchmark": "judge learners on fixed lists of scenarios",
    "reproduce": "reproduce the paper's tables and figures, and go beyond them",
}
"""Every verb and what it does; its module is imported where it is chosen."""

LIVE = ("run", "replay", "halt", "conformance")
"""Verbs that run ROS nodes, which mind signals by themselves."""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, and to which -3,2 is a value, not an option."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._negative_number_matcher = re.compile(r"^-[\d.]")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As of argparse; but no word may be left over, and the nearest right one is told."""
        found, left = super().parse_known_args(args, namespace)
        if left:
            options = [word.partition("=")[0] for word in left if word.startswith("-")]
            hints = [did_you_mean(one, self._option_string_actions) for one in options]
            self.error(f"unrecognized arguments: {' '.join(left)}{''.join(hints)}")
        return found, left

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """As of argparse; the nearest right word is told."""
        if action.choices is not None and value not in action.choices:
            known = [str(one) for one in action.choices]
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
    what = "may be imported if what is read here names it: a learner or model of yours; repeatable"
    parser.add_argument(
        "--allow", metavar="MODULE", action="append", default=[], help=what
    )
    parser.set_defaults(execute=module.execute, parser=parser)
