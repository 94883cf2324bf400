# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package's exceptions: one class a role, all of them `SparseCoordError`.

Every message is one line that names the thing, its value, what is allowed and the remedy; the
command line and the nodes print it and exit with `EXIT_BAD_INPUT`.
"""

import difflib
import errno
import reprlib
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from sparse_coord_ros.base.version import FORMAT

EXIT_BAD_INPUT = 2
"""Exit code of every executable that stops because of bad input."""

EXIT_FAULT = 1
"""Exit code of every executable that stops because of a fault of its own."""


EXIT_INTERRUPTED = 130
"""Exit code of a program that is interrupted before its end."""


class SparseCoordError(Exception):
    """Base of all errors that end a program in words; its text is one line.

    Attributes:
        exit_code: the exit code of a program that it stops.
    """

    exit_code = EXIT_BAD_INPUT

    def __str__(self) -> str:
        """Return the message on one line, even if it quotes foreign text."""
        return in_line(super().__str__())


class MapError(SparseCoordError):
    """A map file is missing or malformed."""


class ScenarioError(SparseCoordError):
    """A scenario file is missing or malformed."""


class SettingError(SparseCoordError):
    """A setting (scenario field, `--set`, ROS parameter) is unknown or out of range."""


class NotAllowedError(SettingError):
    """A learner or perception model lies in a module that the user has not allowed."""


class PluginError(SparseCoordError):
    """A user's own learner or perception model failed; the cause has its traceback."""


class RunError(SparseCoordError):
    """A run cannot start or continue: a robot is missing, a name is taken, a directory exists."""


class NameTakenError(RunError):
    """Another world runs a team here, or another node has a robot's name: nothing is begun."""


class TablesError(SparseCoordError):
    """Learned tables are missing, malformed or do not fit the scenario."""


class ResultsError(SparseCoordError):
    """A results directory cannot be used."""


class BagError(SparseCoordError):
    """A bag cannot be made, written or read, or a type's definition is missing."""


class FaultError(SparseCoordError):
    """A fault of this software: an unexpected exception; the cause has its traceback."""

    exit_code = EXIT_FAULT


@contextmanager
def needed(what: str, remedy: str) -> Iterator[None]:
    """Import an optional package; raises RunError if it is missing.

    Args:
        what: the feature and the package that it needs.
        remedy: the remedy.
    """
    try:
        yield
    except ImportError as error:
        raise RunError(f"{what} ({error}); {remedy}") from None


INSTALLED_AS = {"PIL": "pillow", "yaml": "PyYAML", "mcap_ros2": "mcap-ros2-support"}
"""What one installs, where it has another name than what one imports."""

EXTRAS = {
    "plots": ("matplotlib", "pandas"),
    "page": ("aiohttp",),
    "maps": ("scipy", "pillow"),
    "cluster": ("distributed",),
    "pettingzoo": ("pettingzoo", "gymnasium"),
}
"""The packages that an extra of setup.py brings, and that its features import."""


def missing_package(error: ImportError) -> RunError | None:
    """Return the error for a missing package of others; None: a fault of this one."""
    if error.name is None or error.name.startswith("sparse_coord_ros"):
        return None
    name = error.name.partition(".")[0]
    package = INSTALLED_AS.get(name, name)
    remedy = f"pip install {package}"
    for extra, packages in EXTRAS.items():
        if package in packages:
            remedy = f"pip install {' '.join(packages)} (the extra '{extra}')"
    return RunError(f"this needs the Python package {package} ({error}): {remedy}")


@contextmanager
def packages_needed() -> Iterator[None]:
    """Import packages of an extra.

    Raises:
        RunError: one is missing; it says what to install.
    """
    try:
        yield
    except ImportError as error:
        raise missing_package(error) or error from None


@contextmanager
def retold(
    error: type[SparseCoordError], caught: type[Exception], what: str, remedy: str = ""
) -> Iterator[None]:
    """Turn an exception into an `error` whose line begins with `what`.

    Args:
        error: the class to raise.
        caught: the exceptions to turn; of an OSError the message has only the reason.
        what: the beginning of the line, before a colon.
        remedy: its end.
    """
    try:
        yield
    except caught as failure:
        why = failure.strerror if isinstance(failure, OSError) else failure
        raise error(f"{what}: {why}{remedy}") from failure


