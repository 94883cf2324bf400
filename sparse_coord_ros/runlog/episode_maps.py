# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Map and markers: they come as each episode begins, markers at other times too."""

from collections.abc import Iterator

import numpy as np

from sparse_coord_ros.bags.metadata import SPLIT
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.log import RunLog, cell_numbers
from sparse_coord_ros.wire import MAP, MARKERS
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
    for kind, steps in ((MAP.name, maps), (MARKERS.name, shown)):
        # Where the log breaks off, only those before the last one that was shown.
        due = starts if last is None else starts[starts <= min(last, steps.max(initial=0))]
        for step in due[~np.isin(due, steps)].tolist():
            yield Difference(step, None, kind, MISSING, "one as the episode begins")
    # A recorder that was started again gets the last one a second time.
    whys = [(file.continued or {}).get("why", SPLIT) for file in log.bag.files]
    again = sum(why != SPLIT for why in whys)
    for step in maps[1:][np.diff(maps) == 0].tolist()[again:]:
        yield Difference(step, None, MAP.name, "twice", "once")
    until = end if last is None else min(end, last)
    for step in maps[~np.isin(maps, [0, *starts.tolist()]) & (maps <= until)].tolist():
        yield Difference(step, None, MAP.name, "there", "none: no episode begins")
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
        yield Difference(int(shown[place]), None, MARKERS.name, logged, due_cells)
