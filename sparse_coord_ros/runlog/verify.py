# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Computes a recorded run again and compares; the engine behind `sparse_coord verify`."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.game.plugins import leaving_out
from sparse_coord_ros.game.world import EPISODE_GAP
from sparse_coord_ros.runlog.agents import AgentCheck
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.game_check import WorldCheck
from sparse_coord_ros.runlog.log import RunLog, read_run
from sparse_coord_ros.runlog.percepts import check_percepts
from sparse_coord_ros.runlog.returned import left_open
from sparse_coord_ros.runlog.stretches import Stretch, between, stretches
from sparse_coord_ros.runlog.tracks import THE_CLOCK


@dataclass(frozen=True)
class Verification:
    """What `verify` found.

    Attributes:
        log: the log.
        differences: in the order of time; of what each robot's agent and the world compute only
            the first, as all that follows from it differs too.
        open: what differs where the log does not say enough: a robot or the world was killed, or
            came back and went on alone, or a part of the bag is lost.
        broke_off: who was killed, or came back and went on alone, as sentences; the same
            differences are in `open`.
        not_computed: what was left out, as its code may not be imported, as sentences.
        foreign: messages beside those of the run, where all else is as it is computed.
        lost: how many messages are not in the log, by topic: of map, markers and coordination
            maps a busy middleware keeps only the last, of tables the last `TABLES_DEPTH`.
        steps: transitions of the world that were computed again and agree.
        choices: actions that were computed again; updates: of tables.
        tables: recorded tables that were compared.
        left_out: robots' steps that the world went on without.
        unlearned: transitions that robots under way have not learned from.
        resets: episodes that began early.
        repeats: messages that came again after a silence.
        not_compared: time steps that are lost, or lie between a loss and the next checkpoint, as
            (first, last); None: to the run's end.
    """

    log: RunLog
    differences: tuple[Difference, ...]
    open: tuple[Difference, ...]
    broke_off: tuple[str, ...]
    not_computed: tuple[str, ...]
    foreign: int
    lost: Mapping[str, int]
    steps: int
    choices: int
    updates: int
    tables: int
    left_out: int
    unlearned: int
    resets: int
    repeats: int
    not_compared: tuple[tuple[int, int | None], ...]

    @property
    def same(self) -> bool:
        """Whether nothing differs or is open; copies that are lost are only counted."""
        return not (self.differences or self.open or self.not_computed or self.not_compared)

    @property
    def cannot_tell(self) -> bool:
        """Whether nothing differs, but a part is left open, lost or not computed."""
        return not self.same and not self.differences

    @property
    def first(self) -> Difference | None:
        """The first difference."""
        found = self.differences or self.open
        return found[0] if found else None


