# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Computes a recorded run again and compares; the engine behind `sparse_coord verify`.

There are three results. A run is identical; it differs at a time step in a quantity; or it is
undecided from a time step on, for a reason. A run is undecided if a part of the log is lost, if
code may not be imported, if a robot or the world came back without a roll-back of the team, or if
a message is missing that an honest run may lack.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sparse_coord_ros.core.game.plugins import leaving_out
from sparse_coord_ros.log.runlog.agents import AgentCheck
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.log.runlog.difference import (
    MISSING,
    TWICE,
    Difference,
    Unknown,
)
from sparse_coord_ros.log.runlog.game_check import WorldCheck
from sparse_coord_ros.log.runlog.log import RunLog, read_run
from sparse_coord_ros.log.runlog.percepts import check_percepts
from sparse_coord_ros.log.runlog.replay import Interval, intervals, trajectory_of
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.status import (
    NO_ORDER,
    NO_ROLLBACK,
    read_progress,
    read_status,
)

FOREIGN = "foreign messages"
LEFT_OUT = "robots' steps that the world made without their action"
LOST_COPIES = "lost copies on "
REPEATS = "messages repeated after a silence"
RESETS = "episodes that began early (reset, or no robot left)"
UNLEARNED = "transitions from which a robot did not learn"
"""Names of the notes; a topic follows `LOST_COPIES`."""


@dataclass(frozen=True)
class Verification:
    """The result of `verify`.

    The run differs if there is a difference. Otherwise it is undecided if a part is unknown.
    Otherwise the run is identical.

    Attributes:
        log: the log.
        differences: in the order of time; for each robot's agent and the world only the first one,
            as all later ones follow from it.
        unknown: the parts that cannot be verified, in the order of time.
        notes: counts, by name, of irregularities that an honest run may have: foreign messages,
            lost copies of a topic, robots' steps without their action. They do not change the
            result.
        steps: number of the world's transitions that were computed again and agree.
        choices: number of actions that were computed again and agree.
        updates: number of updates of tables that were computed again.
        tables: number of recorded tables that were compared.
    """

    log: RunLog
    differences: tuple[Difference, ...]
    unknown: tuple[Unknown, ...]
    notes: Mapping[str, int]
    steps: int
    choices: int
    updates: int
    tables: int

    @property
    def same(self) -> bool:
        """True if the run is identical."""
        return not self.differences and not self.unknown

    @property
    def undecided(self) -> bool:
        """True if there is no difference, but a part is unknown."""
        return not self.differences and bool(self.unknown)

    @property
    def first(self) -> Difference | Unknown | None:
        """The first difference, else the first unknown part; None: the run is identical."""
        if self.differences:
            return self.differences[0]
        return self.unknown[0] if self.unknown else None


def verify(path: Path) -> Verification:
    """Compute a recorded run again from its seed and its log, and compare.

    Args:
        path: as in `read_run`.

    Raises:
        BagError: the bag cannot be read, contains no run, or has another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    log = read_run(path)
    comparison = _Comparison(log)
    for interval in intervals(log):
        comparison.compare(interval)
    differences = sorted(dict.fromkeys(comparison.differences), key=_rank)
    unknown = comparison.unknown
    since = _unknown_since(log, differences)
    if since is not None:
        before = [one for one in differences if not _may_follow(one, since)]
        if len(before) < len(differences):
            unknown.append(since)
        differences = before
    return Verification(
        log=log,
        differences=tuple(differences),
        unknown=tuple(sorted(dict.fromkeys(unknown), key=_first)),
        notes=comparison.notes(),
        steps=sum(world.transitions for world in comparison.worlds),
        choices=sum(agent.choices for agent in comparison.agents),
        updates=sum(agent.updates for agent in comparison.agents),
        tables=sum(agent.compared for agent in comparison.agents),
    )


def _rank(difference: Difference) -> tuple[int, int]:
    return difference.rank


def _first(unknown: Unknown) -> int:
    return unknown.first


class _Comparison:
    """Compares a log interval by interval, and collects the results.

    Args:
        log: the log.

    Attributes:
        differences: in any order.
        unknown: in any order.
        worlds: the world's check of each interval that is not lost.
        agents: the robots' checks, for one such interval after the other.
    """

    def __init__(self, log: RunLog) -> None:
        self.log = log
        self.differences: list[Difference] = []
        self.unknown: list[Unknown] = []
        self.worlds: list[WorldCheck] = []
        self.agents: list[AgentCheck] = []
        for one in log.problems:
            if one.step is None:
                self._add_problem_of_run(one)
        if not log.run.by_this_package:
            why = (
                "a world of another package made the run: its markers are not compared"
            )
            self.unknown.append(Unknown(0, None, why))

    def _add_problem_of_run(self, problem: Difference) -> None:
        """Add a problem without a time step; a lost part of the log may explain it."""
        if problem.logged == MISSING and self.log.messages.incomplete:
            why = f"the {problem.quantity} is not in the log"
            self.unknown.append(Unknown(0, None, why))
        else:
            self.differences.append(problem)

    def compare(self, interval: Interval) -> None:
        """Compare an interval; a lost one is unknown."""
        log = self.log
        if interval.lost:
            why = _why_lost(log, interval)
            self.unknown.append(Unknown(interval.first, interval.last, why))
            return
        world = WorldCheck(log, interval)
        robots = range(len(log.names))
        done = [trajectory_of(log, k, interval) for k in robots]
        team = [AgentCheck(log, k, interval, done[k]) for k in robots]
        self.worlds.append(world)
        self.agents += team
        left_out: list[str] = []
        with leaving_out("percepts and answers", left_out.append):
            self._add(interval, check_percepts(log, done))
        self._add(interval, log.problems)
        self._add(interval, world.check())
        with leaving_out("actions and tables", left_out.append):
            for agent in team:
                why_not = log.why_not_computed(agent.k)
                if why_not is None:
                    self._add(interval, agent.check())
                else:
                    left_out.append(why_not)
        for why in left_out:
            self.unknown.append(Unknown(interval.first, interval.last, why))

    def _add(self, interval: Interval, found: Iterable[Difference | Unknown]) -> None:
        """Add the findings of an interval's time steps."""
        for one in found:
            if isinstance(one, Unknown):
                if interval.holds(one.first):
                    self.unknown.append(one)
            elif one.step is not None and interval.holds(one.step):
                self.differences.append(one)

    def notes(self) -> dict[str, int]:
        """Return the notes of `Verification`."""
        messages = self.log.messages
        found = Counter[str]()
        found[FOREIGN] = len(messages.foreign)
        found[REPEATS] = sum(
            len(series.repeats)
            for k in range(len(self.log.names))
            for series in messages.of_robot(k)
        )
        for world in self.worlds:
            found[LEFT_OUT] = world.left_out  # it is a total over the intervals
            found[RESETS] += world.resets
            for topic, count in world.lost_copies.items():
                found[f"{LOST_COPIES}{topic}"] += count
        for agent in self.agents:
            found[UNLEARNED] += agent.unlearned
            topic = messages.topic(wire.TABLES, agent.k)
            found[f"{LOST_COPIES}{topic}"] += agent.lost_copies
        return {name: count for name, count in found.items() if count}


