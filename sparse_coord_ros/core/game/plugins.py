# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The user's own learners, models and games, found by name.

A name is looked up in this order: registered things (with the package's own), entry points of
installed packages, and `module:name`, a module that Python can import or that lies in the current
directory.

Files and messages are not trusted, and importing a module runs it. So `module:name` is imported
only if the user allows it: on the command line, as a node's parameter or in Python. A file or a
message cannot allow it.
"""

import importlib
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint, distributions
from pathlib import Path
from typing import Generic, TypeVar

from sparse_coord_ros.base.errors import (
    NotAllowedError,
    PluginError,
    SettingError,
    SparseCoordError,
    check_argument,
    did_you_mean,
    message_of,
    retold,
)

T = TypeVar("T")

_PATH = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*", re.ASCII)

ALLOW_VARIABLE = "SPARSE_COORD_ALLOW"
"""Environment variable with the allowed modules, between blanks: child processes have it too."""


def allowed() -> tuple[str, ...]:
    """Return the modules and packages that may be imported by `module:name`."""
    return tuple(os.environ.get(ALLOW_VARIABLE, "").split())


def allow_modules(modules: str | Iterable[str]) -> None:
    """Allow modules, and packages with all their modules, to be imported by `module:name`.

    It holds for this process and those that it starts.

    Args:
        modules: their names; in a text, between blanks.

    Raises:
        SettingError: a text is no module's name.
    """
    given = isinstance(modules, str | Iterable)
    check_argument("allow", modules, given, "names of modules, in a text or a list")
    for module in (
        modules.split() if isinstance(modules, str) else filter(None, modules)
    ):
        if not is_path(f"{module}:name"):
            named = "the name of a module, such as my_team"
            raise SettingError(f"allow: value is {module!r}, allowed: {named}")
        os.environ[ALLOW_VARIABLE] = " ".join(dict.fromkeys([*allowed(), module]))


def of_file(name: str) -> str:
    """Return a hint for an error text if a name is a Python file's, else ""."""
    module = Path(name).stem
    return (
        f" (did you mean '{module}:NAME', a name in that file?)"
        if name.endswith(".py")
        else ""
    )


def allow_named(given: object) -> None:
    """Allow the module that the user names: in a text `module:name`, numbers may follow."""
    words = given.split(":") if isinstance(given, str) else []
    if is_path(":".join(words[:2])):
        allow_modules(words[0])


@contextmanager
def leaving_out(what: str, say: Callable[[str], object]) -> Iterator[None]:
    """Continue without code that is not allowed to be imported, and report it in one line."""
    try:
        yield
    except NotAllowedError as error:
        say(f"left out {what}: {error}")


class Registry(Generic[T]):
    """Named things of one kind.

    Args:
        kind: what error messages call one of them, e.g. "learner".
        group: the entry points' group of other packages.
        check: converts a found object to this kind; raises TypeError with the reason if it cannot.
    """

    def __init__(
        self, kind: str, group: str, check: Callable[[str, object], T]
    ) -> None:
        self.kind = kind
        self.group = group
        self._check = check
        self.registered: dict[str, T] = {}

    def register(self, name: str, thing: object) -> T:
        """Register the user's own object under a name; it replaces the user's earlier one.

        Raises:
            SettingError: the object is not of this kind, or the name is invalid or taken.
        """
        if not (is_path(name) or (name.isidentifier() and name.isascii())):
            allowed = "letters, digits and '_', not a digit first"
            raise SettingError(f"{self.kind} name {name!r}: allowed: {allowed}")
        made = self.made(name, thing)
        if is_shipped(self.registered.get(name)) and not is_shipped(made):
            what = f"{self.kind} name {name!r}: is taken by this package's own"
            raise SettingError(f"{what}; choose another name")
        self.registered[name] = made
        if is_path(name):
            allow_named(name)  # other processes import it
        return made

    @property
    def names(self) -> tuple[str, ...]:
        """Every name that is registered or an entry point of an installed package."""
        return tuple(dict.fromkeys([*self.registered, *self.installed]))

    @property
    def installed(self) -> tuple[str, ...]:
        """The names that are entry points of installed packages."""
        return tuple(point.name for point in self._points())

    def _points(self) -> Iterator[EntryPoint]:
        """Yield the entry points of installed packages.

        Packages in the current directory do not count: the folder may be a stranger's.
        """
        places = [path for path in sys.path if path and not _is_here(path)]
        for distribution in distributions(path=places):
            yield from distribution.entry_points.select(group=self.group)

    @property
    def usage(self) -> str:
        """The allowed names, in words."""
        return f"{', '.join(self.names)}, or one of your own as module:name"

    def find(self, name: str) -> T:
        """Return the object that a name stands for.

        Raises:
            SettingError: the name is unknown, or its object is not of this kind.
            NotAllowedError: its module may not be imported.
            PluginError: its module exists, but fails.
        """
        if name in self.registered:
            return self.registered[name]
        for point in self._points():
            if point.name == name:
                return self.register(
                    name, self._imported(name, point.module, point.attr)
                )
        if not is_path(name):
            hint = of_file(name) or did_you_mean(name, self.names)
            what = f"unknown {self.kind} {name!r}{hint}"
            raise SettingError(f"{what}; allowed: {self.usage}")
        module, _, attribute = name.partition(":")
        if self.barred(name):
            raise NotAllowedError(
                f"{self.kind} {name!r}: module {module} was not imported, because the author "
                f"of that name chose the code; if you trust it, allow it: --allow {module}, a "
                "node's "
                f"parameter allow, or allow={module!r} in Python"
            )
        with _current_directory():
            thing = self._imported(name, module, attribute)
        return self.register(name, thing)

    def barred(self, name: str) -> bool:
        """True if a name stands for code that is not allowed to be imported."""
        module = name.partition(":")[0] + "."
        known = name in self.registered or any(
            module.startswith(f"{module_allowed}.") for module_allowed in allowed()
        )
        return is_path(name) and not known

    def _imported(self, name: str, module: str, attribute: str) -> object:
        thing: object
        try:
            thing = importlib.import_module(module)
        except (
            Exception,
            SystemExit,
        ) as error:  # of other people's code, whatever it raises
            lost = error.name if isinstance(error, ModuleNotFoundError) else None
            if lost is not None and f"{module}.".startswith(f"{lost}."):
                raise self._missing(name, error) from None
            what = f"{self.kind} {name!r}: its module failed: {_problem(error)}"
            raise PluginError(f"{what}; mend it, and call again") from error
        try:
            for part in attribute.split("."):
                thing = getattr(thing, part)
        except AttributeError as error:
            raise self._missing(name, error) from None
        return thing

    def _missing(self, name: str, error: BaseException) -> SettingError:
        problem = message_of(error) or type(error).__name__
        return SettingError(
            f"{self.kind} {name!r} was not found ({problem}); install it, or run this where "
            "Python finds its module (PYTHONPATH, or the current directory)"
        )

    def made(self, name: str, thing: object) -> T:
        """Return a found object, converted to this kind.

        Raises:
            SettingError: it is not of this kind.
        """
        with retold(SettingError, TypeError, f"{self.kind} {name!r}"):
            return self._check(name, thing)


def is_path(name: str) -> bool:
    """True if a name has the form `module:name`."""
    return _PATH.fullmatch(name) is not None


def path_of(thing: type | Callable[..., object]) -> str | None:
    """Return `module:name` of a class or function, by which other processes find it.

    None if they cannot: it was made within a function or typed at a prompt.
    """
    module = getattr(thing, "__module__", "")
    name = getattr(thing, "__qualname__", "")
    if module == "__main__":  # a script: others find it by its file's name
        module = Path(getattr(sys.modules["__main__"], "__file__", None) or "").stem
    path = f"{module}:{name}"
    return path if is_path(path) else None


def is_shipped(thing: object) -> bool:
    """True if a class, function or object comes with this package."""
    module = getattr(thing, "__module__", None) or ""
    return module.partition(".")[0] == __name__.partition(".")[0]


@contextmanager
def failing_as(what: str, doing: str) -> Iterator[None]:
    """Report a failure of the user's own code in one line, with its place.

    Args:
        what: the code's kind and name.
        doing: the purpose of the call, for the error text.

    Raises:
        PluginError: it raised an exception, which is the cause.
    """
    try:
        yield
    except SparseCoordError:
        raise
    except (
        Exception,
        SystemExit,
    ) as error:  # of other people's code, whatever it raises
        remedy = "mend it, and call again"
        raise PluginError(
            f"{what} failed while {doing}: {_problem(error)}; {remedy}"
        ) from error


def _problem(error: BaseException) -> str:
    """Return the exception as text, with its line if other people's code raised it."""
    theirs = [
        f for f in traceback.extract_tb(error.__traceback__) if not _is_ours(f.filename)
    ]
    where = (
        f" ({Path(theirs[-1].filename).name}, line {theirs[-1].lineno})"
        if theirs
        else ""
    )
    text = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    return f"{text}{where}"


def _is_ours(name: str) -> bool:
    """True if a file belongs to this package or to Python's import system."""
    if name.startswith("<frozen ") or name == importlib.__file__:
        return True
    return Path(name).is_relative_to(Path(__file__).parents[2])


def _is_here(path: str) -> bool:
    return os.path.exists(path) and os.path.samefile(path, ".")


@contextmanager
def _current_directory() -> Iterator[None]:
    """Let Python find modules in the current directory too, after all other places."""
    here = os.getcwd()
    added = here not in sys.path and "" not in sys.path
    if added:
        sys.path.append(here)
    try:
        yield
    finally:
        if added and here in sys.path:
            sys.path.remove(here)
