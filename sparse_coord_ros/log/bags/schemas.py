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
_PART = re.compile(r"_(Request|Response)$")
"""The end of the name of a part of a service."""
_PRIMITIVES = frozenset(
    "bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 "
    "string wstring".split()
)


@functools.cache
def schema_text(type_name: str) -> str:
    """Return the complete `ros2msg` schema of a message type.

    A service's event type has no file of its own. rosbag2 stores the `.srv` text in its place,
    which is not a message definition. Here the event message is written out, with its request and
    response as sections of their own, under the names of `stored_name`.

    Args:
        type_name: `package/msg/Type`, or `package/srv/Service_Event` (`_Request`, `_Response`).

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
        for one in sorted(
            {_full(t, package) for t in _FIELD.findall(text)} - _PRIMITIVES
        ):
            if one not in seen:
                seen.add(one)
                kind = "srv" if _PART.search(one) else "msg"
                path = one.replace("/", f"/{kind}/") if one.count("/") == 1 else one
                whole += f"\n{_SEPARATOR}\nMSG: {one}\n{with_dependencies(path)}"
        return whole

    return with_dependencies(type_name)


def stored_name(type_name: str) -> str:
    """Return a type's name in a bag, so that readers find its definition.

    rosbags and mcap_ros2 decode no types of `srv`. So a service's event is stored as a message;
    its fields and bytes are the same.

    Args:
        type_name: `package/msg/Type`, or `package/srv/Service_Event`.
    """
    return re.sub(r"/srv/(\w+)_Event$", r"/msg/\1Event", type_name)


def ros_name(stored: str, topic: str) -> str:
    """Return the ROS name of a type from its name by `stored_name`.

    Args:
        stored: the bag's name of the type.
        topic: its topic: those of service events have names of their own.
    """
    if not topic.endswith("/_service_event"):
        return stored
    return re.sub(r"/msg/(\w+)Event$", r"/srv/\1_Event", stored)


@functools.cache
def type_hash(type_name: str) -> str:
    """Return a type's `RIHS01_...` hash (REP-2011), or an empty text if none is installed.

    Args:
        type_name: `package/msg/Type`, or `package/srv/Service_Event` (`_Request`, `_Response`).
    """
    package, kind, stem, _ = _parse(type_name)
    path = _interface_file(package, kind, f"{stem}.json")
    if path is None:
        return ""
    hashes = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
    return next((h["hash_string"] for h in hashes if h["type_name"] == type_name), "")


def _parse(type_name: str) -> tuple[str, str, str, str]:
    """Return package, `msg` or `srv`, the interface file's stem, and the part of a service."""
    package, kind, name = type_name.split("/")
    stem, _, part = name.partition("_")
    return package, kind, stem, part


def _definition(name: str) -> str:
    """Return one type's own text."""
    package, kind, stem, part = _parse(name)
    path = _interface_file(package, kind, f"{stem}.{kind}")
    if path is None:
        raise BagError(
            f"no definition of {package}/{kind}/{stem}: share/{package}/{kind}/{stem}.{kind} is "
            f"neither in AMENT_PREFIX_PATH ({os.environ.get('AMENT_PREFIX_PATH', '')!r}) nor "
            f"where Python finds {package}; install the package {package}, or add its prefix"
        )
    # Bytes, not text mode: the schema is the unchanged file, line ends included.
    text = path.read_bytes().decode("utf-8")
    if kind == "msg":
        return text
    if part == "Event":
        return (
            "service_msgs/ServiceEventInfo info\n"
            f"{package}/{stem}_Request[<=1] request\n"
            f"{package}/{stem}_Response[<=1] response\n"
        )
    request, response = re.split(
        r"^---[ \t\r]*\n?", text, maxsplit=1, flags=re.MULTILINE
    )
    text = request if part == "Request" else response
    # A reader would look up a bare name in the package of the service.
    return _FIELD.sub(
        lambda field: field[0].replace(field[1], _full(field[1], package)), text
    )


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