def _why_lost(log: RunLog, interval: Interval) -> str:
    """Return the reason why an interval is lost, as a sentence."""
    if interval.last is not None:
        return "a part of the log is lost; all robots' tables are there after that"
    return log.why_broken_off or "a part of the log is lost, and no checkpoint follows"


def _may_follow(difference: Difference, since: Unknown) -> bool:
    """Return whether lost messages since a time step may explain a difference.

    A robot that came back publishes the tables of its checkpoint again.
    """
    if (difference.quantity, difference.logged) == (wire.TABLES.name, TWICE):
        return True
    return difference.step is not None and difference.step >= since.first


def _unknown_since(log: RunLog, differences: Sequence[Difference]) -> Unknown | None:
    """Return the first time step from which lost messages may explain differences.

    The earliest possible cause is enough: `verify` does not search for the actual one.
    """
    if not differences:
        return None
    causes = [*_stalled(log, differences), *_came_back(log)]
    return min(causes, key=_first, default=None)


def _stalled(log: RunLog, differences: Sequence[Difference]) -> Iterator[Unknown]:
    """Yield the first message that a recorder missed while it was stopped."""
    missing = [one.step for one in differences if one.missing and one.step is not None]
    for stall in log.messages.stalls:
        missed = [step for step in missing if step >= stall.step]
        if missed:
            why = f"the recorder stood still for {stall.seconds} s and missed messages"
            yield Unknown(min(missed), None, why)


def _came_back(log: RunLog) -> Iterator[Unknown]:
    """Yield the nodes that came back without a roll-back of the team: robots, or the world.

    The log does not contain the state from which they continued.
    """
    without_rollback: dict[str, int] = {}
    for step, status in _decoded(log, wire.STATUS, read_status):
        if status.order.step == NO_ROLLBACK:
            without_rollback.setdefault(status.order.name, step)
    for k, name in enumerate(log.names):
        since = _came_back_alone(log, k, {NO_ORDER, *without_rollback})
        if since is not None:
            why = f"{name} returned with the tables of a checkpoint, without the team"
            yield Unknown(since, None, why)
    if without_rollback:
        why = "the world returned, and began a new episode instead of going back"
        yield Unknown(min(without_rollback.values()), None, why)


def _came_back_alone(
    log: RunLog, k: int, without_rollback: Collection[str]
) -> int | None:
    """Return the time step at which a robot came back; None: it did not, or the team went back.

    Args:
        log: the log.
        k: the robot's number.
        without_rollback: names of orders by which no robot goes back.
    """
    process = ""
    since = None
    for step, progress in _decoded(log, wire.PROGRESS, read_progress, k):
        replaced = process not in ("", progress.life)
        if replaced and progress.resumed and since is None:
            since = step
        if progress.obeyed not in without_rollback:
            since = None
        process = progress.life
    return since


def _decoded(
    log: RunLog, topic: wire.Topic, read: Callable[[Any], Any], k: int | None = None
) -> Iterator[tuple[int, Any]]:
    """Yield the log's time step and the decoded content of each message of a topic."""
    name = log.messages.topic(topic, k)
    if name not in log.bag.topics:
        return
    decode = Decoder(log.bag.topics)
    for message in log.bag.messages({name}):
        with suppress(AttributeError, ValueError):  # a malformed message
            step = round(message.log_time_ns / log.frame.period)
            yield step, read(decode(name, message.data))
