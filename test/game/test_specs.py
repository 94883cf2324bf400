# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Specs: `kind:number:...` is read, written back without loss, and refused with a reason."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

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


def test_written_as_people_write_it():
    assert str(Spec("level", (1.0,))) == "level:1"
    assert str(Spec("level", (0.7,))) == "level:0.7"
    assert str(Spec("off")) == "off"


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(0, 1))
def test_a_written_spec_reads_back_to_the_same_bits(number, share):
    for spec in (Spec("ramp", (number, -number)), Spec("stops", (number, share, 1.0))):
        assert repr(FAMILY.parse(str(spec)).numbers) == repr(spec.numbers)


@pytest.mark.parametrize(
    ("value", "named"),
    [
        ("lvel:0.5", "'lvel:0.5'.*'level'"),
        ("", "''"),
        (0.5, "'0.5'"),
        ("level", "'level' has 0 numbers"),
        ("off:1", "'off:1' has 1 number"),
        ("ramp:1", "'ramp:1' has 1 number"),
        ("stops:1", "'stops:1' has 1 number"),
        ("stops:7:1:1:7", "x is '7'"),
        ("level:half", "x is 'half'"),
    ],
)
def test_bad_specs(value, named):
    with pytest.raises(SettingError, match=f"^setting light: .*{named}"):
        FAMILY.parse(value)


@given(st.floats().filter(lambda number: not 0 <= number <= 1))
def test_a_number_out_of_its_range_is_refused(number):
    with pytest.raises(SettingError, match="^setting light: x is "):
        FAMILY.parse(f"level:{number!r}")
