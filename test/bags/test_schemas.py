# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Schemas and hashes against the installed interface files and rosbags' own type system."""

import importlib.util
import json
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.log.bags import type_hash
from sparse_coord_ros.log.bags.schemas import schema_text

SEPARATOR = "=" * 80
PACKAGES = (
    "builtin_interfaces diagnostic_msgs geometry_msgs nav_msgs rcl_interfaces rosgraph_msgs "
    "sensor_msgs service_msgs std_msgs visualization_msgs"
).split()


def share(package):
    """Return a message package's share directory, independently of the code under test."""
    location = importlib.util.find_spec(package).submodule_search_locations[0]
    return Path(location).parents[3] / "share" / package


MESSAGES = [
    f"{p}/msg/{path.stem}"
    for p in PACKAGES
    for path in sorted(share(p).glob("msg/*.msg"))
]
# rosidl makes a `char` a uint8 and hashes it as such, rosbags does not.
WITH_CHAR = {"service_msgs/msg/ServiceEventInfo", "std_msgs/msg/Char"}


@pytest.fixture
def fresh_cache():
    """Clear the cache of definitions, before and after the test."""
    schema_text.cache_clear()
    type_hash.cache_clear()
    yield
    schema_text.cache_clear()
    type_hash.cache_clear()


def installed_hashes(path):
    """Return the hashes in an interface's json file, by type name."""
    hashes = json.loads(path.read_text())["type_hashes"]
    return {entry["type_name"]: entry["hash_string"] for entry in hashes}


def test_text_is_the_definition_then_each_dependency_once_as_rosbag2_orders_them():
    """The layout of rosbag2's local_message_definition_source.cpp, byte by byte."""

    def text(name):
        package, _, message = name.partition("/")
        return (share(package) / "msg" / f"{message}.msg").read_bytes().decode()

    expected = text("nav_msgs/Path") + "".join(
        f"\n{SEPARATOR}\nMSG: {name}\n{text(name)}"
        for name in (
            "geometry_msgs/PoseStamped",
            "geometry_msgs/Pose",
            "geometry_msgs/Point",
            "geometry_msgs/Quaternion",
            "std_msgs/Header",
            "builtin_interfaces/Time",
        )
    )
    assert schema_text("nav_msgs/msg/Path") == expected


@pytest.mark.parametrize("type_name", MESSAGES)
def test_schema_hashes_to_the_installed_type_hash(type_name):
    """The hash rosbags computes is from our text alone: a wrong or missing part would show."""
    package, _, name = type_name.split("/")
    typestore = get_typestore(Stores.EMPTY)
    typestore.register(get_types_from_msg(schema_text(type_name), type_name))
    expected = installed_hashes(share(package) / "msg" / f"{name}.json")[type_name]
    assert type_hash(type_name) == expected
    assert (typestore.hash_rihs01(type_name) == expected) == (
        type_name not in WITH_CHAR
    )


def test_ament_prefix_comes_first(tmp_path, monkeypatch, fresh_cache):
    """A package that only an overlay has is found, and the overlay's text wins."""
    folder = tmp_path / "share" / "overlay_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Pair.msg").write_bytes(b"Half[2] halves\r\nwstring<=4 name\r\n")
    (folder / "Half.msg").write_text("uint8 ONE=1\nint8 value 3  # Other thing\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    assert schema_text("overlay_msgs/msg/Pair") == (
        "Half[2] halves\r\nwstring<=4 name\r\n"
        f"\n{SEPARATOR}\nMSG: overlay_msgs/Half\nuint8 ONE=1\nint8 value 3  # Other thing\n"
    )
    assert type_hash("overlay_msgs/msg/Pair") == ""


def test_packages_are_found_without_ament(monkeypatch, fresh_cache):
    """The wheels set no AMENT_PREFIX_PATH."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert schema_text("std_msgs/msg/String").endswith("string data\n")
    assert type_hash("std_msgs/msg/String").startswith("RIHS01_")


def test_missing_definition_names_package_and_remedy():
    """The error names the missing file, and the package to install."""
    with pytest.raises(
        BagError, match="share/nav_msgs/msg/Nonsense.msg .* AMENT_PREFIX_PATH"
    ):
        schema_text("nav_msgs/msg/Nonsense")
    with pytest.raises(BagError, match="install the package no_such_msgs"):
        schema_text("no_such_msgs/msg/Call")
    assert type_hash("no_such_msgs/msg/Nonsense") == ""
