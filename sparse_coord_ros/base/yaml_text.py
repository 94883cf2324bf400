# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""YAML texts, read and written by PyYAML; a key that is there twice is an error."""

from typing import Any

import yaml

from sparse_coord_ros.base.errors import (
    ScenarioError,
    SparseCoordError,
    in_short,
    message_of,
)

_SAFE_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_SAFE_LOADER):
    """PyYAML's safe loader; of two equal keys it does not take the last one, but refuses both."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        keys = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in keys:
                problem = f"key {in_short(key.value)} is there twice"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            keys.add(key.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


def parse_yaml(
    text: str, *, where: str, error: type[SparseCoordError] = ScenarioError
) -> dict[str, Any]:
    """Read YAML text whose top level is a mapping; arguments and errors as in `yaml_value`."""
    data = yaml_value(text, where=where, error=error)
    if not isinstance(data, dict):
        given = "empty" if data is None else in_short(data)
        raise error(f"{where}: must be 'key: value' lines, is {given}")
    return data


def yaml_value(
    text: str, *, where: str, error: type[SparseCoordError] = ScenarioError
) -> Any:
    """Read YAML text.

    Args:
        text: the text; an empty one gives None.
        where: its name in messages.
        error: the class to raise.

    Raises:
        SparseCoordError: an `error`: the text is not YAML, or has two equal keys.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as failure:
        mark = getattr(failure, "problem_mark", None)
        line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        words = getattr(failure, "context", None), getattr(failure, "problem", None)
        problem = ", ".join(filter(None, words)) or message_of(failure)
        raise error(
            f"{where}{line}: not readable as YAML: {problem}; mend that line"
        ) from None


class Dumper(yaml.SafeDumper):
    """Writes equal parts out in full."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return True: people read these files."""
        return True


def to_yaml(value: Any, **layout: Any) -> str:
    """Return plain data as YAML for `parse_yaml`; `layout`: options of `yaml.dump`."""
    return str(
        yaml.dump(value, Dumper=Dumper, sort_keys=False, allow_unicode=True, **layout)
    )
