# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Specs: `kind:number:...` is read, written back without loss, and refused with a reason."""

import pytest

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.specs import Form, Number, Spec, SpecFamily, probability

FAMILY = SpecFamily(
    "light",
    Form("off", ""),
    Form("level", "", (probability("x"),)),
    Form("ramp", "", (Number("a"), Number("b"))),
    Form("stops", "", (Number("a"), Number("x", 0.0, 1.0, repeated=True))),
)


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("off", Spec("off")),
        ("level:0.5", Spec("level", (0.5,))),
        ("level:1", Spec("level", (1.0,))),
        ("ramp:-2:1e3", Spec("ramp", (-2.0, 1000.0))),
        ("stops:5:1", Spec("stops", (5.0, 1.0))),
        ("stops:5:1:0:0.5", Spec("stops", (5.0, 1.0, 0.0, 0.5))),
    ],
)
def test_parse(text, spec):
    assert FAMILY.parse(text) == spec
    assert FAMILY.parse(spec) is spec


@pytest.mark.parametrize(
    "number", [0.1 + 0.2, 1 / 3, 1e-300, 0.123456789, 123456789.0, 0.0, 1.0]
)
def test_written_spec_reads_back_to_the_same_bits(number):
    spec = Spec("ramp", (number, -number))
    assert FAMILY.parse(str(spec)).numbers == spec.numbers


def test_written_as_people_write_it():
    assert str(Spec("level", (1.0,))) == "level:1"
    assert str(Spec("level", (0.7,))) == "level:0.7"
    assert str(Spec("off")) == "off"


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (
            "lvel:0.5",
            ["unknown value 'lvel:0.5'", "did you mean 'level'", "off, level:X"],
        ),
        ("", ["unknown value ''"]),
        (0.5, ["unknown value '0.5'"]),
        ("level", ["'level' has 0 numbers", "takes 1", "level:X"]),
        ("off:1", ["'off:1' has 1 number", "takes 0"]),
        ("ramp:1", ["takes 2", "ramp:A:B"]),
        ("stops:1", ["'stops:1' has 1 number", "takes 2 or more", "stops:A:X:..."]),
        ("stops:7:1:1:7", ["x is '7'", "from 0 to 1"]),
        ("level:2", ["x is '2'", "from 0 to 1"]),
        ("level:-0.1", ["x is '-0.1'", "from 0 to 1"]),
        ("level:nan", ["x is 'nan'"]),
        ("level:half", ["x is 'half'"]),
    ],
)
def test_bad_specs(value, words):
    with pytest.raises(SettingError) as error:
        FAMILY.parse(value)
    message = str(error.value)
    assert message.startswith("setting light: ")
    assert [word for word in words if word not in message] == []
