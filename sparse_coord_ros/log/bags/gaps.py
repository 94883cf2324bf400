# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of a bag that cannot be read: named, in words, and noted in what is recovered."""

import json
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from sparse_coord_ros.base.limits import METADATA
from sparse_coord_ros.log.bags.records import LATEST_NS

SHOWN = 20
"""Gaps that are told one by one."""


class Gap(NamedTuple):
    """A part of a bag that cannot be read; all outside of the gaps is read.

    What is lost was logged between the neighbours of the gap. A message may come a little late,
    so what is lost may lie a few time steps outside of these times.

    Attributes:
        begin, end: its bytes in the file, without `end`. The same where nobody knows how many are
            gone: the file was cut off, or is missing (then both are 0).
        why: what is wrong there, one sentence.
        first_ns: the latest log time of what was read before it; None: nothing was.
        last_ns: the earliest log time of what was read behind it; None: nothing was.
        file: name of the file that it is in, or that is missing.
        place: the number of that file in `Bag.files`; of a missing one, of the file behind it.
        recovered: whether `recover` has left it out already: its bytes are those of the original.
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
        """The gap in words: where, when by the log's time, and why."""
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
    """Return gaps in words, one a line; of very many how many more there are."""
    more = len(gaps) - SHOWN
    lines = [f"lost: {gap.text}" for gap in gaps[:SHOWN]]
    return [*lines, f"and {more} more gaps (all: info --json)"] if more > 0 else lines


def to_note(gaps: Iterable[Gap]) -> str:
    """Return gaps as a text for `from_note`."""
    return json.dumps([gap[:6] for gap in gaps])


def from_note(text: str) -> list[Gap]:
    """Return the gaps that `recover` has noted; a text that is no such note tells of none."""
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
