# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether each percept is what the perception model draws, and what the dialogue says."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from sparse_coord_ros.core.frame import SECOND, Frame
from sparse_coord_ros.core.perception import percept_probabilities
from sparse_coord_ros.core.streams import PERCEPT, Stream
from sparse_coord_ros.runlog.dialogue import EVENT_NAMES, RETURNED, SENT, Request
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.log import RunLog

ANSWERED, REFUSED, LATE = "answered", "refused", "late"
UNSURE = "refused or late"
"""By the log it may have been either: the answer came about when the deadline passed."""
SLOW = 0.9
"""Share of the deadline from which on an answer may have come too late."""


class Percept(NamedTuple):
    """How one COORDINATE ended: ANSWERED, REFUSED, LATE or UNSURE."""

    robot: int
    step: int
    outcome: str


def check_percepts(log: RunLog, last: int | None) -> tuple[list[Percept], list[Difference]]:
    """Return how every COORDINATE ended, and the differences of percepts and dialogue.

    Args:
        log: the log.
        last: the last time step to check; None: all.
    """
    judge = _Judge(log)
    ended, differences = [], []
    for k, name in enumerate(log.names):
        actions, percepts = log.tracks.actions[k].first, log.tracks.percepts[k].first
        asked = {t for t, numbers in actions.items() if numbers[2] != 0.0}
        for step in sorted(asked | set(percepts)):
            if last is not None and step > last:
                break
            if step not in asked:
                said = "a percept" if step in actions else MISSING
                quantity, due = (
                    ("percept", "none") if step in actions else ("action", "COORDINATE")
                )
                differences.append(Difference(step, name, quantity, said, due))
            elif step not in percepts:
                differences.append(Difference(step, name, "percept", MISSING, "one"))
            else:
                outcome, found = judge.percept(k, step)
                ended.append(Percept(k, step, outcome))
                differences += found
    for request in log.requests:
        if last is None or request.step <= last:
            differences += judge.request(request)
            states, _, actions, _ = log.tracks.of(request.asker)
            if request.step not in actions.first and states.last > request.step:
                ended.append(Percept(request.asker, request.step, LATE))
    return list(dict.fromkeys(ended)), differences


