# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One time line from the files of a bag: what a roll-back superseded is left out, gaps are named.

A team that goes back to a checkpoint does some time steps again. The recorder then begins another
file, which says where the run goes on. What the files before it say of these steps is superseded.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.log.bags.gaps import Gap
from sparse_coord_ros.log.bags.metadata import (
    RESTARTED,
    ROLLED_BACK,
    SPLIT,
    STALLED_RECORD,
)
from sparse_coord_ros.log.bags.reader import Bag
from sparse_coord_ros.log.runlog.difference import Difference


class Rollback(NamedTuple):
    """Where a file of a bag takes the run back.

    Attributes:
        file: its place in the bag.
        step: the checkpoint: the robots' tables are of this time step.
        first: the time step of the first local state after it.
        until: the newest time step of the files before.
    """

    file: int
    step: int
    first: int
    until: int


MARGIN = 5
"""Time steps before and after a gap in which single messages may be missing."""


class LostSteps(NamedTuple):
    """Time steps that are not in the log: from `first` to `last`; None: to the run's end."""

    first: int
    last: int | None


class Jump(NamedTuple):
    """Messages of a topic that are not in the file, by their numbers.

    Attributes:
        topic: its name.
        before, after: log times of its messages before and after them.
        odd: what that is in a bag of which nothing is lost.
    """

    topic: str
    before: int
    after: int
    odd: Difference


class Stall(NamedTuple):
    """Where a recorder stood still.

    Attributes:
        step: the time step from which on messages may be lost.
        seconds: for how long.
    """

    step: int
    seconds: str


def stalls(bag: Bag) -> list[Stall]:
    """Return where the recorder of a bag stood still; records that make no sense are left out."""
    records = [texts for name, texts in bag.metadata_records if name == STALLED_RECORD]
    steps = [texts.get("step", "") for texts in records]
    return [
        Stall(int(step[:18]), texts.get("seconds", "?"))
        for step, texts in zip(steps, records, strict=True)
        if step.isdecimal()
    ]


def rollbacks(bag: Bag) -> list[Rollback]:
    """Return the roll-backs of a bag, `until` still unknown.

    A record that makes no sense is left out; the log then differs, as steps come twice.
    """
    found = []
    for place, file in enumerate(bag.files):
        said = file.continued or {}
        texts = said.get("step", ""), said.get("first", "")
        if (
            place
            and said.get("why") == ROLLED_BACK
            and all(t.isdecimal() for t in texts)
        ):
            step, first = (int(text[:18]) for text in texts)
            if step <= first <= step + EPISODE_GAP or step == 0:
                found.append(Rollback(place, step, first, 0))
    return found


def kept(
    files: Sequence[np.ndarray],
    backs: Sequence[Rollback],
    period: int,
    *,
    checkpoints: bool,
) -> np.ndarray:
    """Return the rows of one topic, of which those that a roll-back superseded are left out.

    Args:
        files: rows with the field `ns`, of each file.
        backs: the roll-backs.
        period: nanoseconds of a time step.
        checkpoints: the topic also says things of a roll-back's checkpoint, before its first step.
    """
    rows = files[0]
    of_file = {back.file: back for back in backs}
    for place, more in enumerate(files[1:], start=1):
        back = of_file.get(place)
        if back is not None:
            end = back.first * period
            rows = rows[rows["ns"] < end]
            begin = back.step * period if checkpoints else end
            # Before them lie stragglers: what was under way when the order came.
            late = np.flatnonzero(np.diff(more["ns"]) < 0)
            after = int(late[-1]) + 1 if len(late) else 0
            if after and more["ns"][:after].min() > more["ns"][after]:
                more = more[after:]
            more = more[more["ns"] >= begin]
        rows = np.concatenate([rows, more])
    return rows


def holds(place: int, step: int, backs: Sequence[Rollback]) -> bool:
    """Whether what a file (by its place) says of a time step is not superseded."""
    before = any(place < back.file and step >= back.first for back in backs)
    return not before and not any(
        place == back.file and step < back.step for back in backs
    )


def gaps(
    bag: Bag,
    clocks: Sequence[np.ndarray],
    heard: Sequence[int],
    backs: Sequence[Rollback],
    said: int,
) -> tuple[list[LostSteps], list[Rollback]]:
    """Return what was not recorded between files, and the roll-backs with their `until`.

    What a recorder missed that came back is told by the clock, as it numbers messages on.

    Args:
        bag: the bag.
        clocks: time steps of the clock, of each file.
        heard: from which time step on the recorder heard all robots, of each file. One that comes
            back may hear the world before it hears a robot.
        backs: the roll-backs.
        said: the time step of the world's last status: a recorder that comes back after the run's
            end hears nothing else.
    """
    of_file: Mapping[int, Rollback] = {back.file: back for back in backs}
    found = []
    known = []
    end = 0
    for place, steps in enumerate(clocks):
        back = of_file.get(place)
        if back is not None:
            known.append(back._replace(until=end))
            end = min(end, back.first - 1)
        why = (bag.files[place].continued or {}).get("why")
        if place and len(steps) and (why != SPLIT or back is not None):
            first = int(steps.min()) if back is None else back.first
            if why == RESTARTED:
                first = max(first, heard[place])
            if first - end > EPISODE_GAP:
                found.append(LostSteps(end + 1, first - 1))
            if first < int(
                steps.min()
            ):  # of a recorder that came back as the run went back
                found.append(LostSteps(first, int(steps.min()) - 1))
        elif why == RESTARTED and place == len(clocks) - 1 and said - end > EPISODE_GAP:
            found.append(LostSteps(end + 1, said))
        end = max(end, int(steps.max(initial=0)))
    return found, known


def lost(
    jumps: Sequence[Jump], period: int, known: Sequence[LostSteps]
) -> list[LostSteps]:
    """Return gaps, those that are known and those of which missing numbers tell.

    The topics of every step say where a gap lies; that one which says something seldom misses
    messages, too, somewhere around it, tells nothing new.

    Args:
        jumps: those of the topics of every step.
        period: nanoseconds of a time step.
        known: gaps.
    """
    found = list(known)
    for jump in sorted(jumps, key=lambda one: abs(one.after - one.before)):
        ends = sorted((jump.before // period, jump.after // period))
        first = ends[0] + 1
        last = max(ends[0] + 1, ends[1] - 1)
        low = first - MARGIN
        high = last + MARGIN
        if not any(
            low <= gap.first and (gap.last or gap.first) <= high for gap in found
        ):
            found.append(LostSteps(first, last))
    return found


def gap_in_words(gap: Gap, period: int) -> str:
    """Return which part of a bag cannot be read and why, and about which time steps that are."""
    first = "the beginning" if gap.first_ns is None else gap.first_ns // period
    last = "the end" if gap.last_ns is None else gap.last_ns // period
    return f"{gap.text}; about time steps {first} to {last}"


def steps_of(rows: np.ndarray, period: int) -> np.ndarray:
    """Return the time steps of rows with the field `ns`."""
    return np.asarray((rows["ns"] + period // 2) // period)
