# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""JSON files of results: each says its format, and has a form that is checked where it is read."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.errors import ResultsError, check_format, in_short
from sparse_coord_ros.base.files import read_text
from sparse_coord_ros.base.version import FORMAT


@dataclass(frozen=True)
class OrNull:
    """A value of a form, or null.

    Attributes:
        form: the form.
    """

    form: "Form"


Form = type | tuple[int, ...] | OrNull | Mapping[str, Any]
"""What a value must be: of a type; numbers in nested lists of these lengths, () for one number; or
an object with just these keys and their forms."""


def to_text(data: Mapping[str, Any]) -> str:
    """Return a file's text: its format, and the data.

    Raises:
        ValueError: a number is NaN or infinite.
    """
    return json.dumps({"format": FORMAT, **data}, allow_nan=False) + "\n"


def read_checked(path: Path, form: Mapping[str, Form], remedy: str) -> dict[str, Any]:
    """Return the content of a file of `to_text`, without its format.

    Args:
        path: the file.
        form: the form of its content.
        remedy: the remedy where it is no such file.

    Raises:
        ResultsError: it cannot be read, is in another format, or has not the form.
    """
    text = read_text(path, ResultsError, remedy)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        what = f"is not readable as JSON ({error})"
        raise ResultsError(f"{path}: {what}; {remedy}") from None
    if not isinstance(content, dict):
        raise ResultsError(f"{path}: is {in_short(content)}, not an object; {remedy}")
    check_format(content.pop("format", None), str(path), ResultsError)
    try:
        check_form(content, form)
    except ValueError as error:
        raise ResultsError(f"{path}: {error}; {remedy}") from None
    return content


def check_form(value: object, form: Form, name: str = "") -> None:
    """Raise `ValueError` unless a value that was read has a form; `name` names the value."""
    if isinstance(form, OrNull):
        if value is not None:
            check_form(value, form.form, name)
    elif isinstance(form, tuple):
        _check_numbers(value, form, name)
    elif isinstance(form, type):
        if type(value) is not form:
            raise _wrong(name, value, form.__name__)
    elif not isinstance(value, dict):
        raise _wrong(name, value, "an object")
    else:
        _check_keys(value, form, name)
        for key, field_form in form.items():
            check_form(value[key], field_form, f"{name}.{key}".lstrip("."))


def _check_keys(value: Mapping[str, Any], form: Mapping[str, Any], name: str) -> None:
    where = f" in {name}" if name else ""
    for key in form:
        if key not in value:
            raise ValueError(f"field {key!r} is missing{where}")
    for key in value:
        if key not in form:
            raise ValueError(f"field {in_short(key)} is unknown{where}")


def _check_numbers(value: object, shape: tuple[int, ...], name: str) -> None:
    if not shape:
        if type(value) not in (int, float):
            raise _wrong(name, value, "a number")
        return
    length, *inner = shape
    if not isinstance(value, list) or len(value) != length:
        raise _wrong(name, value, f"a list of {length}")
    for number, entry in enumerate(value):
        _check_numbers(entry, tuple(inner), f"{name}[{number}]")


def _wrong(name: str, value: object, allowed: str) -> ValueError:
    return ValueError(f"field {name} is {in_short(value)}, allowed: {allowed}")