class _Judge:
    def __init__(self, log: RunLog) -> None:
        self.log, self.frame = log, Frame(log.run)
        scenario = log.run.scenario
        self.all = scenario.peers == "all"
        self.draws = [Stream(log.run.seed, k, PERCEPT) for k in range(len(log.names))]
        self.probabilities = percept_probabilities(scenario.perception, scenario.map).tolist()
        self.answers: dict[tuple[int, int, int], Request] = {}
        for request in log.requests:  # of several of a step the last one counts
            self.answers[request.asker, request.peer, request.step] = request
        self.sent: dict[tuple[int, int], int] = {}
        for request in log.requests:
            if SENT in request.wall_ns:
                key = request.asker, request.step
                self.sent[key] = min(
                    request.wall_ns[SENT], self.sent.get(key, request.wall_ns[SENT])
                )
        self.silent: set[tuple[int, int]] = set()

    def percept(self, k: int, step: int) -> tuple[str, list[Difference]]:
        """Judge one percept; return how COORDINATE ended."""
        log = self.log
        name = log.names[k]
        places = log.tracks.percepts[k].first[step]
        own, *seen = [self.frame.cell(*place) for place in places] or [None]
        here = self._cell(k, step)
        if own != here or own is None or self.frame.centres[own] != places[0]:
            return REFUSED, [
                Difference(step, name, "percept own", f"{places[:1]}", f"cell {here}")
            ]
        peers = self._peers(k, step)
        cells = [self._cell(peer, step) for peer in peers]
        if None in cells:
            return REFUSED, []  # the world's check names the missing state
        draw = self.draws[k].at(step)[0]
        visible = [draw < self.probabilities[here][cell] for cell in cells]
        expected = _words(cells) if peers and all(visible) else "refused"
        if seen:
            self.silent.difference_update([(k, peer) for peer in peers])
            exact = [self.frame.centres[cell] for cell in cells]
            if not all(visible) or list(places[1:]) != exact:
                return ANSWERED, [Difference(step, name, "percept", _words(seen), expected)]
            return ANSWERED, list(self._asked(k, step, peers, cells))
        if not peers or not all(visible):
            count = visible.index(False) + 1 if peers else 0
            said = [*cells[: count - 1], None] if count else []
            how = self._failed(k, step, peers) or REFUSED
            return how, list(self._asked(k, step, peers[:count], said))
        how = self._failed(k, step, peers)
        if how is not None:
            return how, []
        return LATE, [Difference(step, name, "percept", "failed", expected)]

    def _failed(self, k: int, step: int, peers: Sequence[int]) -> str | None:
        """Return how a COORDINATE failed by the dialogue; None: by that it did not.

        A peer that let a deadline pass is not waited for until it has answered again.
        """
        for peer in peers:
            request = self.answers.get((k, peer, step))
            was_silent = (k, peer) in self.silent
            self.silent.discard((k, peer))
            if request is None or request.answer is None:
                self.silent.add((k, peer))
                return LATE
            if request.answer[0] < step:
                return LATE
            slow = self._slow(request)
            if slow:
                self.silent.add((k, peer))
            if request.answer[0] > step or request.answer[1] is None:
                return UNSURE if slow or was_silent else REFUSED
            if slow or was_silent:
                return LATE
        return None

    def _slow(self, request: Request) -> bool:
        """Whether an answer may have come after the deadline."""
        sent = self.sent.get((request.asker, request.step))
        came = request.wall_ns.get(RETURNED)
        if sent is None or came is None:
            return True
        return came - sent >= SLOW * self.log.run.percept_timeout * SECOND

    def _asked(self, k: int, step: int, peers: Sequence[int], said: Sequence) -> Iterator:
        """Compare the dialogue with the answers that there must have been."""
        for peer, cell in zip(peers, said, strict=True):
            quantity = f"dialogue with {self.log.names[peer]}"
            where = None if cell is None else self.frame.centres[cell]
            due = "a refusal" if where is None else f"the answer {where}"
            request = self.answers.get((k, peer, step))
            if request is None:
                yield Difference(step, self.log.names[k], quantity, MISSING, due)
            elif request.answer is None:
                if cell is not None:
                    logged = f"{EVENT_NAMES[RETURNED]} {MISSING}"
                    yield Difference(step, self.log.names[k], quantity, logged, due)
            elif request.answer[0] < step and cell is None:
                continue  # it waited for a peer that was behind: late
            elif request.answer[0] <= step and request.answer != (step, where):
                yield Difference(step, self.log.names[k], quantity, f"{request.answer}", due)

    def request(self, request: Request) -> Iterator[Difference]:
        """Judge whether the four sides of an answered request are there and agree."""
        log = self.log
        quantity = f"dialogue with {log.names[request.peer]}"
        who = log.names[request.asker]
        latest = self.answers[request.asker, request.peer, request.step] is request
        complete = RETURNED in request.wall_ns or (latest and self._was_answered(request))
        for kind, event in enumerate(EVENT_NAMES):
            if complete and kind not in request.wall_ns:
                yield Difference(request.step, who, f"{quantity}, {event}", MISSING, "one")
        if request.answer is not None and request.said not in (None, request.answer):
            said, heard = f"{request.said}", f"{request.answer}"
            yield Difference(request.step, who, quantity, said, f"{heard}, as it was received")
        here = self._cell(request.asker, request.step)
        if here is not None and request.position != self.frame.centres[here]:
            logged = f"asked from {request.position}"
            yield Difference(request.step, who, quantity, logged, f"{self.frame.centres[here]}")

    def _was_answered(self, request: Request) -> bool:
        """Whether the peer answered in a run in which nobody was ever late."""
        late = any(status.timeouts for status in self.log.tracks.statuses)
        return request.said is not None and not late

    def _peers(self, k: int, step: int) -> list[int]:
        if self.all:
            return [peer for peer in range(len(self.log.names)) if peer != k]
        peer = int(self.log.tracks.actions[k].first[step][3]) - 1
        return [peer] if 0 <= peer < len(self.log.names) and peer != k else []

    def _cell(self, k: int, step: int) -> int | None:
        position = self.log.tracks.states[k].first.get(step)
        return None if position is None else self.frame.cell(*position)


def _words(cells: Sequence[int | None]) -> str:
    return ", ".join("no free cell" if cell is None else f"cell {cell}" for cell in cells)
