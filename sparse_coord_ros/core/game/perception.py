# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Active-perception models: whether the percept of COORDINATE succeeds (paper, Section 3.2).

"Whether or not it actually succeeds is environment-dependent." A model gives a probability for the
cells of the robot that asks and of the robot that it asks; the percept succeeds when the draw of
(asker, step) lies below it. A model is a function of the map and its numbers, registered under a
name; a user's own model may also be named as `module:function`. Models of this package return a
`Sight`, which computes the probability of a pair on demand; a user's own model returns a matrix.
"""

import inspect
import itertools
import math
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.base.errors import SettingError, in_short
from sparse_coord_ros.core.game import sight
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.game.plugins import (
    Registry,
    failing_as,
    is_path,
    is_shipped,
    path_of,
)
from sparse_coord_ros.core.game.sight import Sight
from sparse_coord_ros.core.game.specs import Form, Number, Spec, SpecFamily

MOST_PERCEPTS = 2**29
"""Pairs of cells of a table of probabilities: those of 23,170 cells, 4 GiB."""

PerceptionModel = Callable[..., np.ndarray | Sight]
"""Takes the map and the numbers of its spec; returns the probabilities of percepts, shape
(cells, cells), first index the asker's cell, second the asked robot's. Its attribute `numbers`, a
tuple of `Number`, says their names and ranges; without one, its parameters after the map are
numbers without bounds."""

MARK = "is_perception_model"
"""Attribute of functions that may be called as a model by their module and name; no other is."""


def perception_model(function: PerceptionModel) -> PerceptionModel:
    """Decorator that marks a function as a perception model.

    Its name in scenarios and for `--set perception=` is then `module:function`.
    """
    setattr(function, MARK, True)
    return function


def _model(name: str, thing: object) -> PerceptionModel:
    if not callable(thing):
        raise TypeError(
            "is no function; it must take a map and return a matrix of probabilities"
        )
    if is_path(name) and getattr(thing, MARK, False) is not True:
        remedy = "if it is one, write @sc.perception_model above it"
        raise TypeError(
            f"is not marked as a perception model and was not called; {remedy}"
        )
    return thing


MODELS: Registry[PerceptionModel] = Registry(
    "perception model", "sparse_coord_ros.perception", _model
)
"""Every perception model, by the name that scenarios give."""


def register_perception(name: str, model: PerceptionModel) -> PerceptionModel:
    """Let a scenario's setting `perception` name this model, in this process.

    Files name it as `module:function`, so other processes and later calls find it. The name of an
    entry point of the group `sparse_coord_ros.perception` in an installed package also works.

    Args:
        name: the name.
        model: function of the map and numbers; see `PerceptionModel`.

    Raises:
        SettingError: it is no function, or the name is invalid or taken.
    """
    with suppress(AttributeError, TypeError):  # of what is no function
        perception_model(model)
    return MODELS.register(name, model)


def named_model(model: PerceptionModel) -> str:
    """Return the name, in this process, of a function that is passed as a model.

    It is the name under which the function is registered; else `module:function`, which other
    processes find. A nested function, or one typed at a prompt, gets a unique name that only this
    process knows (`check_found_elsewhere`).
    """
    for name, known in MODELS.registered.items():
        if known is model:
            return _portable(name, known)
    path = path_of(model)
    if path is not None and _lies_at(model, path):
        # of what takes no mark: it is refused then
        with suppress(AttributeError, TypeError):
            perception_model(model)
        MODELS.register(path, model)
        return path
    base = str(getattr(model, "__name__", ""))
    if not (base.isidentifier() and base.isascii()):
        base = "model"
    numbered = (f"{base}_{number}" for number in itertools.count(2))
    name = next(
        name for name in itertools.chain([base], numbered) if name not in MODELS.names
    )
    _HERE_ALONE[name] = MODELS.register(name, model)
    return name


_HERE_ALONE: dict[str, PerceptionModel] = {}
"""Models that no other process can find, by the names that they had first."""


def _lies_at(model: PerceptionModel, path: str) -> bool:
    """True if `module:function` leads to this very function."""
    member: object = sys.modules.get(model.__module__)
    for part in path.partition(":")[2].split("."):
        member = getattr(member, part, None)
    return member is model


def check_found_elsewhere(model: Spec) -> None:
    """Raise `SettingError` if other processes and later calls cannot find a model."""
    known = MODELS.registered.get(model.kind)
    if known is not None and known is _HERE_ALONE.get(model.kind):
        raise SettingError(
            f"perception model {model.kind!r}: other processes, and later calls, cannot find this "
            "function; define it in a module (a file)"
        )


def is_found_elsewhere(model: Spec) -> bool:
    """True if processes that this one starts find the model by its name."""
    if is_path(model.kind) or is_shipped(MODELS.registered.get(model.kind)):
        return True
    return model.kind in MODELS.installed


class PerceptionFamily(SpecFamily):
    """The setting `perception`: the models of this package and of the user."""

    @property
    def forms(self) -> tuple[Form, ...]:
        """The registered models, without those that are named with a module."""
        return tuple(
            _form(n, model) for n, model in MODELS.registered.items() if ":" not in n
        )

    @property
    def usage(self) -> str:
        """The allowed forms, for help and error texts."""
        return f"{super().usage}, or one of your own as module:function"

    def parse(self, value: object) -> Any:
        """Read a model with its numbers; errors as in `SpecFamily.parse`.

        A model whose code may not be imported stays a name; its first use raises an error.

        Args:
            value: the text of a spec; or the user's own function, or a tuple of the function and
                its numbers, such as `(fog, 4)`.
        """
        if isinstance(value, Spec):
            return value
        function, *given = value if isinstance(value, tuple) and value else (value,)
        if callable(function) and not isinstance(function, type):
            name = named_model(function)
            return self.numbered(_form(name, function), list(map(str, given)))
        parts = str(value).split(":")
        # Looking for installed packages is slow.
        known = parts[0] in MODELS.registered or parts[0] in MODELS.names
        words = 1 if known or not is_path(":".join(parts[:2])) else 2
        kind = ":".join(parts[:words])
        if not known and words == 1:
            raise self.unknown(str(value), MODELS.names)
        if MODELS.barred(kind):
            numbers = parts[words:]
            return self.numbered(
                Form(kind, "", (Number("number"),) * len(numbers)), numbers
            )
        model = MODELS.find(kind)
        spec = self.numbered(_form(kind, model), parts[words:])
        return Spec(_portable(kind, model), spec.numbers)


def _form(name: str, model: PerceptionModel) -> Form:
    numbers = getattr(model, "numbers", None)
    if numbers is None:
        numbers = map(Number, list(inspect.signature(model).parameters)[1:])
    return Form(name, (inspect.getdoc(model) or "").split("\n")[0], tuple(numbers))


def _portable(kind: str, model: PerceptionModel) -> str:
    """Return the name by which other processes find a model: `module:function` if possible."""
    path = path_of(model)
    if path is None or is_shipped(model) or is_path(kind) or kind in MODELS.installed:
        return kind
    MODELS.register(path, model)
    return path


PERCEPTION = PerceptionFamily("perception")
"""The perception models that a scenario can name."""


def sight_of(model: Spec, grid: GridMap) -> Sight:
    """Return the probabilities that percepts succeed on a map.

    Args:
        model: one of the kinds of `PERCEPTION`.
        grid: the map.

    Raises:
        SettingError: a user's model returns something other than probabilities, or the
            map is too large for it.
        PluginError: it fails.
    """
    function = MODELS.find(model.kind)
    name = f"perception model {model.kind!r}"
    cells = len(grid.cells)
    if not is_shipped(function):
        check_pairs(grid, f"with {name}, a table of all pairs", MOST_PERCEPTS)
    with failing_as(name, f"it looked at map {grid.name}"):
        made = function(grid, *model.numbers)
    if isinstance(made, Sight):
        return made
    with suppress(TypeError, ValueError):
        matrix = np.ascontiguousarray(made, dtype=np.float64)
        if matrix.shape == (cells, cells) and ((matrix >= 0) & (matrix <= 1)).all():
            return sight.tabled(grid, matrix)
    raise SettingError(
        f"{name}: returned {' '.join(in_short(made).split())}, allowed: probabilities from 0 to "
        f"1, shape ({cells}, {cells}): the asker's cell, then the asked robot's"
    )


def check_pairs(grid: GridMap, what: str, most: int) -> None:
    """Raise `SettingError` if a map has too many pairs of cells.

    Args:
        grid: the map.
        what: what needs all pairs, for the error text.
        most: the largest number of pairs allowed.
    """
    cells = len(grid.cells)
    if cells**2 > most:
        raise SettingError(
            f"map {grid.name} has {cells} cells, allowed {what}: at most {math.isqrt(most)}; "
            "take larger cells (import-map --cell) or a part of the map"
        )


def asked_peers(peers: str, number: int, robots: int, draw: float) -> tuple[int, ...]:
    """Return the peers that COORDINATE asks, in ascending order (paper, Section 3.2; footnote 3).

    Args:
        peers: the setting: "one" or "all".
        number: the robot, from 0.
        robots: number of robots.
        draw: its draw `PEER` of the time step, in [0, 1).
    """
    if peers == "all" or robots == 1:
        return (*range(number), *range(number + 1, robots))
    return (drawn_peer(number, robots, draw),)


@jitable
def drawn_peer(number: int, robots: int, draw: float) -> int:
    """Return the one peer that a robot asks; arguments as in `asked_peers`. Loops compile it."""
    peer = int(draw * (robots - 1))
    return peer + 1 if peer >= number else peer


def _probability(grid: GridMap, p: float) -> Sight:
    """Succeed with the same probability everywhere."""
    return sight.constant(grid, p)


def _range(grid: GridMap, reach: float) -> Sight:
    """Succeed within so many cells, measured straight between the cells' centres."""
    return sight.within(grid, reach)


def _line_of_sight(grid: GridMap) -> Sight:
    """Succeed where the straight line between the cells' centres crosses no wall."""
    return sight.line_of_sight(grid)


def _always(grid: GridMap) -> Sight:
    """Succeed."""
    return sight.constant(grid, 1.0)


def _never(grid: GridMap) -> Sight:
    """Fail."""
    return sight.constant(grid, 0.0)


setattr(_probability, "numbers", (Number("p", 0.0, 1.0),))  # noqa: B010 - mypy
setattr(_range, "numbers", (Number("cells", 0.0),))  # noqa: B010

for _name, _function in (
    ("always", _always),
    ("never", _never),
    ("probability", _probability),
    ("line_of_sight", _line_of_sight),
    ("range", _range),
):
    register_perception(_name, _function)
