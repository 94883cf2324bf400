# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""JSON files of results: each says its format and carries a digest of all else that it says.

The digest detects damage and careless editing. It is no signature: a person who computes it again
can write any number. The content of a file is therefore also checked against its required form.
"""

import hashlib
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.errors import ResultsError, check_format, in_short
from sparse_coord_ros.base.limits import RESULTS, read_file
from sparse_coord_ros.base.version import FORMAT
from sparse_coord_ros.core.game.specs import in_range

LARGEST_FLOAT = sys.float_info.max
"""A whole number may be larger; as a float it would be infinite."""


class DamagedError(Exception):
    """The content of a file cannot be used; the text says why, without the file's name."""


def digest_of(data: Mapping[str, Any]) -> str:
    """Return the SHA-256 of plain data as canonical JSON: keys sorted, no blanks, ASCII.

    Python writes the shortest text that reads back as the same float, so that data that was
    written and read has the same digest.

    Raises:
        ValueError: a number is NaN or infinite.
    """
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def to_text(data: Mapping[str, Any]) -> str:
    """Return a file's text: its format, the digest, and the data.

    Raises:
        ValueError: a number is NaN or infinite.
    """
    content = {"format": FORMAT, **data}
    return json.dumps({"digest": digest_of(content), **content}) + "\n"


def read_checked(path: Path) -> dict[str, Any]:
    """Return the content of a file of `to_text`, without its format and its digest.

    Raises:
        DamagedError: it is no such file, or its digest does not fit its content.
        ResultsError: it cannot be opened, is too large, or has another format.
    """
    text = read_file(path, RESULTS, ResultsError, "give a directory of results")
    try:
        content = json.loads(text, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise DamagedError(f"it is not readable as JSON ({error})") from None
    if not isinstance(content, dict) or "format" not in content:
        raise DamagedError("it does not say its format")
    check_format(content["format"], str(path), ResultsError)
    said = content.pop("digest", None)
    try:
        fits = said == digest_of(content)
    except ValueError:  # a number is NaN, or so large that it was read as infinite
        fits = False
    if not fits:
        raise DamagedError(
            "its content does not fit its digest: it was damaged or edited"
        )
    del content["format"]
    return content


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key is there twice")
    return found


@dataclass(frozen=True)
class Numbers:
    """Numbers that a file must hold.

    Attributes:
        shape: lengths of the nested lists that hold them; empty: it is one number.
        low: the smallest that is allowed.
        high: the largest that is allowed.
        whole: whether they must be whole numbers.
    """

    shape: tuple[int, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    whole: bool = False


@dataclass(frozen=True)
class OrNull:
    """A value of a form, or null.

    Attributes:
        form: the form.
    """

    form: "Form"


Form = type | Numbers | OrNull | Mapping[str, Any]
"""What a value must be: of a type, numbers, or an object with just these keys and their forms."""


def check_form(value: object, form: Form, place: str = "") -> None:
    """Raise `DamagedError` unless a value that was read has a form; `place` names the value."""
    if isinstance(form, Numbers):
        _check_numbers(value, form.shape, form, place)
    elif isinstance(form, OrNull):
        if value is not None:
            check_form(value, form.form, place)
    elif isinstance(form, type):
        if type(value) is not form:
            raise _wrong(place, value, form.__name__)
    elif not isinstance(value, dict):
        raise _wrong(place, value, "an object")
    else:
        _check_keys(value, form, place)
        for key, own in form.items():
            check_form(value[key], own, f"{place}.{key}".lstrip("."))


def _check_keys(found: Mapping[str, Any], due: Mapping[str, Any], place: str) -> None:
    where = f" in {place}" if place else ""
    for key in due:
        if key not in found:
            raise DamagedError(f"field {key!r} is missing{where}")
    for key in found:
        if key not in due:
            raise DamagedError(f"field {in_short(key)} is unknown{where}")


def _check_numbers(
    value: object, shape: tuple[int, ...], form: Numbers, place: str
) -> None:
    if not shape:
        _check_number(value, form, place)
        return
    length, *inner = shape
    if not isinstance(value, list):
        raise _wrong(place, value, f"a list of {length}")
    if len(value) != length:
        raise DamagedError(f"field {place} has {len(value)} entries, allowed: {length}")
    for number, entry in enumerate(value):
        _check_numbers(entry, tuple(inner), form, f"{place}[{number}]")


def _check_number(value: object, form: Numbers, place: str) -> None:
    words = "a whole number" if form.whole else "a number"
    kinds = (int,) if form.whole else (int, float)
    if type(value) in kinds:
        assert isinstance(value, int | float)
        if abs(value) <= LARGEST_FLOAT and form.low <= value <= form.high:
            return
    raise _wrong(place, value, in_range(words, form.low, form.high))


def _wrong(place: str, value: object, allowed: str) -> DamagedError:
    return DamagedError(f"field {place} is {in_short(value)}, allowed: {allowed}")
