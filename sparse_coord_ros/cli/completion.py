# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord completion`: what a shell needs to complete `sparse_coord` with the Tab key.

The shell then calls `sparse_coord` with `_ARGCOMPLETE` in the environment, and argcomplete asks
the parser of the verb. Nothing of this is imported otherwise.
"""

import argparse
import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.driving.trials import DRIVE_SETTINGS
from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.buildings import SIZES
from sparse_coord_ros.game.grid import map_names
from sparse_coord_ros.game.scenario import SETTINGS, scenario_names
from sparse_coord_ros.game.settings import Setting, SettingTable
from sparse_coord_ros.learn.learners import LEARNERS
from sparse_coord_ros.learn.run_config import RUN_SETTINGS

ASKED = "_ARGCOMPLETE"
"""Environment variable by which a shell asks for completions."""

SHELLS = ("bash", "zsh", "fish")

HOW_TO = """add this line to the file that your shell reads first, and open a new shell:
  bash, ~/.bashrc:                   eval "$(sparse_coord completion bash)"
  zsh, ~/.zshrc, after compinit:     eval "$(sparse_coord completion zsh)"
  fish, ~/.config/fish/config.fish:  sparse_coord completion fish | source"""


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs, "completion", example=f"sparse_coord completion bash\n\n{HOW_TO}"
    )
    parser.add_argument("shell", metavar="SHELL", choices=SHELLS, help=" or ".join(SHELLS))
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the verb.

    Raises:
        RunError: argcomplete is not installed.
    """
    try:
        from argcomplete import shellcode
    except ImportError as error:
        raise RunError(
            f"completion needs the Python package argcomplete ({error}); install it: pip install "
            "argcomplete, or sudo apt install python3-argcomplete"
        ) from None
    print(shellcode(["sparse_coord"], shell=options.shell).strip())
    return 0


def complete(make_parser: Callable[[str | None], argparse.ArgumentParser]) -> None:
    """Answer a shell that asks what can stand at the cursor, and end the process.

    Args:
        make_parser: returns the parser of all verbs, with the options of the one given.
    """
    import argcomplete
    from argcomplete.lexers import split_line

    line, point = os.environ.get("COMP_LINE", ""), os.environ.get("COMP_POINT", "0")
    words = split_line(line, int(point))[3][int(os.environ[ASKED]) :]
    parser = make_parser(next((word for word in words if not word.startswith("-")), None))
    add_completers(parser)
    argcomplete.autocomplete(parser)


def add_completers(parser: argparse.ArgumentParser) -> None:
    """Let argcomplete find what each option of a parser, and of its verbs, takes."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for one in action.choices.values():
                add_completers(one)
        elif action.dest in COMPLETERS:
            setattr(action, "completer", COMPLETERS[action.dest])  # noqa: B010 - argcomplete's way


def _with_files(names: Callable[[], Iterable[str]]) -> Callable[..., Iterable[str]]:
    """Return a completer of names, and of files."""

    def completer(prefix: str, **about: Any) -> Iterable[str]:
        from argcomplete.completers import FilesCompleter

        return [*names(), *FilesCompleter()(prefix, **about)]

    return completer


def _names(names: Callable[[], Iterable[str]]) -> Callable[..., Iterable[str]]:
    return lambda **about: names()


def _assignments(prefix: str, parser: argparse.ArgumentParser, **about: Any) -> Iterable[str]:
    """Return `setting=`; after it, the forms of its values."""
    table: SettingTable = DRIVE_SETTINGS if parser.prog.endswith(" drive") else SETTINGS
    name, given, _ = prefix.partition("=")
    if not given or name not in table:
        return [f"{one}=" for one in table]
    return [f"{name}={value}" for value in values_of(table[name])]


def values_of(setting: Setting) -> Iterable[str]:
    """Return what a setting's value can begin with."""
    if setting.kind is bool:
        return ("true", "false")
    if isinstance(setting.kind, type):
        return setting.choices or (str(setting.default),)
    return [form.text.split(":")[0] + ":" * bool(form.numbers) for form in setting.kind.forms]


def _experiments() -> Iterable[str]:
    from sparse_coord_ros.experiments.catalogue import experiment_names

    return experiment_names()


COMPLETERS: Mapping[str, Callable[..., Iterable[str]]] = {
    "scenario": _with_files(scenario_names),
    "name": _with_files(map_names),
    "learner": _names(lambda: LEARNERS.names),
    "assignments": _assignments,
    "names": _names(lambda: [*SETTINGS, *RUN_SETTINGS, *DRIVE_SETTINGS, *LEARNERS.names]),
    "targets": _names(_experiments),
    **{number: _names(lambda: ()) for number in ("steps", "seed", "penalty", "trials", *SIZES)},
}
"""Completers by the name that an option has in the parsed options; all others complete files."""
