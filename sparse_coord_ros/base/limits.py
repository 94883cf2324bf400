# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much is read of what comes from elsewhere, and the functions that read it.

Files, bags and messages are data: whatever is in them, reading ends soon, in what they say or in
one line. Each kind of input has its `Limit`; bytes and elements bound the time.
"""

import errno
import os
import re
import stat
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import yaml

from sparse_coord_ros.base.errors import ScenarioError, SparseCoordError, in_short


class Limit(NamedTuple):
    """The most that is read of a kind of input.

    Attributes:
        what: the kind, as messages name it.
        bytes: of a file, text or message.
        elements: values of a YAML text, keys and containers included; squares of a grid; bytes
            of an archive's arrays.
    """

    what: str
    bytes: int
    elements: int = 0


MB = 2**20
SCENARIO = Limit("a scenario or a run", 8 * MB, 20_000)
MAP = Limit("a map", 4 * MB, 1_000_000)
MAP_HEADER = Limit("the description of a map", 2**16, 1_000)
IMAGE = Limit("an image", 128 * MB, 25_000_000)
ARRAYS = Limit("tables, histories and checkpoints", 1024 * MB, 1024 * MB)
RESULTS = Limit("results", 64 * MB)
RECORD = Limit("a record of a bag", 256 * MB)
CHUNK = Limit("the content of a chunk", 64 * MB)
CHUNKS = Limit("the content of all chunks, and of each byte of the file", 256 * MB, 100)
RECORDS = 50_000
"""Attachments and metadata of a bag; its messages, beside one for each byte of the file."""

MESSAGE = Limit("a message", 2**16)
"""Of a topic that says nothing else: a node reads it within a few milliseconds."""

PICTURE = Limit("a map or markers", 4 * MB)
TABLES = Limit("the tables of one robot", 64 * MB, 64 * MB)
METADATA = Limit("a bag's metadata", 4 * MB, 100_000)

ASKED = 1_000
"""Parameters that one request to a node's parameter services names."""

DEEPEST = 30
"""Containers within containers of a YAML text."""


def too_large(size: int, limit: Limit) -> str:
    """Return what to say of something with more bytes than are read."""
    return f"it has {size:,} bytes, allowed for {limit.what}: {limit.bytes:,}"


def open_regular(path: Path, limit: Limit | None = None) -> BinaryIO:
    """Open a regular file to read; nobody waits for a pipe or a device.

    Args:
        path: the file.
        limit: how large it may be; None: as large as it is.

    Raises:
        OSError: it cannot be read, is something else, or is too large; with its name.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a path has no NUL characters", str(path))
    file = open(
        path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)
    )
    found = os.fstat(file.fileno())
    if not stat.S_ISREG(found.st_mode):
        refusal = errno.EINVAL, "it is not a file"
    elif limit is not None and found.st_size > limit.bytes:
        refusal = errno.EFBIG, too_large(found.st_size, limit)
    else:
        return file
    file.close()
    raise OSError(*refusal, str(path))


def read_file(
    path: Path, limit: Limit, error: type[SparseCoordError], remedy: str
) -> bytes:
    """Return what a regular file holds.

    Args:
        path: the file.
        limit: how large it may be.
        error: what to raise.
        remedy: what to do where it cannot be read.

    Raises:
        SparseCoordError: an `error`: as `open_regular`.
    """
    try:
        with open_regular(path, limit) as file:
            return file.read()
    except OSError as failure:
        raise error(f"{path}: cannot be read ({failure.strerror}); {remedy}") from None


def read_text(
    path: Path, limit: Limit, error: type[SparseCoordError], remedy: str
) -> str:
    """Return what a regular file holds, as text; as `read_file`, and it must be UTF-8."""
    try:
        return read_file(path, limit, error, remedy).decode().replace("\r\n", "\n")
    except UnicodeDecodeError as failure:
        raise error(f"{path}: is no UTF-8 text ({failure.reason}); {remedy}") from None


def parse_yaml(text: str, **how: Any) -> dict[str, Any]:
    """Read YAML text whose top level is a mapping; arguments and errors as of `yaml_value`."""
    data = yaml_value(text, **how)
    if not isinstance(data, dict):
        error = how.get("error", ScenarioError)
        kind = type(data).__name__
        raise error(f"{how['where']}: must be 'key: value' lines, is {kind}")
    return data


def yaml_value(
    text: str,
    *,
    where: str,
    limit: Limit = SCENARIO,
    error: type[SparseCoordError] = ScenarioError,
) -> Any:
    """Read YAML text: mappings, lists, texts, and the numbers and truth values of YAML 1.2.

    Each key is there once. Anchors, aliases and tags are refused.

    Args:
        text: the text; None comes of an empty one.
        where: what messages call it.
        limit: how much of it is read.
        error: what to raise.

    Raises:
        SparseCoordError: an `error`: it is not YAML, or more than is read.
    """
    if len(text) > limit.bytes:
        size = f"has {len(text):,} letters, allowed for {limit.what}: {limit.bytes:,}"
        raise error(f"{where}: {size}; take out what is not needed")
    try:
        return _Composer(text, limit).whole()
    except (yaml.YAMLError, ValueError) as failure:  # ValueError: half a surrogate pair
        mark = getattr(failure, "problem_mark", None)
        line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = getattr(failure, "problem", None) or " ".join(str(failure).split())
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
        """Return the text's one document; None of an empty text."""
        next(self._events)
        if isinstance(next(self._events), yaml.StreamEndEvent):
            return None
        value = self._value(next(self._events), DEEPEST)
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
            raise _refusal(f"nested too deeply, allowed: {DEEPEST} levels", event)
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


_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_DIGITS = 400
"""Of a whole number: a longer one is read as a float, which is infinite."""

_FLOAT = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
_CORE = re.compile(
    r"(?P<null>~|null|Null|NULL|)|(?P<true>true|True|TRUE)|(?P<false>false|False|FALSE)"
    rf"|(?P<int>[-+]?[0-9]{{1,{_DIGITS}}}|0o[0-7]{{1,{_DIGITS}}}|0x[0-9a-fA-F]{{1,{_DIGITS}}})"
    rf"|(?P<float>{_FLOAT}|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))"
)
"""YAML 1.2.2, chapter 10.3.2: what a text without quotation marks is."""

_WORDS = {"null": None, "true": True, "false": False}


def _plain(text: str) -> Any:
    """Return what a text without quotation marks says."""
    match = _CORE.fullmatch(text)
    kind = match.lastgroup if match else None
    if kind == "int":
        return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
    if kind == "float":
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return text if kind is None else _WORDS[kind]


class Dumper(yaml.SafeDumper):
    """Puts texts into quotation marks that either version of YAML takes for something else."""

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
