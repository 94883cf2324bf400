# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package's exceptions: one class a role, all of them `SparseCoordError`.

Every message is one line that names the thing, its value, what is allowed and the remedy; the
command line and the nodes print it and exit with `EXIT_BAD_INPUT`.
"""

import difflib
from collections.abc import Iterable

EXIT_BAD_INPUT = 2
"""Exit code of every executable that stops because of bad input."""


class SparseCoordError(Exception):
    """Base of all errors that a user can mend; its text is one line."""


class MapError(SparseCoordError):
    """A map file is missing or malformed."""


class ScenarioError(SparseCoordError):
    """A scenario file is missing or malformed."""


class SettingError(SparseCoordError):
    """A setting (scenario field, `--set`, ROS parameter) is unknown or out of range."""


class PluginError(SparseCoordError):
    """A learner or perception model of the user's own failed; the cause has its traceback."""


class RunError(SparseCoordError):
    """A run cannot start or go on: a robot is missing, a name is taken, a directory exists."""


class NameTakenError(RunError):
    """Another node has this node's name; what it has begun is that other one's."""


class TablesError(SparseCoordError):
    """Learned tables are missing, malformed or do not fit the scenario."""


class ResultsError(SparseCoordError):
    """A results directory cannot be used."""


class BagError(SparseCoordError):
    """A bag cannot be made, written, read or recovered, or a type's definition is missing."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `" (did you mean 'x'?)"` for the nearest known name, or an empty string."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""


def newer_format(where: str, found: int, known: int) -> str:
    """Return what to say of a file in a format that a later version brought."""
    return (
        f"{where}: is in format {found}, this version reads formats up to {known}; update "
        "sparse_coord_ros"
    )


def os_error_text(error: OSError) -> str:
    """Return what went wrong, and with which file where the system says so."""
    problem = error.strerror or str(error)
    return problem if error.filename is None else f"{error.filename}: {problem}"
