# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages sorted by topic and time step, with whatever is odd about them."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.log.bags.reader import Bag, open_bag
from sparse_coord_ros.log.runlog import timeline
from sparse_coord_ros.log.runlog.attached import RecordedTables, read_tables
from sparse_coord_ros.log.runlog.bag_run import BagRun, check_bag_run, find_run
from sparse_coord_ros.log.runlog.columns import (
    OFTEN,
    Columns,
    Forms,
    Only,
    Reading,
    no_rows,
)
from sparse_coord_ros.log.runlog.dialogue import Request, put_together
from sparse_coord_ros.log.runlog.difference import MISSING, NO_REQUEST, Difference
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import OVER, RunState, messages
from sparse_coord_ros.protocol.wire.events import event_form
from sparse_coord_ros.protocol.wire.frame import Frame
from sparse_coord_ros.protocol.wire.occupancy import OccupancyData
from sparse_coord_ros.protocol.wire.status import RunStatus, read_status, values_of

THE_CLOCK = wire.CLOCK.name
OF_ROBOT = (wire.LOCAL_STATE, wire.REWARD, wire.ACTION, wire.PERCEPT)
"""Topics of which each robot has one message a time step, at most."""


class Track(NamedTuple):
    """The messages of one topic that has one message a time step.

    Attributes:
        step: their time steps, ascending, shape (n,).
        rows: what they say, shape (n,).
        repeats: time steps of those that said the same once more, one entry each.
        others: rows of those that said something else, by time step.
    """

    step: np.ndarray
    rows: np.ndarray
    repeats: np.ndarray
    others: Mapping[int, list[Any]] = MappingProxyType({})


OF_NO_RUN = RunStatus("none", "", 0, 0)
"""In place of a status that names no run: every world's does."""


def _said(message: Any) -> RunStatus:
    """Return what a status says; ValueError where it names a run and lacks another value."""
    return read_status(message) if "run" in values_of(message) else OF_NO_RUN