def verify(path: Path) -> Verification:
    """Compute a recorded run again from its seed and its log, and compare.

    Args:
        path: as of `read_run`.

    Raises:
        BagError: nothing can be read, or the bag holds no run, or is of another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    log = read_run(path)
    parts = stretches(log)
    worlds = [WorldCheck(log, part) for part in parts]
    agents: list[AgentCheck] = []
    not_computed: dict[str, None] = {}
    found = [one for one in log.problems if one.step is None]
    for part, world in zip(parts, worlds, strict=True):
        starts = np.array(world.starts, dtype=np.int64)
        team = [AgentCheck(log, k, starts, part) for k in range(len(log.names))]
        found += _differences(log, part, world, team, not_computed.setdefault)
        agents += team
    verdict = _judge(log, agents, sorted(dict.fromkeys(found), key=lambda one: one.rank))

    def total(name: str, checks: Sequence[AgentCheck | WorldCheck] = agents) -> int:
        return sum(getattr(check, name) for check in checks)

    return Verification(
        log=log,
        differences=tuple(verdict.differences),
        open=tuple(verdict.open),
        broke_off=tuple(verdict.broke_off),
        not_computed=tuple(not_computed),
        foreign=0 if verdict.differences or verdict.open else len(log.tracks.suspects),
        lost=Counter(_topic(log, one) for one in verdict.lost),
        steps=total("transitions", worlds),
        choices=total("choices"),
        updates=total("updates"),
        tables=total("compared"),
        left_out=worlds[-1].left_out if worlds else 0,
        unlearned=total("unlearned"),
        resets=total("resets", worlds),
        repeats=sum(len(t.repeats) for k in range(len(log.names)) for t in log.tracks.of(k)),
        not_compared=tuple(between(parts)),
    )


class _Verdict(NamedTuple):
    """What is found in the order of time, by what it means; see `Verification`."""

    differences: list[Difference]
    open: list[Difference]
    lost: list[Difference]
    broke_off: list[str]


def _judge(log: RunLog, agents: Sequence[AgentCheck], found: Sequence[Difference]) -> _Verdict:
    """Tell what is only lost, and what is open as somebody broke off, from what differs."""
    lost = dict.fromkeys(one for one in found if _lost(log, one))
    ordered = [one for one in found if one not in lost]
    causes = (
        _gone(log, ordered),
        _killed_robots(log, agents, ordered),
        _killed_world(log, ordered),
        left_open(log, ordered),
    )
    open_ = {one for left, _ in causes for one in left}
    differences = [one for one in ordered if one not in open_]
    if ordered:  # somebody may have gone by foreign messages, or they replace what is missing
        differences = sorted([*log.tracks.suspects, *differences], key=lambda one: one.rank)
    broke_off = [sentence for _, said in causes for sentence in said]
    return _Verdict(differences, [one for one in ordered if one in open_], [*lost], broke_off)


def _differences(
    log: RunLog,
    stretch: Stretch,
    world: WorldCheck,
    agents: Sequence[AgentCheck],
    say: Callable[[str], None],
) -> list[Difference]:
    """Return all that differs in a stretch; say what is left out."""
    found: list[Difference] = []
    with leaving_out("percepts and answers", say):
        found += check_percepts(log, stretch)
    found += [*log.problems, *world.differences()]
    with leaving_out("actions and tables", say):
        for agent in agents:
            found += agent.differences()
    return [one for one in found if one.step is not None and stretch.holds(one.step)]


KEPT = {one.name: one for one in (wire.MAP, wire.MARKERS, wire.COORDINATION_MAP, wire.TABLES)}
"""Of what the middleware keeps only the last messages for a recorder that lags."""


def _topic(log: RunLog, difference: Difference) -> str:
    robot = None if difference.robot is None else log.names.index(difference.robot)
    return log.tracks.topic(KEPT[difference.quantity], robot)


def _lost(log: RunLog, difference: Difference) -> bool:
    """Whether a message is missing on a topic that has others, and keeps only its last ones.

    Where a foreign one is there instead, it may have been replaced.
    Of tables: whether as many as it keeps came later, made by all that was learned before.
    """
    step, robot, quantity, logged, _ = difference
    if logged != MISSING or quantity not in KEPT or not step:
        return False
    if quantity != wire.TABLES.name:
        topic = _topic(log, difference)
        odd = f"topic {topic}", f"{quantity} stamp"
        foreign = [one.step for one in log.tracks.suspects if one.quantity in odd]
        replaced = any(at is not None and abs(at - step) <= EPISODE_GAP for at in foreign)
        return log.bag.counts.get(topic, 0) > 0 and not replaced
    later = [one for one in log.all_tables if log.names[one.robot] == robot and one.step > step]
    return len(later) >= wire.TABLES_DEPTH


def _gone(log: RunLog, found: Sequence[Difference]) -> tuple[list[Difference], list[str]]:
    """Return what is missing that may have been in a part of the bag that is lost; no sentence.

    Messages of every step have numbers, so it is known of which time steps they are lost.
    """
    missing = [one for one in found if one.logged == MISSING] if log.tracks.lossy else []
    return [one for one in missing if one.step is None or one.quantity in KEPT], []


def _killed_robots(
    log: RunLog, agents: Sequence[AgentCheck], found: Sequence[Difference]
) -> tuple[list[Difference], list[str]]:
    """Return the tables that killed robots have not saved, and who they are, as sentences."""
    killed, said = [], []
    for agent in agents:
        end = int(log.tracks.states[agent.k].step.max(initial=0))
        due = Difference(
            end, agent.name, wire.TABLES.name, MISSING, wire.tables_attachment(agent.name, end)
        )
        if end and agent.killed and due in found:
            killed.append(due)
            said.append(f"{agent.name} saved no tables at its end (killed?)")
    return killed, said


def _killed_world(log: RunLog, found: Sequence[Difference]) -> tuple[list[Difference], list[str]]:
    """Return what is missing as the world was killed, and a sentence that says so."""
    statuses = log.tracks.statuses
    if log.broken_off or not statuses or statuses[-1].state in wire.OVER:
        return [], []
    last = max(int(t.step.max(initial=0)) for t in (*log.tracks.states, log.tracks.clock))
    # The messages of its last moment may be lost too.
    of_world = (wire.LOCAL_STATE.name, wire.REWARD.name, THE_CLOCK)
    killed = [
        one
        for one in found
        if (one.quantity in of_world and one.logged == MISSING and (one.step or 0) >= last)
        or (one.quantity == wire.STATUS.name and one.logged == repr(statuses[-1].state))
        or (one.quantity == wire.TABLES.name and one.computed.startswith("the log ends at step"))
    ]
    return killed, ["the world did not say how the run ended (killed?)"] if killed else []
