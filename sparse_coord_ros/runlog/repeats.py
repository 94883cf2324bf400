# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether what came twice is what the lock step says again after a silence."""

from collections.abc import Iterator

from sparse_coord_ros.runlog.difference import Difference
from sparse_coord_ros.runlog.log import RunLog


def check_repeats(log: RunLog, last: int | None) -> Iterator[Difference]:
    """Yield what came twice without a reason.

    The world repeats state and last reward together, to a robot whose action it misses, when
    everybody has the state; only then the robot repeats its action. A percept is never repeated.

    Args:
        log: the log.
        last: the last time step to check; None: all.
    """
    for k, name in enumerate(log.names):
        states, rewards, actions, percepts = log.tracks.of(k)
        steps = {*states.repeats, *actions.repeats, *percepts.repeats}
        steps |= {step + 1 for step in rewards.repeats}
        for step in sorted(steps):
            if last is not None and step > last:
                break
            again = states.repeats.get(step, [])
            rewarded = len(rewards.repeats.get(step - 1, ()))
            said = len(actions.repeats.get(step, ()))
            if step in percepts.repeats:
                yield Difference(step, name, "percept", "twice", "once")
            if said > len(again):
                yield Difference(step, name, "action", "twice", "once: its state came once")
            due = len(again) if step - 1 in rewards.first and step in states.first else 0
            if rewarded > due:
                yield Difference(step - 1, name, "reward", "twice", "once")
            elif rewarded < due:
                yield Difference(step, name, "local_state", "twice", "once: its reward came once")
            elif again and not _after_all(log, step, again[0]):
                yield Difference(step, name, "local_state", "twice", "once")
            elif again and not said and actions.place.get(step, again[0]) < again[0]:
                yield Difference(step, name, "local_state", "twice", "once: it had acted")


def repeat_count(log: RunLog) -> int:
    """Return how many messages came again."""
    tracks = [track for k in range(len(log.names)) for track in log.tracks.of(k)]
    return sum(len(places) for track in tracks for places in track.repeats.values())


def _after_all(log: RunLog, step: int, place: int) -> bool:
    """Whether a repeat came when every robot had its state of the step."""
    return all(track.place.get(step, 0) < place for track in log.tracks.states)
