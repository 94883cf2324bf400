# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Computes a recorded run again and compares; the engine behind `sparse_coord verify`.

What differs may be a copy that is lost, an open question, or that somebody did otherwise. It is
open where a part of the bag is lost, or the recorder stood still; where a node was killed; and
where one came back in mid-run and went on without taking the team back (`returning:=continue`):
what it had learned, or counted, since its checkpoint is lost, and the log does not say what it
began with. A robot that kept what it had learned in place of a plan leaves open why.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sparse_coord_ros.core.game.plugins import leaving_out
from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.log.runlog.agents import AgentCheck
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.log.runlog.difference import MISSING, Difference
from sparse_coord_ros.log.runlog.game_check import WorldCheck
from sparse_coord_ros.log.runlog.improved import OWN_TABLES, check_plans
from sparse_coord_ros.log.runlog.log import RunLog, read_run
from sparse_coord_ros.log.runlog.percepts import check_percepts
from sparse_coord_ros.log.runlog.replay import stretches
from sparse_coord_ros.log.runlog.timeline import Stall
from sparse_coord_ros.log.runlog.tracks import THE_CLOCK
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.status import (
    NO_ROLLBACK,
    read_progress,
    read_status,
)


@dataclass(frozen=True)
class Verification:
    """What `verify` found.

    Attributes:
        log: the log.
        differences: in the order of time; of what each robot's agent and the world compute only
            the first, as all that follows from it differs too.
        open: what differs where the log does not say enough: a robot or the world was killed, or
            came back and went on alone, a part of the bag is lost, the recorder stood still, or a
            robot made no plan.
        broke_off: why, as sentences, but for lost parts; the same differences are in `open`.
        not_computed: what was left out, as its code may not be imported, a robot shows neither
            tables nor coordination maps, or the world is one of one's own, as sentences.
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
        kept: robots that kept what they had learned in place of a plan.
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
    kept: int
    not_compared: tuple[tuple[int, int | None], ...]

    @property
    def same(self) -> bool:
        """Whether nothing differs or is open; copies that are lost are only counted."""
        return not (
            self.differences or self.open or self.not_computed or self.not_compared
        )

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
    worlds: list[WorldCheck] = []
    agents: list[AgentCheck] = []
    not_computed: dict[str, None] = {}
    say = not_computed.setdefault
    found = [one for one in log.problems if one.step is None]
    if not log.run.by_this_package:
        why = (
            "the versions in its run do not name sparse_coord_ros: a world of one's own"
        )
        say(f"{why}, whose markers are not compared")
    for part in parts:
        if not part.lost:
            worlds.append(WorldCheck(log, part))
            team = [AgentCheck(log, k, part) for k in range(len(log.names))]
            found += _of_part(worlds[-1], team, say)
            agents += team
    # Where something else differs, or is lost, the agents do not know what the robots learned.
    team = [] if found or parts[-1].lost else agents[-len(log.names) :]
    with leaving_out("plans", say):
        found += check_plans(log, team)
    ordered = sorted(dict.fromkeys(found), key=lambda one: one.rank)
    differences, left_open, lost, broke_off = judge(log, agents, ordered)

    def total(name: str, checks: Sequence[AgentCheck | WorldCheck] = agents) -> int:
        return sum(getattr(check, name) for check in checks)

    return Verification(
        log=log,
        differences=tuple(differences),
        open=tuple(left_open),
        broke_off=tuple(broke_off),
        not_computed=tuple(not_computed),
        foreign=0 if differences or left_open else len(log.tracks.suspects),
        lost=Counter(topic_of(log, one) for one in lost),
        steps=total("transitions", worlds),
        choices=total("choices"),
        updates=total("updates"),
        tables=total("compared"),
        left_out=worlds[-1].left_out if worlds else 0,
        unlearned=total("unlearned"),
        resets=total("resets", worlds),
        kept=sum(one.logged == OWN_TABLES for one in found),
        repeats=sum(
            len(t.repeats) for k in range(len(log.names)) for t in log.tracks.of(k)
        ),
        not_compared=tuple((part.first, part.last) for part in parts if part.lost),
    )


def _of_part(
    world: WorldCheck, team: Sequence[AgentCheck], say: Callable[[str], None]
) -> list[Difference]:
    """Return in what a part differs; say what is not computed."""
    log = world.log
    part = world.stretch
    found = list[Difference]()
    with leaving_out("percepts and answers", say):
        found += check_percepts(log, part)
    found += [*log.problems, *world.differences()]
    with leaving_out("actions and tables", say):
        for agent in team:
            why = log.hides(agent.k)
            if why is None:
                found += agent.differences()
            else:
                say(why)
    return [one for one in found if one.step is not None and part.holds(one.step)]


# What a difference means.

KEPT = {
    one.name: one
    for one in (wire.MAP, wire.MARKERS, wire.COORDINATION_MAP, wire.TABLES)
}
"""Of what the middleware keeps only the last messages for a recorder that lags."""
OF_WORLD = {THE_CLOCK, wire.LOCAL_STATE.name, wire.REWARD.name, wire.STATUS.name}
OF_WORLD |= KEPT.keys() - {wire.TABLES.name}
"""What depends on where the world is in its game."""


class Cause(NamedTuple):
    """Why something may differ though nobody computed otherwise.

    Attributes:
        text: why, as a sentence; empty: other lines say it.
        explains: whether it may be why something differs.
    """

    text: str
    explains: Callable[[Difference], bool]


def judge(
    log: RunLog, agents: Sequence[AgentCheck], found: Sequence[Difference]
) -> tuple[list[Difference], list[Difference], list[Difference], list[str]]:
    """Return what differs, is open, and is only lost, in the order of time; and who broke off."""
    lost = dict.fromkeys(one for one in found if _lost(log, one))
    ordered = [one for one in found if one not in lost]
    if (
        ordered
    ):  # somebody may have gone by foreign messages, or they replace what is missing
        ordered = sorted([*log.tracks.suspects, *ordered], key=lambda one: one.rank)
    open_: set[Difference] = set()
    broke_off = []
    for cause in _causes(log, agents, ordered) if ordered else ():
        mine = [one for one in ordered if cause.explains(one)]
        open_.update(mine)
        if mine and cause.text:
            broke_off.append(cause.text)
    differences = [one for one in ordered if one not in open_]
    return differences, [one for one in ordered if one in open_], [*lost], broke_off


def topic_of(log: RunLog, difference: Difference) -> str:
    """Return the full name of the topic of what is kept."""
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
        topic = topic_of(log, difference)
        odd = f"topic {topic}", f"{quantity} stamp"
        foreign = [one.step for one in log.tracks.suspects if one.quantity in odd]
        replaced = any(
            at is not None and abs(at - step) <= EPISODE_GAP for at in foreign
        )
        return log.bag.counts.get(topic, 0) > 0 and not replaced
    later = [
        one
        for one in log.all_tables
        if log.names[one.robot] == robot and one.step > step
    ]
    return len(later) >= wire.TABLES_DEPTH


def _causes(
    log: RunLog, agents: Sequence[AgentCheck], found: Sequence[Difference]
) -> Iterator[Cause]:
    """Yield what may be why something in a log differs.

    Args:
        log: the log.
        agents: the robots' checks.
        found: what differs.
    """
    tracks = log.tracks
    if tracks.lossy or tracks.broken_off:
        yield Cause("", _may_be_lost)
    for stall in tracks.stalls:
        yield from _stood_still(stall, found)
    for agent in agents:
        last = agent.missing_tables(agent.end)
        yield Cause(f"{agent.name} saved no tables at its end (killed?)", last.__eq__)
    for name in log.names:
        yield from _without_plan(name)
    calls = _progress_orders(log)
    for k in range(len(log.names)):
        yield from _robot_returns(log, k, {"", *calls})
    if calls:
        yield _world_returned(min(calls.values()))


def _may_be_lost(odd: Difference) -> bool:
    """Whether it may have been in a part that is lost; messages of steps have numbers."""
    return odd.logged == MISSING and (odd.step is None or odd.quantity in KEPT)


def _stood_still(stall: Stall, found: Sequence[Difference]) -> Iterator[Cause]:
    """Yield that the recorder stood still and missed something: the rest follows from that."""
    steps = [one.step for one in found if one.missing and one.step is not None]
    missed = [step for step in steps if step >= stall.step]
    if not missed:
        return
    since = min(missed)
    text = f"the recorder stood still for {stall.seconds} s and missed messages from step {since}"
    yield Cause(f"{text} on", lambda odd: odd.step is not None and odd.step >= since)


def _without_plan(name: str) -> Iterator[Cause]:
    """Yield why a robot may have no plan, or what it had learned in place of one."""
    plan = wire.improved_attachment(name)
    kept = f"{name} kept what it had learned, as where a peer does not say what it has learned"
    yield Cause(
        f"{name} made no plan (stopped before that?)",
        lambda odd: (odd.quantity, odd.logged) == (plan, MISSING),
    )
    yield Cause(
        f"{kept}; the log does not hold what peers said",
        lambda odd: (odd.quantity, odd.logged) == (plan, OWN_TABLES),
    )


def _progress_orders(log: RunLog) -> dict[str, int]:
    """Return the names of the orders by which nobody goes back, and when they were given first."""
    found: dict[str, int] = {}
    for step, said in _said(log, wire.STATUS, read_status):
        if said.order.step == NO_ROLLBACK:
            found.setdefault(said.order.name, step)
    return found


def _world_returned(since: int) -> Cause:
    """Return that the world came back at a time step and went on with a new episode."""
    text = f"the world came back at step {since} and went on with a new episode"
    return Cause(
        f"{text}: what it then does is not computed again",
        lambda odd: (
            odd.step is not None and odd.step >= since and odd.quantity in OF_WORLD
        ),
    )


def _robot_returns(log: RunLog, k: int, calls: Collection[str]) -> list[Cause]:
    """Return what follows where a robot came back; nothing once it obeyed an order to go back.

    Args:
        log: the log.
        k: its number.
        calls: names of orders by which nobody goes back.
    """
    life = ""
    found: list[Cause] = []
    for step, said in _said(log, wire.PROGRESS, read_progress, k):
        if life and said.life != life and said.resumed:
            found.append(_robot_returned(log.names[k], step, said.step))
        life = said.life
        if said.obeyed not in calls:
            found = []
    return found


def _robot_returned(name: str, step: int, since: int) -> Cause:
    """Return that a robot came back at a time step with what it had learned until an earlier one.

    The tables of its checkpoint come again.
    """

    def explains(odd: Difference) -> bool:
        late = odd.step is not None and odd.step >= step
        again = (odd.quantity, odd.logged, odd.step) == (
            wire.TABLES.name,
            "twice",
            since,
        )
        return odd.robot == name and (late or again)

    text = (
        f"{name} came back at step {step} with what it had learned until step {since}"
    )
    so = "and went on with that: what it then does and learns is not computed again"
    return Cause(f"{text}, {so}", explains)


def _said(
    log: RunLog, topic: wire.Topic, read: Callable[[Any], Any], k: int | None = None
) -> Iterator[tuple[int, Any]]:
    """Yield the log's time step and what is read of each message of a topic."""
    decode = Decoder(log.bag.topics)
    period = log.frame.period
    name = log.tracks.topic(topic, k)
    for message in log.bag.messages({name}) if name in log.bag.topics else ():
        with suppress(
            AttributeError, ValueError
        ):  # another message; its reader says so
            yield round(message.log_time_ns / period), read(decode(name, message.data))