def failure_of(error: Exception) -> SparseCoordError:
    """Return the error with which a program ends after an exception.

    Errors of this package stay; an error of the system names the file; any other exception becomes
    a `FaultError` with the place where it was raised.
    """
    if isinstance(error, SparseCoordError):
        return error
    if isinstance(error, ImportError):
        missing = missing_package(error)
        if missing is not None:
            return missing
    if isinstance(error, OSError):
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        remedy = "make room" if full else "give another path, or one that you may use"
        failure: SparseCoordError = RunError(f"{os_error_text(error)}; {remedy}")
    else:
        message = message_of(error)
        frames = traceback.extract_tb(error.__traceback__)
        raised_at = f" ({frames[-1].filename}:{frames[-1].lineno})" if frames else ""
        what = f"unexpected {type(error).__name__}{f': {message}' if message else ''}{raised_at}"
        failure = FaultError(
            f"{what}; this is a fault of the software, please report it"
        )
    failure.__cause__ = error
    return failure


LONGEST_LINE = 2000
"""Most characters of a line for people."""


def message_of(error: object) -> str:
    """Return what an error says, without line breaks and repeated spaces."""
    return " ".join(str(error).split())


def in_line(text: str) -> str:
    """Return a text as one printable line; the middle of a long one is left out."""
    line = "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode() for c in text
    )
    half = LONGEST_LINE // 2
    return line if len(line) <= LONGEST_LINE else f"{line[:half]} ... {line[-half:]}"


_short = reprlib.Repr()
_short.maxlevel = 3
_short.maxother = _short.maxstring = 80


def in_short(value: object) -> str:
    """Return Python's text of a value, cut to fit a line."""
    return _short.repr(value)


def wrong_argument(name: str, value: object, allowed: str) -> str:
    """Return the error text for a wrong argument."""
    return f"{name}: value is {in_short(value)}, allowed: {allowed}"


def check_argument(
    name: str,
    value: object,
    fits: bool,
    allowed: str,
    error: type[SparseCoordError] = SettingError,
) -> None:
    """Raise an `error` that names an argument, its value and what is allowed, unless it fits."""
    if not fits:
        raise error(wrong_argument(name, value, allowed))


def check_choice(name: str, value: object, known: Iterable[str]) -> None:
    """Raise SettingError unless the value of an argument is one of the known texts."""
    choices = tuple(known)
    if value not in choices:
        raise SettingError(
            f"{name} is {in_short(value)}, allowed: {', '.join(choices)}"
        )


OTHER_WORDS = {
    "alpha": "step_size",
    "learning_rate": "step_size",
    "lr": "step_size",
    "gamma": "discount",
    "episodes": "steps",
    "timesteps": "steps",
    "algorithm": "learner",
    "agent": "learner",
    "output": "out",
    "total_timesteps": "steps",
    "step_cost": "goal_reward",
    "step_reward": "goal_reward",
    "step_penalty": "goal_reward",
    "time_penalty": "goal_reward",
    "living_reward": "goal_reward",
    "iql": "noncoop",
}
"""Names that other software has for our settings and options."""


NEAR = 0.55
"""How alike a misspelt name is at least to the right one, by difflib: "kop" and "coop" are."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `" (did you mean 'x'?)"` for the nearest known name, or an empty string.

    Case does not count, and `OTHER_WORDS` stand for our names.
    """
    names = {word.lower(): word for word in known}
    wanted = name.lower()
    bare = wanted.lstrip("-").replace("-", "_")
    if bare in OTHER_WORDS:
        wanted = wanted.removesuffix(wanted.lstrip("-")) + OTHER_WORDS[bare]
    near = difflib.get_close_matches(wanted, names, n=1, cutoff=NEAR)
    return f" (did you mean {names[near[0]]!r}?)" if near else ""


def check_format(number: object, where: str, error: type[SparseCoordError]) -> None:
    """Raise an `error` unless a file's format is the one that this version reads."""
    if type(number) is not int or number != FORMAT:
        newer = isinstance(number, int) and number > FORMAT
        remedy = "update sparse_coord_ros" if newer else "make it anew"
        what = f"is in format {in_short(number)}, this version reads format {FORMAT}"
        raise error(f"{where}: {what}; {remedy}")


def os_error_text(error: OSError) -> str:
    """Return the error's text, with the file if the system names it."""
    problem = error.strerror or str(error)
    return problem if error.filename is None else f"{error.filename}: {problem}"
