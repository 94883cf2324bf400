# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Things of the user's own, found by name: from Python, by entry point, or as `module:name`.

What a name stands for is looked up in this order: what was registered (the package's own
included), entry points of installed packages, and `module:name`, a module that Python can import
or that lies in the current directory.
"""

import importlib
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import entry_points
from typing import Generic, TypeVar

from sparse_coord_ros.errors import SettingError, did_you_mean

T = TypeVar("T")

_PATH = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*", re.ASCII)


class Registry(Generic[T]):
    """Named things of one kind.

    Args:
        kind: what error messages call one of them, e.g. "learner".
        group: the entry points' group of other packages.
        check: makes one of whatever a name stands for; raises TypeError with what is wrong.
    """

    def __init__(self, kind: str, group: str, check: Callable[[str, object], T]) -> None:
        self.kind, self.group = kind, group
        self._check = check
        self._known: dict[str, T] = {}

    def register(self, name: str, thing: object) -> T:
        """Let a name stand for something of one's own; an equal name is replaced.

        Raises:
            SettingError: it is nothing of this kind, or the name is none.
        """
        if ":" not in name and not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            raise SettingError(
                f"{self.kind} name {name!r}: allowed: letters, digits and '_', not a digit first"
            )
        self._known[name] = self.made(name, thing)
        return self._known[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Every name that is registered or an entry point of an installed package."""
        found = (point.name for point in entry_points(group=self.group))
        return tuple(dict.fromkeys([*self._known, *found]))

    @property
    def registered(self) -> Mapping[str, T]:
        """What is registered in this process, by name."""
        return dict(self._known)

    @property
    def usage(self) -> str:
        """What names are allowed, in words."""
        return f"{', '.join(self.names)}, or one of your own as module:name"

    def find(self, name: str) -> T:
        """Return what a name stands for.

        Raises:
            SettingError: nothing has this name, or it is nothing of this kind.
        """
        if name in self._known:
            return self._known[name]
        for point in entry_points(group=self.group):
            if point.name == name:
                try:
                    thing = point.load()
                except Exception as error:  # of other people's code, whatever it raises
                    raise self._missing(name, error) from None
                return self.register(name, thing)
        if not is_path(name):
            raise SettingError(
                f"unknown {self.kind} {name!r}{did_you_mean(name, self.names)}; allowed: "
                f"{self.usage}"
            )
        return self.register(name, self._imported(name))

    def _imported(self, path: str) -> object:
        module, _, attribute = path.partition(":")
        try:
            with _current_directory():
                found = importlib.import_module(module)
            for part in attribute.split("."):
                found = getattr(found, part)
        except Exception as error:  # of other people's code, whatever it raises
            raise self._missing(path, error) from None
        return found

    def _missing(self, name: str, error: Exception) -> SettingError:
        problem = " ".join(str(error).split()) or type(error).__name__
        return SettingError(
            f"{self.kind} {name!r} is not there ({problem}); install it, or call this where "
            "Python finds its module (PYTHONPATH, or the current directory)"
        )

    def made(self, name: str, thing: object) -> T:
        """Return what a thing makes as one of this kind; `name` is for the error.

        Raises:
            SettingError: it is nothing of this kind.
        """
        try:
            return self._check(name, thing)
        except TypeError as error:
            raise SettingError(f"{self.kind} {name!r}: {error}") from None


def is_path(name: str) -> bool:
    """Whether a name has the form `module:name`."""
    return _PATH.fullmatch(name) is not None


def path_of(thing: object) -> str:
    """Return `module:name` of a class or function, by which other processes find it."""
    return f"{thing.__module__}:{getattr(thing, '__qualname__', '?')}"


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
