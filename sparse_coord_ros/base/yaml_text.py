# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""YAML 1.2 texts: read up to a limit, and written.

PyYAML reads YAML 1.1, without limits: `on` is a bool there, and ten lines of aliases fill the
memory. So scalars are read by the core schema of YAML 1.2, and values are counted.
"""

import re
from typing import Any

import yaml

from sparse_coord_ros.base.errors import (
    ScenarioError,
    SparseCoordError,
    in_short,
    message_of,
)
from sparse_coord_ros.base.limits import DEEPEST_NESTING, SCENARIO, Limit

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def parse_yaml(text: str, **how: Any) -> dict[str, Any]:
    """Read YAML text whose top level is a mapping; arguments and errors as in `yaml_value`."""
    data = yaml_value(text, **how)
    if not isinstance(data, dict):
        error = how.get("error", ScenarioError)
        said = "empty" if data is None else in_short(data)
        raise error(f"{how['where']}: must be 'key: value' lines, is {said}")
    return data


def yaml_value(
    text: str,
    *,
    where: str,
    limit: Limit = SCENARIO,
    error: type[SparseCoordError] = ScenarioError,
) -> Any:
    """Read YAML text: mappings, lists, texts, and the numbers and truth values of YAML 1.2.

    Repeated keys, anchors, aliases and tags are refused.

    Args:
        text: the text; an empty one gives None.
        where: its name in messages.
        limit: its largest size.
        error: the class to raise.

    Raises:
        SparseCoordError: an `error`: the text is not YAML, or exceeds the limit.
    """
    if len(text) > limit.bytes:
        size = f"has {len(text):,} letters, allowed for {limit.what}: {limit.bytes:,}"
        raise error(f"{where}: {size}; take out what is not needed")
    try:
        return _Composer(text, limit).whole()
    except (yaml.YAMLError, ValueError) as failure:  # ValueError: half a surrogate pair
        mark = getattr(failure, "problem_mark", None)
        line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = getattr(failure, "problem", None) or message_of(failure)
        raise error(
            f"{where}{line}: not readable as YAML: {problem}; mend that line"
        ) from None


class _Composer:
    """Values from the events of YAML text, counted while they are made."""

    def __init__(self, text: str, limit: Limit) -> None:
        self._events = yaml.parse(text, Loader=_LOADER)
        self._limit = limit
        self._left = limit.elements

    def whole(self) -> Any:
        """Return the text's only document; None for an empty text."""
        next(self._events)
        if isinstance(next(self._events), yaml.StreamEndEvent):
            return None
        value = self._value(next(self._events), DEEPEST_NESTING)
        next(self._events)
        after = next(self._events)
        if not isinstance(after, yaml.StreamEndEvent):
            raise _refusal("expected a single document, here is another one", after)
        return value

    def _value(self, event: Any, depth: int) -> Any:
        self._left -= 1
        if self._left < 0:
            most = f"{self._limit.elements:,} values, allowed for {self._limit.what}"
            raise _refusal(f"here are more than {most}", event)
        if event.anchor or getattr(event, "tag", None):
            raise _refusal(
                "anchors, aliases and tags are not read: write the value out", event
            )
        if isinstance(event, yaml.ScalarEvent):
            return _plain(event.value) if event.implicit[0] else event.value
        if not depth:
            raise _refusal(
                f"nested too deeply, allowed: {DEEPEST_NESTING} levels", event
            )
        if isinstance(event, yaml.SequenceStartEvent):
            items = []
            while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
                items.append(self._value(event, depth - 1))
            return items
        found: dict[Any, Any] = {}
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            key = self._value(event, depth - 1)
            if isinstance(key, list | dict):
                raise _refusal("a key must be a text or a number", event)
            if key in found:
                raise _refusal(f"key {in_short(key)} is there twice", event)
            found[key] = self._value(next(self._events), depth - 1)
        return found


def _refusal(problem: str, event: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)


_DIGITS = 400
"""Most digits of a whole number: a longer one is read as a float, which is infinite."""


_FLOAT = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"


_CORE = re.compile(
    r"(?P<null>~|null|Null|NULL|)|(?P<true>true|True|TRUE)|(?P<false>false|False|FALSE)"
    rf"|(?P<int>[-+]?[0-9]{{1,{_DIGITS}}}|0o[0-7]{{1,{_DIGITS}}}|0x[0-9a-fA-F]{{1,{_DIGITS}}})"
    rf"|(?P<float>{_FLOAT}|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))"
)
"""YAML 1.2.2, chapter 10.3.2: the value of a text without quotation marks."""


_WORDS = {"null": None, "true": True, "false": False}


def _plain(text: str) -> Any:
    """Return the value of a text without quotation marks."""
    match = _CORE.fullmatch(text)
    kind = match.lastgroup if match else None
    if kind == "int":
        return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
    if kind == "float":
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return text if kind is None else _WORDS[kind]


class Dumper(yaml.SafeDumper):
    """Quotes texts that either version of YAML would read as another type."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write equal parts out in full: anchors are not read."""
        return True


Dumper.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(rf"^(?:{_FLOAT}|0o[0-7]+)$"),
    list("-+.0123456789"),
)


def to_yaml(value: Any, **layout: Any) -> str:
    """Return plain data as YAML text that `parse_yaml` reads back; `layout`: as of `yaml.dump`."""
    return str(
        yaml.dump(value, Dumper=Dumper, sort_keys=False, allow_unicode=True, **layout)
    )
