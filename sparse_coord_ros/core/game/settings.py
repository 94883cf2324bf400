# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Typed settings with ranges, for YAML files, `--set key=value` and ROS parameters."""

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from sparse_coord_ros.base.errors import SettingError, did_you_mean, in_short
from sparse_coord_ros.core.game.specs import SpecFamily, in_range

LARGEST_WHOLE = 2**53
"""Whole numbers written like 1e5 are taken up to here: further on floats skip some."""

NAMED = 10**9
"""A greater limit is named only to who passes it."""

TRUTHS = dict.fromkeys(("true", "yes", "on", "1"), True)
TRUTHS |= dict.fromkeys(("false", "no", "off", "0"), False)


@dataclass(frozen=True)
class Setting:
    """One named, typed and bounded value.

    Attributes:
        name: its name in files, on the command line and as a ROS parameter.
        kind: bool, int, float, str, list (of str), or a family of values with a syntax of its own.
        default: the value if no other is given.
        help: one line: meaning and unit.
        low: smallest number allowed.
        high: largest number allowed.
        least: smallest number allowed beside 0, which turns the feature off; None: no bound.
        choices: the strings allowed; empty: any.
    """

    name: str
    kind: type | SpecFamily
    default: Any
    help: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    least: float | None = None

    @property
    def allowed(self) -> str:
        """The allowed values, in words; without a limit that nobody meets."""
        return self._allowed(self.high if self.high <= NAMED else math.inf)

    def _allowed(self, high: float) -> str:
        """Return the allowed values in words, with this largest number."""
        if not isinstance(self.kind, type):
            return self.kind.usage
        if self.choices:
            return " or ".join(self.choices)
        if self.kind is bool:
            return "true or false"
        if self.kind not in (int, float):
            return "a text" if self.kind is str else "a list of texts, as in [a, b]"
        words = "a whole number" if self.kind is int else "a number"
        words = words if self.least is None else f"0, or {words}"
        return in_range(words, self.low if self.least is None else self.least, high)

    def parse(self, value: object, called: str = "") -> Any:
        """Return the value in the setting's type; texts are read as on the command line.

        Args:
            value: the value.
            called: the name in an error, such as that of an option; empty: that of the setting.

        Raises:
            SettingError: the value has another type or lies out of range.
        """
        if not isinstance(self.kind, type):
            return self.kind.parse(value)
        too_large = False
        try:
            parsed = CONVERTERS[self.kind](value)
            too_large = self.kind in (int, float) and parsed > self.high
            fits = not self.choices or parsed in self.choices
            if self.kind in (int, float):
                fits = self.least is None or parsed == 0 or parsed >= self.least
                fits = fits and self.low <= parsed <= self.high
        except (TypeError, ValueError, OverflowError, KeyError):
            fits = False
        if not fits:
            what = called or f"setting {self.name}"
            allowed = self._allowed(self.high) if too_large else self.allowed
            raise SettingError(
                f"{what}: value is {in_short(value)}, allowed: {allowed}"
            )
        return parsed


def _number(value: Any) -> float:
    if isinstance(value, bool) or not math.isfinite(float(value)):
        raise ValueError
    return float(value)


def _whole(value: Any) -> int:
    number = _number(value)
    with suppress(ValueError):
        if isinstance(value, str | int):  # exact: a float cannot hold every 64-bit seed
            return int(value)
    if int(number) != number or abs(number) > LARGEST_WHOLE:
        raise ValueError
    return int(number)


def _text(value: Any) -> str:
    if not isinstance(value, str | int | float) or isinstance(value, bool):
        raise TypeError
    return str(value)


def _texts(value: Any) -> list[str]:
    if not isinstance(value, list | tuple) or not all(
        isinstance(v, str) for v in value
    ):
        raise TypeError
    return list(value)


CONVERTERS: Mapping[type, Callable[[Any], Any]] = {
    bool: lambda value: TRUTHS[str(value).lower()],
    int: _whole,
    float: _number,
    str: _text,
    list: _texts,
}
"""What reads the values of each type; it raises where a value is none."""


class SettingTable(dict[str, Setting]):
    """Settings by name, in their order; parses whole sets of values."""

    def __init__(self, settings: Iterable[Setting]) -> None:
        super().__init__({setting.name: setting for setting in settings})

    def defaults(self) -> dict[str, Any]:
        """Return every setting's default, parsed."""
        return {s.name: s.parse(s.default) for s in self.values()}

    def parse(self, values: Mapping[str, object]) -> dict[str, Any]:
        """Return the given values, each in its setting's type.

        Raises:
            SettingError: an unknown name or a bad value.
        """
        for name in values:
            if name not in self:
                what = f"unknown setting {name!r}{did_you_mean(str(name), self)}"
                raise SettingError(f"{what}; allowed: {', '.join(self)}")
        return {name: self[name].parse(value) for name, value in values.items()}


def tables_from_yaml(path: Path) -> dict[str, SettingTable]:
    """Return the tables of settings in a YAML file; each entry has the fields of a `Setting`.

    The default's type is the kind. The key `shared` holds YAML anchors.
    """
    tables: dict[str, dict[str, Any]] = yaml.safe_load(path.read_text(encoding="utf-8"))
    tables.pop("shared")
    for table in tables.values():
        for name, entry in table.items():
            choices = tuple(entry.get("choices", ()))
            table[name] = Setting(
                name, type(entry["default"]), **{**entry, "choices": choices}
            )
    return {name: SettingTable(table.values()) for name, table in tables.items()}


def setting(
    default: Any, help: str, kind: SpecFamily | None = None, **limits: Any
) -> Any:
    """Return a field of a dataclass that is a setting, for `settings_of`.

    Args:
        default: the value where none is given.
        help: one line: meaning and unit.
        kind: what reads its values; None: they are of the field's type.
        limits: `low`, `high` and `choices` of `Setting`.
    """
    metadata = {"default": default, "help": help, "kind": kind, **limits}
    return field(
        default=default if kind is None else kind.parse(default), metadata=metadata
    )


def settings_of(dataclass_type: type) -> SettingTable:
    """Return the settings among the fields of a dataclass, in their order."""
    rows: list[tuple[str, Any, dict[str, Any]]] = [
        (f.name, f.type, dict(f.metadata)) for f in fields(dataclass_type) if f.metadata
    ]
    return SettingTable(
        Setting(n, metadata.pop("kind") or kind, **metadata)
        for n, kind, metadata in rows
    )


def as_text(value: object) -> str:
    """Return a setting's value as a text that `parse` reads back: 20.0 as 20, and -0.0 as 0."""
    return (
        repr(value + 0.0).removesuffix(".0") if isinstance(value, float) else str(value)
    )


def parse_assignments(texts: Iterable[str]) -> dict[str, str]:
    """Split `key=value` texts, the last of equal keys winning.

    Raises:
        SettingError: a text without '='.
    """
    values = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise SettingError(
                f"setting {text!r}: write it as key=value, e.g. penalty=-20"
            )
        values[name.strip()] = value.strip()
    return values
