# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""YAML is read by PyYAML; what is written is read back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sparse_coord_ros.base.errors import ScenarioError
from sparse_coord_ros.base.yaml_text import parse_yaml, to_yaml
from sparse_coord_ros.core.game.scenario import SETTINGS

LIKE_OTHERS = "1e3 12e45 0o7 0x1f 1.5 yes 010 2020-01-01 1:1 .5 +1 ~ true .inf 1_000 <<"
KEYS = st.text("abcxyz_ 12:-", min_size=1)
PLAIN = st.one_of(
    st.sampled_from(["", "a: b", *LIKE_OTHERS.split()]),
    st.text(st.characters(codec="utf-8")),
    st.integers(),
    st.floats(allow_nan=False),
    st.sampled_from([True, False, None]),
)


@given(
    st.recursive(
        PLAIN,
        lambda inner: st.lists(inner) | st.dictionaries(KEYS, inner),
        max_leaves=8,
    )
)
def test_what_is_written_is_read_back(value):
    found = parse_yaml(to_yaml({"k": value}), where="")["k"]
    assert repr(found) == repr(value)


def test_shared_parts_are_written_out():
    part = [1, 2]
    assert to_yaml({"a": part, "b": part}).count("- 1") == 2


@pytest.mark.parametrize(
    "text", ["{a: 1, 'a': 1}", "a: {b: 1, b: 2}", "- {x: 1, 'x': 2}", "{1: a, 1: b}"]
)
def test_a_key_that_is_there_twice_is_refused(text):
    with pytest.raises(ScenarioError, match="here, line 1.*is there twice"):
        parse_yaml(text, where="here")


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("steps", "1e5", 100_000),
        ("penalty", "-1e2", -100.0),
        ("penalty", "-20", -20.0),
        ("ask_cost", ".5", 0.5),
        ("interactions", "together", "together"),
    ],
)
def test_settings_are_read_as_people_write_them(name, text, value):
    said = parse_yaml(f"{name}: {text}", where="")[name]
    assert SETTINGS[name].parse(said) == value
