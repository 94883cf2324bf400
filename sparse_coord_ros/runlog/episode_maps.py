# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Map, markers and coordination maps: what they must show, from the scenario and the log.

They come again at every start of an episode; markers and coordination maps at other times too
(reports by the wall clock).
"""

from collections.abc import Collection, Iterator, Sequence

from sparse_coord_ros.core.agent import Tables
from sparse_coord_ros.core.frame import Frame
from sparse_coord_ros.core.occupancy import OccupancyData
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.rerun import Handled

EARLIER = 3
"""A report's coordination map is of one of the last states that the robot has worked off: it may
wait for a reward."""


def check_world_maps(
    log: RunLog, starts: Sequence[int], end: int, last: int | None
) -> Iterator[Difference]:
    """Yield in what map and markers differ from what they must be.

    Args:
        log: the log.
        starts: the first time steps of the episodes, as computed.
        end: the last time step that was computed.
        last: the last time step to check; None: all.
    """
    maps = [step for step, _ in log.tracks.maps]
    shown = [step for step, _ in log.tracks.markers]
    for kind, steps in (("map", set(maps)), ("markers", set(shown))):
        for step in _due(starts, steps, last):
            if step not in steps:
                yield Difference(step, None, kind, MISSING, "one as the episode begins")
    begin = {0, *starts}
    for before, step in zip([None, *maps], maps, strict=False):
        if step == before:
            yield Difference(step, None, "map", "twice", "once")
        elif step not in begin and step <= end:
            yield Difference(step, None, "map", "there", "none: no episode begins")
    for step, places in log.tracks.markers:
        cells = [track.first.get(step) for track in log.tracks.states]
        if (last is None or step <= last) and None not in cells and list(places) != cells:
            yield Difference(step, None, "markers", f"robots at {places}", f"at {tuple(cells)}")


def _due(starts: Sequence[int], found: Collection[int], last: int | None) -> list[int]:
    """Return the starts of episodes that must be shown.

    Where the log breaks off, only those before the last one that was shown.
    """
    if last is None:
        return list(starts)
    end = min(last, max(found, default=0))
    return [step for step in starts if step <= end]


class CoordinationMaps:
    """Compares one robot's coordination maps with its tables, as they are computed again.

    Args:
        log: the log.
        k: the robot's number.
        left_out: time steps that the world made without it.
        last: the last time step to check; None: all.

    Attributes:
        missing: those that ought to have come when an episode began, as far as it was followed.
    """

    def __init__(self, log: RunLog, k: int, left_out: frozenset[int], last: int | None) -> None:
        self._grids = OccupancyData(Frame(log.run))
        self._name, self._last, self._left_out = log.names[k], last, left_out
        self._actions = log.tracks.actions[k].first
        self._said: dict[int, list[bytes]] = {}
        for step, data in log.tracks.coordination_maps[k]:
            self._said.setdefault(step, []).append(data)
        states = sorted(log.tracks.states[k].first)
        starts = [b for a, b in zip([-1, *states], states, strict=False) if b != a + 1]
        shown = set(_due(starts, self._said, last))
        self._due = {t for t in shown if t in self._actions and t not in left_out}
        place = {step: i for i, step in enumerate(states)}
        self._wanted = set(self._due)
        for step, maps in self._said.items():
            if step in place and (step not in self._due or len(maps) > 1):
                self._wanted.update(states[max(place[step] - EARLIER + 1, 0) : place[step] + 1])
        self._strange = sorted(step for step in self._said if step and step not in place)
        self.restart()

    def restart(self) -> None:
        """Begin again from the first state."""
        self._count = 0
        self.missing: list[Difference] = []
        self._recent: list[tuple[int, bytes]] = []

    def begun(self, tables: Tables) -> Difference | None:
        """Compare those from before the first state."""
        if self._last is None and self._strange:
            return self._odd(self._strange[0], "there", "none: the robot has no such state")
        due = self._grids.coordination(tables)
        odd = [data for data in self._said.get(0, ()) if data != due]
        return self._odd(0, self._grids.cells(odd[0]), self._grids.cells(due)) if odd else None

    def handled(self, event: Handled) -> Difference | None:
        """Compare those of a time step; all that happened before it is learned.

        One that is missing is noted only: what the robot does next is worth looking at.
        """
        step = event.step
        self._count += 1
        if step not in self._wanted:
            return None
        now = self._grids.coordination(event.tables)
        self._recent = [*self._recent[1 - EARLIER :], (self._count, now)]
        maps = self._said.get(step, [])
        if step in self._due and not maps:
            self.missing.append(self._odd(step, MISSING, self._grids.cells(now)))
        elif step in self._due and now not in maps:
            return self._odd(step, self._grids.cells(maps[0]), self._grids.cells(now))
        if self._left_out:  # what it has learned when it reports, the log does not say
            return None
        known = [data for count, data in self._recent if self._count - count < EARLIER]
        odd = [data for data in maps if data not in known]
        return self._odd(step, self._grids.cells(odd[0]), self._grids.cells(now)) if odd else None

    def _odd(self, step: int, logged: str, computed: str) -> Difference:
        return Difference(step, self._name, "coordination_map", logged, computed)
