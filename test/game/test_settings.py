# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings: typed, bounded, and refused with name, value and what is allowed."""

import math

import pytest

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.settings import Setting, SettingTable, parse_assignments
from sparse_coord_ros.core.game.specs import Form, Number, Spec, SpecFamily

MODE = SpecFamily("mode", Form("off", ""), Form("level", "", (Number("x", 0, 1),)))
TABLE = SettingTable(
    [
        Setting("count", int, 3, "a count", low=1, high=2**63 - 1),
        Setting("share", float, 0.5, "a share", low=0, high=1),
        Setting("size", float, 1.0, "a size", low=0),
        Setting("loss", float, -1.0, "a loss", high=0),
        Setting("any", float, 0.0, "any number"),
        Setting("switch", bool, False, "a switch"),
        Setting("who", str, "a", "a name", choices=("a", "b")),
        Setting("text", str, "", "a text"),
        Setting("names", list, [], "names"),
        Setting("mode", MODE, "off", "a mode"),
        Setting("part", int, 0, "a part", low=0, high=99, least=8),
    ]
)


@pytest.mark.parametrize(
    ("name", "value", "parsed"),
    [
        ("count", "7", 7),
        ("count", 7.0, 7),
        ("count", "1e5", 100_000),
        ("count", str(2**63 - 1), 2**63 - 1),  # a float would round it up, out of range
        ("count", 1234567890123456789, 1234567890123456789),
        ("share", "0.25", 0.25),
        ("share", 1, 1.0),
        ("any", "-1e3", -1000.0),
        ("switch", "yes", True),
        ("switch", "OFF", False),
        ("switch", True, True),
        ("who", "b", "b"),
        ("text", 3, "3"),
        ("names", ("x", "y"), ["x", "y"]),
        ("mode", "level:0.5", Spec("level", (0.5,))),
        ("part", "0", 0),
        ("part", "8", 8),
    ],
)
def test_values_become_the_setting_s_type(name, value, parsed):
    result = TABLE.parse({name: value})
    assert result == {name: parsed}
    assert type(result[name]) is type(parsed)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("count", "0", "a whole number from 1 to 9223372036854775807"),
        ("count", str(2**63), "a whole number from 1 to 9223372036854775807"),
        ("count", "1.5", "a whole number"),
        ("count", "1e17", "a whole number"),  # floats skip numbers there
        ("count", "inf", "a whole number"),
        ("count", 1.5, "a whole number"),
        ("count", True, "a whole number"),
        ("count", None, "a whole number"),
        ("count", "", "a whole number"),
        ("share", "1.01", "a number from 0 to 1"),
        ("share", math.nan, "a number from 0 to 1"),
        ("share", [1], "a number from 0 to 1"),
        ("size", -1, "a number of at least 0"),
        ("size", "inf", "a number of at least 0"),
        ("loss", 1, "a number of at most 0"),
        ("any", "x", "allowed: a number"),
        ("switch", "maybe", "true or false"),
        ("who", "c", "a or b"),
        ("text", ["x"], "a text"),
        ("text", True, "a text"),
        ("names", "x", "a list of texts"),
        ("names", [1], "a list of texts"),
        ("mode", "on", "off, level:X"),
        ("part", 7, "0, or a whole number from 8 to 99"),
        ("part", -1, "0, or a whole number from 8 to 99"),
    ],
)
def test_bad_values(name, value, allowed):
    with pytest.raises(SettingError) as error:
        TABLE.parse({name: value})
    message = str(error.value)
    assert message.startswith(f"setting {name}: ")
    assert allowed in message
    assert repr(value) in message
    assert "\n" not in message


def test_unknown_name_gets_the_nearest_and_all_allowed():
    with pytest.raises(SettingError) as error:
        TABLE.parse({"cuont": 1})
    assert "unknown setting 'cuont' (did you mean 'count'?)" in str(error.value)
    assert "count, share, size" in str(error.value)


def test_defaults_are_parsed():
    assert TABLE.defaults()["mode"] == Spec("off")
    assert list(TABLE.defaults()) == list(TABLE)
    assert len(TABLE) == 11


def test_assignments():
    assert parse_assignments(["a=1", " b = x=y ", "a=2"]) == {"a": "2", "b": "x=y"}


def test_assignment_without_equals_sign():
    with pytest.raises(
        SettingError, match=r"setting 'penalty': write it as key=value, e\.g\."
    ):
        parse_assignments(["penalty"])
