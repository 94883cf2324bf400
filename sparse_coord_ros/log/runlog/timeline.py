# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The time line of a bag with several files: roll-backs and gaps.

A team that goes back to a checkpoint makes some time steps again. The recorder then begins another
file, with a record of the step from which the run continues. It supersedes the messages of these
steps in the files before: they are left out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.log.bags.contents import BagFile
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
    """A file of a bag that begins with a return of the team to a checkpoint.

    Attributes:
        file: the file's place in the bag.
        step: the time step of the checkpoint, and so of the robots' tables.
        first: the time step of the first local state after the return.
        until: the newest time step of the files before.
    """

    file: int
    step: int
    first: int
    until: int


MARGIN = 5
"""Time steps before and after a gap in which single messages may be missing as well."""


class LostSteps(NamedTuple):
    """Time steps from `first` to `last` that are not in the log; None: up to the run's end."""

    first: int
    last: int | None


class Jump(NamedTuple):
    """A jump in the sequence numbers of a topic: the messages between are not in the file.

    Attributes:
        topic: the topic's name.
        before, after: log times of the messages before and after the jump.
        difference: the report of `verify` on the jump in a bag without losses.
    """

    topic: str
    before: int
    after: int
    difference: Difference


class Stall(NamedTuple):
    """A pause in which a recorder did not run.

    Attributes:
        step: the first time step whose messages may be lost.
        seconds: the length of the pause.
    """

    step: int
    seconds: str


def stalls(bag: Bag) -> list[Stall]:
    """Return the pauses of a bag's recorder; malformed records are left out."""
    found = []
    for name, texts in bag.metadata_records:
        step = texts.get("step", "")
        if name == STALLED_RECORD and step.isdecimal():
            found.append(Stall(_number(step), texts.get("seconds", "?")))
    return found


def _number(text: str) -> int:
    """Return a decimal text as a number; a forged one may have any length."""
    return int(text[:18])


def rollbacks(bag: Bag) -> list[Rollback]:
    """Return the roll-backs of a bag, `until` still unknown.

    Malformed records are left out. `verify` then finds differences, as steps come twice.
    """
    found = []
    for place, file in enumerate(bag.files[1:], start=1):
        record = file.continued or {}
        step = record.get("step", "")
        first = record.get("first", "")
        if record.get("why") != ROLLED_BACK:
            continue
        if not (step.isdecimal() and first.isdecimal()):
            continue
        back = Rollback(place, _number(step), _number(first), 0)
        if back.step == 0 or back.step <= back.first <= back.step + EPISODE_GAP:
            found.append(back)
    return found


def without_superseded(
    files: Sequence[np.ndarray],
    backs: Sequence[Rollback],
    period: int,
    *,
    checkpoints: bool,
) -> np.ndarray:
    """Return the rows of one topic, without those that a roll-back superseded.

    Args:
        files: for each file its rows, with the field `ns`.
        backs: the roll-backs.
        period: nanoseconds of a time step.
        checkpoints: whether the topic also has messages of a roll-back's checkpoint.
    """
    rows = files[0]
    rollback_of = {back.file: back for back in backs}
    for place, later in enumerate(files[1:], start=1):
        back = rollback_of.get(place)
        if back is not None:
            first_ns = back.first * period
            begin_ns = back.step * period if checkpoints else first_ns
            rows = rows[rows["ns"] < first_ns]
            later = _without_late(later)
            later = later[later["ns"] >= begin_ns]
        rows = np.concatenate([rows, later])
    return rows


def _without_late(rows: np.ndarray) -> np.ndarray:
    """Leave out the late messages at a file's beginning, which were sent before the roll-back."""
    falls = np.flatnonzero(np.diff(rows["ns"]) < 0)
    if not len(falls):
        return rows
    begin = int(falls[-1]) + 1
    if rows["ns"][:begin].min() <= rows["ns"][begin]:
        return rows
    return rows[begin:]


def superseded(place: int, step: int, backs: Sequence[Rollback]) -> bool:
    """Return whether a roll-back supersedes a file's (by its place) messages of a time step."""
    for back in backs:
        if place < back.file and step >= back.first:
            return True
        if place == back.file and step < back.step:
            return True
    return False


