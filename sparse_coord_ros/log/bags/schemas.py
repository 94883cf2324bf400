# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Message definitions and type hashes, read from the interface files that ROS 2 installs.

A bag carries the definition of every type in it. The text is the one rosbag2 writes: the type's
own `.msg` text, then every type it depends on, once, depth first and in alphabetical order.
"""

import functools
import importlib.util
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from sparse_coord_ros.base.errors import BagError

_SEPARATOR = "=" * 80
_FIELD = re.compile(
    r"^[ \t]*([A-Za-z][A-Za-z0-9_/]*)(?=(?:\[[^\]]*\])?[ \t]+\w)", re.MULTILINE
)
_PRIMITIVES = frozenset(
    "bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 "
    "string wstring".split()
)


@functools.cache
def schema_text(type_name: str) -> str:
    """Return the complete `ros2msg` schema of a message type, `package/msg/Type`.

    Returns:
        The type's definition, then each dependency after a line of 80 equals signs and a line with
        its name.

    Raises:
        BagError: a definition is not installed.
    """
    seen: set[str] = set()

    def with_dependencies(name: str) -> str:
        text = whole = _definition(name)
        package = name.partition("/")[0]
        types = {_full(field, package) for field in _FIELD.findall(text)}
        for kind in sorted(types - _PRIMITIVES):
            if kind not in seen:
                seen.add(kind)
                path = kind.replace("/", "/msg/") if kind.count("/") == 1 else kind
                whole += f"\n{_SEPARATOR}\nMSG: {kind}\n{with_dependencies(path)}"
        return whole

    return with_dependencies(type_name)


@functools.cache
def type_hash(type_name: str) -> str:
    """Return a type's `RIHS01_...` hash (REP-2011), or an empty text if none is installed.

    Args:
        type_name: `package/msg/Type`.
    """
    package, kind, name = type_name.split("/")
    path = _interface_file(package, kind, f"{name}.json")
    if path is None:
        return ""
    hashes = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
    return next((h["hash_string"] for h in hashes if h["type_name"] == type_name), "")


def _definition(name: str) -> str:
    """Return one type's own text."""
    package, kind, stem = name.split("/")
    path = _interface_file(package, kind, f"{stem}.{kind}")
    if path is None:
        raise BagError(
            f"no definition of {name}: share/{name}.{kind} is "
            f"neither in AMENT_PREFIX_PATH ({os.environ.get('AMENT_PREFIX_PATH', '')!r}) nor "
            f"where Python finds {package}; install the package {package}, or add its prefix"
        )
    # Bytes, not text mode: the schema is the unchanged file, line ends included.
    return path.read_bytes().decode("utf-8")


def _full(name: str, package: str) -> str:
    """Return a field's type with its package."""
    return name if name in _PRIMITIVES or "/" in name else f"{package}/{name}"


def _interface_file(package: str, kind: str, file_name: str) -> Path | None:
    paths = (
        prefix / "share" / package / kind / file_name for prefix in _prefixes(package)
    )
    return next((path for path in paths if path.is_file()), None)


def _prefixes(package: str) -> Iterator[Path]:
    """Yield the prefixes in which a package may be installed: ament's, its module's, Python's."""
    ament = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    yield from map(Path, filter(None, ament))
    spec = importlib.util.find_spec(package)
    for location in (spec.submodule_search_locations or []) if spec else []:
        # <prefix>/lib/python3.12/site-packages/<package>
        yield from list(Path(location).parents)[:4]
    yield Path(sys.prefix)
