# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gaps in words and in notes."""

import json

import pytest
from hypothesis import given, strategies

from sparse_coord_ros.log.bags.gaps import Gap, from_note, gap_lines, to_note
from sparse_coord_ros.log.bags.records import LATEST_NS

GAP = Gap(100, 300, "bad", 1_500_000_000, 2_000_000_000, "bag_0.mcap", 1)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({}, "bag_0.mcap, bytes 100 to 300 (1.5 s to 2.0 s): bad"),
        (
            {"recovered": True},
            "bag_0.mcap, bytes 100 to 300 of the original (1.5 s to 2.0 s): bad",
        ),
        ({"first_ns": None}, "bag_0.mcap, bytes 100 to 300 (up to 2.0 s): bad"),
        ({"begin": 300, "last_ns": None}, "bag_0.mcap, byte 300 on (1.5 s on): bad"),
        ({"begin": 0, "end": 0, "first_ns": None, "last_ns": None}, "bag_0.mcap: bad"),
    ],
)
def test_a_gap_in_words(change, text):
    assert GAP._replace(**change).text == text


def test_of_very_many_gaps_some_are_told():
    assert gap_lines([GAP] * 20) == [f"lost: {GAP.text}"] * 20
    assert gap_lines([GAP] * 23)[20:] == ["and 3 more gaps (all: info --json)"]


TIMES = strategies.none() | strategies.integers(0, LATEST_NS)
WORDS = strategies.text("abc .0/", min_size=1, max_size=20)
GAPS = strategies.builds(
    Gap,
    begin=strategies.integers(0, 2**40),
    end=strategies.integers(0, 2**40),
    why=WORDS,
    first_ns=TIMES,
    last_ns=TIMES,
    file=WORDS,
    place=strategies.just(0),
)


@given(strategies.lists(GAPS, max_size=5))
def test_a_note_keeps_gaps_but_for_the_place(gaps):
    assert from_note(to_note(gaps)) == [gap._replace(recovered=True) for gap in gaps]


@pytest.mark.parametrize(
    "told",
    [
        "",
        "no JSON",
        "[" * 100_000,
        "7",
        "[7]",
        json.dumps([[1, 2, "why", 3, 4]]),
        json.dumps([[1, 2, "why", "3", 4, "file"]]),
        json.dumps([[1, -2, "why", 3, 4, "file"]]),
        json.dumps([[1, 2, "why", 3, 10**400, "file"]]),
        json.dumps([[1, 2, "why", 3, float("nan"), "file"]]),
        json.dumps([[1, 2, 3, 3, 4, "file"]]),
        json.dumps([[1, 2, "why", 3, 4, "file", 9, True]]),
        " " * 5_000_000 + "[]",
    ],
)
def test_a_note_of_somebody_else_tells_of_none(told):
    assert from_note(told) == []


def test_a_note_stays_one_line():
    [gap] = from_note(
        json.dumps([[1, 2, "a\nb\x1b[2J" + "x" * 999, None, None, "c\rd"]])
    )
    assert (gap.why[:5], len(gap.why), gap.file) == ("ab[2J", 200, "cd")
