# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What comes more than once: map and markers with each episode, messages again after a silence."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.bags.metadata import SPLIT
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.log import RunLog, cell_numbers
from sparse_coord_ros.wire.frame import Frame


def check_world_maps(
    log: RunLog, starts: np.ndarray, end: int, last: int | None
) -> Iterator[Difference]:
    """Yield in what map and markers differ from what they must be.

    Args:
        log: the log.
        starts: the first time steps of the episodes, as computed.
        end: the last time step that was computed.
        last: the last time step to check; None: all.
    """
    maps, (shown, rows) = log.tracks.maps, log.tracks.markers
    for kind, steps in ((wire.MAP.name, maps), (wire.MARKERS.name, shown)):
        # Where the log breaks off, only those before the last one that was shown.
        due = starts if last is None else starts[starts <= min(last, steps.max(initial=0))]
        for step in due[~np.isin(due, steps)].tolist():
            yield Difference(step, None, kind, MISSING, "one as the episode begins")
    # A recorder that was started again gets the last one a second time.
    whys = [(file.continued or {}).get("why", SPLIT) for file in log.bag.files]
    again = sum(why != SPLIT for why in whys)
    for step in maps[1:][np.diff(maps) == 0].tolist()[again:]:
        yield Difference(step, None, wire.MAP.name, "twice", "once")
    until = end if last is None else min(end, last)
    for step in maps[~np.isin(maps, [0, *starts.tolist()]) & (maps <= until)].tolist():
        yield Difference(step, None, wire.MAP.name, "there", "none: no episode begins")
    row = np.minimum(np.searchsorted(log.step, shown), len(log.step) - 1)
    if not len(log.step):
        return
    stated = (log.step[row] == shown) & ~np.isnan(log.position[row]).any(axis=(1, 2))
    stated &= True if last is None else shown <= last
    wrong = stated & (rows["places"] != log.position[row]).any(axis=(1, 2))
    for place in np.flatnonzero(wrong).tolist():
        said, _ = cell_numbers(Frame(log.run), rows["places"][place])
        logged = f"robots in cells {said.tolist()}"
        due_cells = f"in {log.cells[row[place]].tolist()}"
        yield Difference(int(shown[place]), None, wire.MARKERS.name, logged, due_cells)


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
                yield Difference(step, name, wire.PERCEPT.name, "twice", "once")
            if actions[step] > states[step]:
                yield Difference(
                    step, name, wire.ACTION.name, "twice", "once: its state came once"
                )
            if rewards[step - 1] > due:
                yield Difference(step - 1, name, wire.REWARD.name, "twice", "once")
            elif rewards[step - 1] < due:
                yield Difference(
                    step, name, wire.LOCAL_STATE.name, "twice", "once: its reward came once"
                )


def repeat_count(log: RunLog) -> int:
    """Return how many messages came again."""
    return sum(len(track.repeats) for k in range(len(log.names)) for track in log.tracks.of(k))
