# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Check of percepts against the robots' states and the perception model's draws."""

from collections.abc import Iterator, Sequence

from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.log.runlog.difference import Difference, Finding, Undecided
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.log.runlog.replay import Trajectory
from sparse_coord_ros.protocol.wire import PERCEPT, REWARD, PerceptEnd


def percept_end(code: float) -> str:
    """Return the end of a percept in the words of `PerceptEnd`, from the number in the action."""
    end = PerceptEnd.from_number(code)
    return f"percept={code:g}" if end is None else end.words


class PerceptCheck:
    """Compares one robot's percepts with the states of the peers that it asks.

    Args:
        log: the log.
        k: the robot's number.
        trajectory: its actions in the log.
    """

    def __init__(self, log: RunLog, k: int, trajectory: Trajectory) -> None:
        percepts = log.series[PERCEPT, k]
        self._log = log
        self._k = k
        self._trajectory = trajectory
        self._percepts = Percepts(log.run.scenario, log.run.seed)
        self._rows = dict(zip(percepts.step.tolist(), percepts.rows, strict=True))
        self._rewarded = set(log.series[REWARD, k].step.tolist())

    def check(self, index: int) -> Iterator[Finding]:
        """Compare the percept of an action, by its place in the trajectory; or that it has none.

        All robots' states of its time step must be in the log.
        """
        log = self._log
        row = self._trajectory.row[index]
        step = int(self._trajectory.step[index])
        end = float(log.column(PERCEPT.name)[row, self._k])
        logged = self._rows.get(step)
        if not log.asked[row, self._k]:
            if logged is not None:
                yield self._difference(step, "a percept", "none")
            yield from self._ended(step, end, PerceptEnd.DID_NOT_ASK)
            return
        if logged is None:
            why = f"the percept of {log.names[self._k]} of time step {step} is not in the log"
            yield Undecided(step, why)
            return
        cells = log.cells[row].tolist()
        here, *seen = logged["places"].tolist()[: int(logged["count"])]
        cell = cells[self._k]
        if tuple(here) != log.frame.centres[cell]:
            yield self._difference(step, f"own position {tuple(here)}", f"cell {cell}")
        peers = self._trajectory.peers[index].tolist()
        if seen:
            yield from self._answered(step, seen, cells, peers)
            yield from self._ended(step, end, PerceptEnd.ANSWERED)
        elif not peers:
            yield from self._ended(step, end, PerceptEnd.NOBODY_TO_ASK)
        else:
            yield from self._ended(step, end, PerceptEnd.REFUSED, PerceptEnd.LATE)
            yield from self._refused(step, end, cells, peers)

    def _answered(
        self,
        step: int,
        seen: Sequence[Sequence[float]],
        cells: Sequence[int],
        peers: Sequence[int],
    ) -> Iterator[Finding]:
        """Check that a percept has the peers' cells, and succeeds by its draw."""
        frame = self._log.frame
        due = [cells[peer] for peer in peers]
        if [tuple(position) for position in seen] != [
            frame.centres[cell] for cell in due
        ]:
            perceived = [frame.cell(x, y) for x, y in seen]
            yield self._difference(step, _cells(perceived), _cells(due))
        if not self._succeeds(step, cells, peers):
            words = PerceptEnd.ANSWERED.words, PerceptEnd.REFUSED.words
            yield self._difference(step, *words)

    def _refused(
        self, step: int, end: float, cells: Sequence[int], peers: Sequence[int]
    ) -> Iterator[Finding]:
        """Check that a refused percept fails by its draw.

        A peer that has gone on without this robot refuses, too.
        """
        refused = end == PerceptEnd.REFUSED
        rewarded = step in self._rewarded
        if refused and rewarded and self._succeeds(step, cells, peers):
            words = PerceptEnd.REFUSED.words, PerceptEnd.ANSWERED.words
            yield self._difference(step, *words)

    def _succeeds(self, step: int, cells: Sequence[int], peers: Sequence[int]) -> bool:
        """Return whether the percept of all asked peers succeeds by the model's draw."""
        here = cells[self._k]
        sees = self._percepts.sees
        return all(sees(step, self._k, here, cells[peer]) for peer in peers)

    def _ended(self, step: int, end: float, *allowed: PerceptEnd) -> Iterator[Finding]:
        """Check that the logged end of a percept is an allowed one."""
        if end not in allowed:
            words = " or ".join(way.words for way in allowed)
            yield self._difference(step, percept_end(end), words)

    def _difference(self, step: int, *words: str) -> Finding:
        return Difference(step, self._log.names[self._k], PERCEPT.name, *words)


def _cells(cells: Sequence[int | None]) -> str:
    return ", ".join(
        "no free cell" if cell is None else f"cell {cell}" for cell in cells
    )
