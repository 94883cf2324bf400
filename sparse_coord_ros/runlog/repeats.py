# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether what came twice is what the lock step says again after a silence."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from sparse_coord_ros.runlog.difference import Difference
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.wire import ACTION, LOCAL_STATE, PERCEPT, REWARD


def check_repeats(log: RunLog, last: int | None) -> Iterator[Difference]:
    """Yield what came twice without a reason.

    The world repeats state and last reward together, to a robot whose action it misses; only then
    the robot repeats its action. A percept is never repeated.

    Args:
        log: the log.
        last: the last time step to check; None: all.
    """
    for k, name in enumerate(log.names):
        again = [Counter(track.repeats.tolist()) for track in log.tracks.of(k)]
        states, rewards, actions, percepts = again
        steps = {*states, *actions, *percepts} | {step + 1 for step in rewards}
        known_rewards = log.tracks.rewards[k]
        for step in sorted(steps):
            if last is not None and step > last:
                break
            due = states[step] if known_rewards.has(np.array([step - 1]))[0] else 0
            if step in percepts:
                yield Difference(step, name, PERCEPT.name, "twice", "once")
            if actions[step] > states[step]:
                yield Difference(step, name, ACTION.name, "twice", "once: its state came once")
            if rewards[step - 1] > due:
                yield Difference(step - 1, name, REWARD.name, "twice", "once")
            elif rewards[step - 1] < due:
                yield Difference(
                    step, name, LOCAL_STATE.name, "twice", "once: its reward came once"
                )


def repeat_count(log: RunLog) -> int:
    """Return how many messages came again."""
    return sum(len(track.repeats) for k in range(len(log.names)) for track in log.tracks.of(k))