def gaps(
    bag: Bag,
    clocks: Sequence[np.ndarray],
    heard: Sequence[int],
    heard_to: Sequence[int],
    backs: Sequence[Rollback],
    last_status: int,
    late: bool,
) -> tuple[list[LostSteps], list[Rollback]]:
    """Return the gaps between the files of a bag, and the roll-backs with their `until`.

    A recorder that came back continues the numbers of the clock's messages, so only their time
    steps show the missed ones.

    Args:
        bag: the bag.
        clocks: for each file the time steps of the clock.
        heard: for each file the first time step from which the recorder received all robots. A
            recorder that comes back may receive the world's messages before a robot's.
        heard_to: for each file the last time step of the topic that ends first. A recorder that
            was killed may have lost the last messages of any topic.
        backs: the roll-backs.
        last_status: the time step of the world's last status. A recorder that comes back after the
            run's end receives only that.
        late: whether the run may have begun before the recorder.
    """
    rollback_of = {back.file: back for back in backs}
    found: list[LostSteps] = []
    known: list[Rollback] = []
    end = 0  # the newest time step of the files before
    # `heard_to` of the file before, if its recorder was killed.
    killed_at: int | None = None
    for place, steps in enumerate(clocks):
        back = rollback_of.get(place)
        if back is not None:
            known.append(back._replace(until=end))
            end = min(end, back.first - 1)
        file = bag.files[place]
        why = None if file.continued is None else file.continued.get("why")
        follows = back is not None or why != SPLIT
        if place and follows and len(steps):
            begin = int(steps.min())
            first = begin if back is None else back.first
            if why == RESTARTED:
                first = max(first, heard[place])
            found += _between(end, first, killed_at)
            if first < begin:  # the recorder came back while the team went back
                found.append(LostSteps(first, begin - 1))
        elif not place and late and len(steps):
            first = max(int(steps.min()), heard[0])
            if first > 1:
                found.append(LostSteps(1, first - 1))
        elif why == RESTARTED and place == len(clocks) - 1:
            found += _after_the_end(end, last_status)
        end = max(end, int(steps.max(initial=0)))
        if len(steps):
            killed_at = heard_to[place] if _was_killed(file) else None
    return found, known


def _after_the_end(end: int, last_status: int) -> list[LostSteps]:
    """Return the gap before a recorder that came back after the run's end, if there is one.

    Args:
        end: the newest time step of the files before.
        last_status: the time step of the world's last status.
    """
    if last_status - end > EPISODE_GAP:
        return [LostSteps(end + 1, last_status)]
    return []


def _between(end: int, first: int, killed_at: int | None) -> list[LostSteps]:
    """Return the gap between two files, if there is one.

    Args:
        end: the newest time step of the files before.
        first: the first time step that the next file should have.
        killed_at: the last time step of the topic that ends first, if a recorder was killed.
    """
    if first - end > EPISODE_GAP:
        return [LostSteps(end + 1, first - 1)]
    if killed_at is not None and first > killed_at - MARGIN:
        return [LostSteps(min(killed_at + 1, first - 1), first - 1)]
    return []


def _was_killed(file: BagFile) -> bool:
    """Return whether a recorder did not end a file itself."""
    return not file.finished or file.recovered is not None


def with_jumps(
    known: Sequence[LostSteps], jumps: Sequence[Jump], period: int
) -> list[LostSteps]:
    """Return gaps: the known ones, and the gaps at jumps in the sequence numbers.

    Topics of every step show a gap exactly, so the narrowest jump is taken first. A wider jump
    around a gap that is already known, as of a topic with few messages, is left out.

    Args:
        known: gaps.
        jumps: the jumps of the topics with a message at every step.
        period: nanoseconds of a time step.
    """
    found = list(known)
    for jump in sorted(jumps, key=_width):
        before, after = sorted((jump.before // period, jump.after // period))
        first = before + 1
        last = max(first, after - 1)
        if not any(_near(gap, first, last) for gap in found):
            found.append(LostSteps(first, last))
    return found


def _width(jump: Jump) -> int:
    return abs(jump.after - jump.before)


def _near(gap: LostSteps, first: int, last: int) -> bool:
    end = gap.last or gap.first
    return first - MARGIN <= gap.first and end <= last + MARGIN


def gap_in_words(gap: Gap, period: int) -> str:
    """Return a gap of a bag in words, with its reason and its approximate time steps."""
    first = "the beginning" if gap.first_ns is None else gap.first_ns // period
    last = "the end" if gap.last_ns is None else gap.last_ns // period
    return f"{gap.text}; about time steps {first} to {last}"


def steps_of(rows: np.ndarray, period: int) -> np.ndarray:
    """Return the time steps of rows with the field `ns`."""
    return np.asarray((rows["ns"] + period // 2) // period)
