# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings: typed, bounded, and refused with name, value and what is allowed."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

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
        ("count", 7.0, 7),
        ("count", "1e5", 100_000),
        ("count", str(2**63 - 1), 2**63 - 1),  # a float would round it up, out of range
        ("count", 1234567890123456789, 1234567890123456789),
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
    ("name", "value"),
    [
        ("count", str(2**63)),
        ("count", "1.5"),
        ("count", "1e17"),  # floats skip numbers there
        ("count", "inf"),
        ("count", True),
        ("count", None),
        ("count", ""),
        ("share", math.nan),
        ("share", [1]),
        ("size", "inf"),
        ("any", "x"),
        ("switch", "maybe"),
        ("who", "c"),
        ("text", ["x"]),
        ("text", True),
        ("names", "x"),
        ("names", [1]),
        ("mode", "on"),
        ("part", 7),
        ("part", -1),
    ],
)
def test_bad_values(name, value):
    with pytest.raises(SettingError) as error:
        TABLE.parse({name: value})
    message = str(error.value)
    assert message.startswith(f"setting {name}: ")
    assert repr(value) in message
    assert "\n" not in message


@given(st.integers())
@example(0)
@example(2**63 - 1)
@example(2**63)
def test_whole_numbers_in_range_as_numbers_and_as_texts(number):
    for value in (number, str(number)):
        if 1 <= number <= 2**63 - 1:
            assert TABLE.parse({"count": value}) == {"count": number}
        else:
            refused("count", value)


@given(st.floats())
@example(0.0)
@example(-1.0)
@example(math.nextafter(1.0, 2.0))
def test_numbers_in_range_as_numbers_and_as_texts(number):
    ranges = {"share": (0, 1), "size": (0, math.inf), "loss": (-math.inf, 0)}
    for name, (low, high) in ranges.items():
        for value in (number, repr(number)):
            if low <= number <= high and math.isfinite(number):
                assert TABLE.parse({name: value}) == {name: number}
            else:
                refused(name, value)


def refused(name, value):
    with pytest.raises(SettingError, match=f"^setting {name}: "):
        TABLE.parse({name: value})


def test_unknown_name_gets_the_nearest_and_all_allowed():
    with pytest.raises(SettingError, match="'cuont'.*'count'.*count, share, size"):
        TABLE.parse({"cuont": 1})


def test_defaults_are_parsed():
    assert TABLE.defaults()["mode"] == Spec("off")
    assert list(TABLE.defaults()) == list(TABLE)
    assert len(TABLE) == 11


def test_assignments():
    assert parse_assignments(["a=1", " b = x=y ", "a=2"]) == {"a": "2", "b": "x=y"}


def test_assignment_without_equals_sign():
    with pytest.raises(SettingError, match="'penalty'.*key=value"):
        parse_assignments(["penalty"])