class Tracks:
    """A bag's messages of a run, sorted; without its attachments, which `add_tables` reads.

    Args:
        bag: the bag, or a part of one.
        found: its run.
        only: the topics to read, the others seem to have no messages; None: all but `ROSOUT`.

    Attributes:
        bag: the bag.
        run: the run.
        prefix: what the names of its topics begin with.
        names: the robots.
        clock_topic: the full name of the clock's.
        forms: the run's topics by their full names, and how their messages are read.
        states, rewards, actions, percepts: of each robot. Rows of states have `xy`; of rewards and
            actions `numbers`, in the order of their labels; of percepts `count` positions
            `places`, the own one first.
        clock: the steps of the clock.
        maps: time steps, in the order of the log.
        markers: the same, with the robots' positions `places`; none, where their stamps are no
            time steps.
        coordination_maps: of each robot, with the grid's `data`.
        statuses: of the world, in the order of the log.
        untold: the world does not say how the run ended: it was killed, or the recorder stopped
            before that. Where only a part is read it is False.
        requests: the dialogue.
        rosout: what nodes logged, decoded, where it was asked for.
        tables: of each attachment.
        stalls: where the recorder stood still.
        rollbacks: where the run went back to a checkpoint; what they superseded is left out.
        gaps: what is not in the log, but for its end; in no order.
        problems: what is odd.
        suspects: messages beside those of the run, each of which may be a stranger's.
    """

    def __init__(self, bag: Bag, found: BagRun, only: Only = None) -> None:
        self.bag = bag
        self.run = found.run
        self.prefix = found.prefix
        self.names = tuple(robot.name for robot in self.run.scenario.robots)
        self.clock_topic = bag.clock or f"/{wire.CLOCK.name}"
        self.tables: list[RecordedTables] = []
        self.forms = self._forms()
        forms = dict(self.forms)
        if only is not None:
            forms[wire.ROSOUT.name] = wire.ROSOUT, lambda message: message
        self._period = Frame(self.run).period
        self._backs = timeline.rollbacks(bag)
        self.stalls = timeline.stalls(bag)
        begins = {back.file: (back.first - 1) * self._period for back in self._backs}
        columns = Columns(bag, forms, only, self._period, begins)
        self.problems = columns.problems
        self.suspects = columns.suspects
        self._files = columns.rows
        robots = range(len(self.names))
        self.clock = self._track(wire.CLOCK)
        self.maps = self._several(wire.MAP)[0]
        self.markers = self._markers()
        of_robots = {
            topic: [self._track(topic, k) for k in robots] for topic in OF_ROBOT
        }
        self.states, self.rewards, self.actions, self.percepts = of_robots.values()
        self._find_gaps(columns.jumps)
        self._strays(of_robots)
        for step in self.clock.repeats.tolist():
            self.problems.append(self.odd(step, None, THE_CLOCK, "twice", "once"))
        self.coordination_maps = [
            self._several(wire.COORDINATION_MAP, k) for k in robots
        ]
        said = list(self._own_statuses())
        self.statuses = list(self._statuses(said))
        ended = bool(said) and said[-1].state in OVER
        self.untold = only is None and not bag.part and not ended
        self.requests: list[Request] = []
        self._dialogue()
        logged = [
            rows[wire.ROSOUT.name] for rows in self._files if wire.ROSOUT.name in rows
        ]
        self.rosout: list[Any] = [
            message for rows in logged for message in rows.tolist()
        ]

    def _forms(self) -> Forms:
        run = self.run
        frame = Frame(self.run)
        of_team: dict[wire.Topic, Reading] = {
            wire.CLOCK: messages.CLOCK_FORM,
            wire.MAP: messages.grid_form(frame, OccupancyData(frame).map),
            wire.MARKERS: messages.markers_form(frame, run.scenario),
            wire.STATUS: _said,
        }
        of_robot: dict[wire.Topic, Reading] = {
            wire.LOCAL_STATE: messages.POSE_FORM,
            wire.REWARD: messages.REFEREED_FORM
            if run.scenario.referee
            else messages.REWARD_FORM,
            wire.ACTION: messages.ACTION_FORM,
            wire.PERCEPT: messages.percept_form(len(self.names)),
            wire.COORDINATION_MAP: messages.grid_form(frame),
            wire.SERVICE_EVENTS: event_form(self.names),
        }
        found = {self.topic(topic): (topic, form) for topic, form in of_team.items()}
        for k in range(len(self.names)):
            found |= {
                self.topic(topic, k): (topic, form) for topic, form in of_robot.items()
            }
        return found

    def _markers(self) -> tuple[np.ndarray, np.ndarray]:
        """Return time steps and rows of the markers; of those that tell no time step: none."""
        if self.run.markers_tell_steps:
            return self._several(wire.MARKERS)
        odd = f"topic {self.topic(wire.MARKERS)}"
        self.suspects = [one for one in self.suspects if one.quantity != odd]
        return np.empty(0, dtype=np.int64), no_rows(
            self.forms[self.topic(wire.MARKERS)][1]
        )

    @property
    def lossy(self) -> bool:
        """Whether a part of the bag may be lost, or never came."""
        return self._cut or bool(self.bag.gaps or self.gaps or self.stalls)

    @property
    def broken_off(self) -> bool:
        """Whether the end of the run is not in the bag."""
        return self._cut or self.untold

    @property
    def _cut(self) -> bool:
        """Whether the end of the bag is lost."""
        bag = self.bag
        steps = [track.step[-1] for track in self.states if len(track.step)]
        newest = int(max(steps, default=0)) * self._period
        cut = any(gap.last_ns is None or gap.last_ns > newest for gap in bag.gaps)
        return cut or not bag.finished or bag.recovered is not None

    def of(self, k: int) -> tuple[Track, Track, Track, Track]:
        """Return one robot's tracks: states, rewards, actions, percepts."""
        return self.states[k], self.rewards[k], self.actions[k], self.percepts[k]

    def odd(self, step: int | None, robot: int | None, *words: str) -> Difference:
        """Return something odd: `words` are the quantity, and what is logged and computed."""
        return Difference(step, None if robot is None else self.names[robot], *words)

    def topic(self, topic: wire.Topic, robot: int | None = None) -> str:
        """Return a topic's full name."""
        if topic is wire.CLOCK:
            return self.clock_topic
        return self.prefix + (
            topic.name if robot is None else topic.of(self.names[robot])
        )

    def add_tables(self) -> None:
        """Read the attached tables."""
        self.tables, odd = read_tables(self.bag, self.run, self.rollbacks)
        self.problems += odd

    def _of(self, topic: wire.Topic, k: int | None = None) -> list[np.ndarray]:
        """Return the rows of a topic, of each file."""
        return [rows[self.topic(topic, k)] for rows in self._files]

    def _find_gaps(self, jumps: Sequence[timeline.Jump]) -> None:
        clocks = [
            timeline.steps_of(rows, self._period) for rows in self._of(wire.CLOCK)
        ]
        said = [
            one.step
            for rows in self._of(wire.STATUS)
            for one in rows
            if one is not OF_NO_RUN
        ]
        end = (said or [0])[-1]
        heard = [self._heard_from(place) for place in range(len(clocks))]
        self.gaps, self.rollbacks = timeline.gaps(
            self.bag, clocks, heard, self._backs, end
        )
        if self.lossy:
            often = {name for name, (topic, _) in self.forms.items() if topic in OFTEN}
            some = [jump for jump in jumps if jump.topic in often]
            self.gaps = timeline.lost(some, self._period, self.gaps)
        else:
            self.problems += [jump.odd for jump in jumps]

    def _heard_from(self, place: int) -> int:
        """Return from which time step on a file holds the actions of all robots it rewards."""
        heard = 0
        for k in range(len(self.names)):
            acted = timeline.steps_of(self._of(wire.ACTION, k)[place], self._period)
            rewarded = timeline.steps_of(self._of(wire.REWARD, k)[place], self._period)
            if len(acted) and len(rewarded) and rewarded.min() < acted.min():
                heard = max(heard, int(acted.min()))
        return heard

    def _dialogue(self) -> None:
        """Put the dialogue together, of each time line by itself: who comes back counts anew."""
        of_robots = [self._of(wire.SERVICE_EVENTS, k) for k in range(len(self.names))]
        cuts = [0, *(back.file for back in self.rollbacks), len(self._files)]
        for back, (begin, end) in zip(
            [None, *self.rollbacks], pairwise(cuts), strict=True
        ):
            if begin < end:
                self._time_line(
                    [np.concatenate(files[begin:end]) for files in of_robots], back
                )
        self.requests.sort(key=lambda one: (one.step, one.asker))

    def _time_line(
        self, events: list[np.ndarray], back: timeline.Rollback | None
    ) -> None:
        """Put the dialogue since a roll-back together, up to where the run went back to next."""
        newest = max(track.step.max(initial=0) for track in (self.clock, *self.states))
        later = self.rollbacks[0 if back is None else self.rollbacks.index(back) + 1 :]
        limit = min((one.first for one in later), default=np.inf)
        requests, problems, others = put_together(events, self.names, self._period)
        self.requests += [
            one for one in requests if one.step < limit and not _stale(one, back)
        ]
        self.suspects += [one for one in others if (one.step or 0) < limit]
        # Questions that were under way when the run went back are answered from then, or from
        # the checkpoint by who has gone back already, without a request here.
        for one in problems:
            step = one.step or 0
            unasked = one.logged == NO_REQUEST
            if unasked and step > newest:
                self.suspects.append(one)
            elif step < limit and not (unasked and _under_way(step, back)):
                self.problems.append(one)

    def _rows(self, topic: wire.Topic, k: int | None) -> tuple[np.ndarray, np.ndarray]:
        """Return the time steps of a topic's rows that hold, and the rows."""
        told = self._of(topic, k), self._backs, self._period
        rows = timeline.kept(*told, checkpoints=topic is wire.COORDINATION_MAP)
        steps = timeline.steps_of(rows, self._period)
        due = steps * self._period
        right = (rows["ns"] == due) & (rows["ns"] >= 0)
        for place in np.flatnonzero(~right).tolist():
            ns = int(rows["ns"][place])
            step = int(steps[place])
            of = (step, f"{due[place]} ns") if ns >= 0 else (None, "0 or later")
            self.suspects.append(
                self.odd(of[0], k, f"{topic.name} stamp", f"{ns} ns", of[1])
            )
        return steps[right], rows[right]

    def _track(self, topic: wire.Topic, k: int | None = None) -> Track:
        """Return rows of which there should be one a time step."""
        steps, rows = self._rows(topic, k)
        ordered = in_order(steps, each_once=True)
        newest = np.maximum.accumulate(
            np.concatenate([[-1], np.where(ordered, steps, -1)])
        )
        by_step = np.lexsort((~ordered, steps))
        found, at = np.unique(steps[by_step], return_index=True)
        first = by_step[at]
        ordered &= np.isin(np.arange(len(steps)), first)
        repeats: list[int] = []
        others: dict[int, list[Any]] = {}
        for place in np.flatnonzero(~ordered).tolist():
            step = int(steps[place])
            last = int(newest[place])
            known_at = int(first[np.searchsorted(found, step)])
            if known_at == place:
                words = (f"after that of step {last}", "before it")
                where = self.problems
            elif rows[place].tobytes() != rows[known_at].tobytes():
                others.setdefault(step, []).append(rows[place])
                two = (rows[known_at].tolist()[1:], rows[place].tolist()[1:])
                words = (f"twice, with {two[0]} and {two[1]}", "once")
                where = self.suspects
            elif step < last:
                words = (f"again after that of step {last}", "once")
                where = self.suspects
            else:
                repeats.append(step)
                continue
            where.append(self.odd(step, k, topic.name, *words))
        return Track(found, rows[first], np.array(repeats, dtype=np.int64), others)

    def _strays(self, of_robots: Mapping[wire.Topic, list[Track]]) -> None:
        """Leave out messages of a time step of which nobody else says anything, or that is none.

        Steps begin with 1, and go on. In the last ones of a log, and where a part is lost, it is
        no wonder that something is missing.
        """
        heard = [self.clock, *self.states]
        steps, votes = np.unique(
            np.concatenate([t.step for t in heard]), return_counts=True
        )
        newest = steps[votes == len(heard)].max(initial=0)
        of_run = (votes > 1) | (steps >= newest)
        of_run &= (steps <= newest + EPISODE_GAP) & (steps > 0)
        if self.lossy or not all(len(track.step) for track in heard):
            return
        self.clock = self._only(steps[of_run], self.clock, wire.CLOCK)
        for topic, tracks in of_robots.items():
            for k, track in enumerate(tracks):
                tracks[k] = self._only(steps[of_run], track, topic, k)

    def _only(
        self, steps: np.ndarray, track: Track, topic: wire.Topic, k: int | None = None
    ) -> Track:
        """Return a track's messages of some time steps; the others may be a stranger's."""
        mine = np.isin(track.step, steps)
        for step in track.step[~mine].tolist():
            words = "there", "none: no time step of the run"
            self.suspects.append(self.odd(step, k, topic.name, *words))
            self.problems = [o for o in self.problems if o[:3:2] != (step, topic.name)]
        repeats = track.repeats[np.isin(track.repeats, steps)]
        return track._replace(
            step=track.step[mine], rows=track.rows[mine], repeats=repeats
        )

    def _several(
        self, topic: wire.Topic, k: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return time steps and rows, of which there may be several a time step."""
        steps, rows = self._rows(topic, k)
        for place in np.flatnonzero(np.diff(steps) < 0).tolist():
            words = f"after that of step {steps[place]}", "before it"
            self.problems.append(self.odd(int(steps[place + 1]), k, topic.name, *words))
        return steps, rows

    def _own_statuses(self) -> Iterator[RunStatus]:
        """Yield the statuses of the run that hold; note those of others."""
        run = self.run
        for n, rows in enumerate(self._of(wire.STATUS)):
            for one in rows:
                if one is OF_NO_RUN or (one.run and run.id and one.run != run.id):
                    self.suspects.append(
                        _odd(one, f"of run {one.run!r}", run.id or "this one")
                    )
                # A world that is yet to go back does not know where the team is.
                elif (
                    timeline.holds(n, one.step, self._backs)
                    and one.state != RunState.RESUMING
                ):
                    yield one

    def _statuses(self, found: Sequence[RunStatus]) -> Iterator[RunStatus]:
        """Yield the world's statuses, and note what is odd about them."""
        ordered = in_order(
            np.array([one.step for one in found], dtype=np.int64)
        ).tolist()
        over = False
        for one, right in zip(found, ordered, strict=True):
            state = one.state
            ended = one.state == RunState.FINISHED
            if not right or (ended and one.transitions < self.run.scenario.steps):
                what = f"{state!r} after {one.transitions} transitions"
                self.suspects.append(_odd(one, what, "another step or state"))
                continue
            if state not in list(RunState):
                self.problems.append(_odd(one, repr(state[:40]), " or ".join(RunState)))
            if over and not ended:
                self.problems.append(
                    _odd(one, f"{state!r} after the end", "nothing after it")
                )
            over = ended
            yield one


def _odd(said: RunStatus, *words: str) -> Difference:
    return Difference(said.step, None, wire.STATUS.name, *words)


def read_tracks(path: Path) -> Tracks:
    """Read a bag; arguments and errors as of `read_run`."""
    bag = open_bag(path)
    found = find_run(bag)
    tracks = Tracks(bag, found)
    missing = [f"topic {name}" for name in tracks.forms if name not in bag.topics]
    tracks.problems += check_bag_run(bag, found)
    tracks.problems += [
        tracks.odd(None, None, n, MISSING, "a topic of this run") for n in missing
    ]
    tracks.add_tables()
    return tracks


def _under_way(step: int, back: timeline.Rollback | None) -> bool:
    """Whether an answer of a time step may be to a question of before a roll-back."""
    return back is not None and (step >= back.until - 1 or step <= back.first)


def _stale(request: Request, back: timeline.Rollback | None) -> bool:
    """Whether it was asked before a roll-back, and answered by who had gone back already.

    A peer that is asked in time is one time step behind at most.
    """
    if back is None or request.answer is None:
        return False
    return bool(request.answer[0] <= back.first < request.step - 1)


def in_order(steps: np.ndarray, *, each_once: bool = False) -> np.ndarray:
    """Return which of some time steps make up a longest sequence that never falls, bool.

    Args:
        steps: in the order of the log, shape (n,).
        each_once: where any falls, a step that comes again does not make the sequence longer.
    """
    if (np.diff(steps) >= 0).all():
        return np.ones(len(steps), dtype=bool)
    then = np.full(len(steps), -1, dtype=np.int64)
    places: list[
        int
    ] = []  # where sequences of 1, 2, ... steps begin that begin as late as can be
    bisect = bisect_left if each_once else bisect_right
    for place in range(len(steps) - 1, -1, -1):
        at = bisect(places, -int(steps[place]), key=lambda begin: -int(steps[begin]))
        then[place] = places[at - 1] if at else -1
        places[at : at + 1] = [place]
    right = np.zeros(len(steps), dtype=bool)
    place = places[-1]
    while place >= 0:
        right[place] = True
        place = int(then[place])
    return right
