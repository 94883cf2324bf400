# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gaps of a bag: unreadable parts, in words and as a note in a recovered bag."""

import json
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from sparse_coord_ros.base.limits import METADATA
from sparse_coord_ros.log.bags.records import LATEST_NS

SHOWN = 20
"""Most gaps that are listed one by one."""


class Gap(NamedTuple):
    """An unreadable part of a bag. Everything outside of the gaps is read.

    The lost messages were logged between the neighbours of the gap. As a message may come late,
    their time steps may lie a few steps outside of these times.

    Attributes:
        begin, end: its bytes in the file, without `end`. They are equal if the number of lost
            bytes is unknown: the file was cut off, or is missing (then both are 0).
        why: the reason, one sentence.
        first_ns: the latest log time before the gap; None: no message.
        last_ns: the earliest log time after the gap; None: no message.
        file: name of the damaged or missing file.
        place: the number of that file in `Bag.files`; of a missing one, of the file after it.
        recovered: whether `recover` has already left it out: `begin` and `end` are those of the
            original.
    """

    begin: int
    end: int
    why: str
    first_ns: int | None
    last_ns: int | None
    file: str
    place: int = 0
    recovered: bool = False

    @property
    def text(self) -> str:
        """The gap in words: its place, its log times, its reason."""
        where = self.file
        if self.end:
            of = f"bytes {self.begin} to {self.end}"
            where += f", {of if self.begin < self.end else f'byte {self.end} on'}"
            where += " of the original" * self.recovered
        first, last = (
            None if ns is None else ns / 1e9 for ns in (self.first_ns, self.last_ns)
        )
        if first is None:
            when = "" if last is None else f" (up to {last:.1f} s)"
        else:
            when = f" ({first:.1f} s {'on' if last is None else f'to {last:.1f} s'})"
        return f"{where}{when}: {self.why}"


def gap_lines(gaps: Sequence[Gap]) -> list[str]:
    """Return gaps in words, one a line; after the first ones only the number of further gaps."""
    more = len(gaps) - SHOWN
    lines = [f"lost: {gap.text}" for gap in gaps[:SHOWN]]
    return [*lines, f"and {more} more gaps (all: info --json)"] if more > 0 else lines


def to_note(gaps: Iterable[Gap]) -> str:
    """Return gaps as a text for `from_note`."""
    return json.dumps([gap[:6] for gap in gaps])


def from_note(text: str) -> list[Gap]:
    """Return the gaps in a note of `recover`; empty if the text is no such note."""
    try:
        told = json.loads(text) if len(text) <= METADATA.bytes else []
        return [_noted(*one) for one in told]
    except (ValueError, TypeError, RecursionError):
        return []


def _noted(
    begin: int, end: int, why: str, first_ns: int | None, last_ns: int | None, file: str
) -> Gap:
    if not all(
        0 <= number <= LATEST_NS for number in (begin, end, first_ns or 0, last_ns or 0)
    ):
        raise ValueError
    why, file = ("".join(filter(str.isprintable, text))[:200] for text in (why, file))
    return Gap(begin, end, why, first_ns, last_ns, file, recovered=True)
