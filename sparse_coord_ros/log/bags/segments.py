# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The segments of a bag, chained: each is cut where the next one begins.

A team that goes back to a checkpoint makes some time steps again. The recorder then begins another
file of the bag, a segment, with the run at the checkpoint's time. What earlier segments have
from that time step on is superseded.
"""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.bags.reader import Bag, Message
from sparse_coord_ros.protocol.wire import LOCAL_STATE, RUN
from sparse_coord_ros.protocol.wire.messages import SECOND

NO_BEGIN = -1
"""In place of a segment's first time step: it supersedes nothing."""

FAR = 2**40
"""A time step after all others."""


def begins(bag: Bag) -> list[int]:
    """Return for each file of a bag the checkpoint at which it begins, or `NO_BEGIN`.

    A segment begins with the run, at the time of the checkpoint.
    """
    period = round(RunConfig.step_period * SECOND)
    topics = [one for one in bag.topics if one.endswith(f"/{RUN.name}")]
    found = []
    for place in range(len(bag.files)):
        run = next(bag.messages(topics, [place]), None) if place else None
        found.append(NO_BEGIN if run is None else run.log_time_ns // period)
    return found


def ends(first_steps: Sequence[int]) -> list[int]:
    """Return for each file the time step from which later files supersede it; `FAR`: none do.

    Args:
        first_steps: as of `begins`.
    """
    found = []
    for place in range(len(first_steps)):
        later = [step for step in first_steps[place + 1 :] if step != NO_BEGIN]
        found.append(min(later, default=FAR))
    return found


def messages(bag: Bag, topics: Collection[str]) -> Iterator[Message]:
    """Yield the messages of some topics in the order of the files, without superseded ones."""
    period = round(RunConfig.step_period * SECOND)
    for place, end in enumerate(ends(begins(bag))):
        end_ns = end * period
        for message in bag.messages(topics, [place]):
            at = message.log_time_ns
            last = at == end_ns and message.topic.endswith(f"/{LOCAL_STATE.name}")
            if at < end_ns or last:
                yield message


def chained(
    files: Sequence[np.ndarray],
    first_steps: Sequence[int],
    period: int,
    *,
    with_last: bool = False,
) -> np.ndarray:
    """Return the rows of one topic in all segments, without superseded ones.

    Args:
        files: for each file its rows, with the field `ns`.
        first_steps: as of `begins`.
        period: nanoseconds of a time step.
        with_last: keep the rows of the very step at which the next segment begins: an episode may
            end with the states of that step.
    """
    kept = []
    for rows, begin, end in zip(files, first_steps, ends(first_steps), strict=True):
        steps = steps_of(rows, period)
        here = (steps >= begin) & (steps < end + with_last)
        kept.append(rows[here])
    return np.concatenate(kept)


def steps_of(rows: np.ndarray, period: int) -> np.ndarray:
    """Return the time steps of rows with the field `ns`."""
    return np.asarray((rows["ns"] + period // 2) // period)
