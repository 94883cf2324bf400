# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a difference means: a copy that is lost, an open question, or that somebody did otherwise.

It is open where a part of the bag is lost, where a node was killed, and where one came back in
mid-run and went on without taking the team back (`returning:=continue`): what it had learned, or
counted, since its checkpoint is lost, and the log does not say what it began with.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from sparse_coord_ros import wire
from sparse_coord_ros.game.world import EPISODE_GAP
from sparse_coord_ros.runlog.agents import AgentCheck
from sparse_coord_ros.runlog.decode import Decoder
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.tracks import THE_CLOCK
from sparse_coord_ros.wire.status import ROLL_CALL, read_progress, read_status

KEPT = {one.name: one for one in (wire.MAP, wire.MARKERS, wire.COORDINATION_MAP, wire.TABLES)}
"""Of what the middleware keeps only the last messages for a recorder that lags."""
OF_WORLD = {THE_CLOCK, wire.LOCAL_STATE.name, wire.REWARD.name, wire.STATUS.name}
OF_WORLD |= KEPT.keys() - {wire.TABLES.name}
"""What depends on where the world is in its game."""


class Verdict(NamedTuple):
    """What is found in the order of time, by what it means; see `Verification`."""

    differences: list[Difference]
    open: list[Difference]
    lost: list[Difference]
    broke_off: list[str]


Cause = tuple[str, Callable[[Difference], bool]]
"""Why something may differ though nobody computed otherwise: a sentence, and what it is."""


def judge(log: RunLog, agents: Sequence[AgentCheck], found: Sequence[Difference]) -> Verdict:
    """Tell what is only lost, and what is open as somebody broke off, from what differs."""
    lost = dict.fromkeys(one for one in found if _lost(log, one))
    ordered = [one for one in found if one not in lost]
    open_: set[Difference] = set()
    broke_off = []
    for text, explains in _causes(log, agents) if ordered else ():
        mine = [one for one in ordered if explains(one)]
        open_.update(mine)
        broke_off += [text] if mine and text else []
    differences = [one for one in ordered if one not in open_]
    if ordered:  # somebody may have gone by foreign messages, or they replace what is missing
        differences = sorted([*log.tracks.suspects, *differences], key=lambda one: one.rank)
    return Verdict(differences, [one for one in ordered if one in open_], [*lost], broke_off)


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
        replaced = any(at is not None and abs(at - step) <= EPISODE_GAP for at in foreign)
        return log.bag.counts.get(topic, 0) > 0 and not replaced
    later = [one for one in log.all_tables if log.names[one.robot] == robot and one.step > step]
    return len(later) >= wire.TABLES_DEPTH


def _causes(log: RunLog, agents: Sequence[AgentCheck]) -> Iterator[Cause]:
    tracks = log.tracks
    if tracks.lossy:

        def gone(odd: Difference) -> bool:
            """Whether it may have been in a part that is lost; messages of steps have numbers."""
            return odd.logged == MISSING and (odd.step is None or odd.quantity in KEPT)

        yield "", gone
    for agent in agents:
        if agent.killed:
            text = f"{agent.name} saved no tables at its end (killed?)"
            yield text, agent.missing_tables(agent.end).__eq__
    if not log.broken_off and tracks.statuses and tracks.statuses[-1].state not in wire.OVER:
        yield "the world did not say how the run ended (killed?)", _of_its_end(log)
    said = _said(log, wire.STATUS, read_status)
    calls = [(step, one.order.name) for step, one in said if one.order.step == ROLL_CALL]
    for k in range(len(log.names)):
        yield from _robot_returns(log, k, {"", *(name for _, name in calls)})
    if calls:
        since = calls[0][0]

        def of_world(odd: Difference) -> bool:
            return odd.step is not None and odd.step >= since and odd.quantity in OF_WORLD

        text = f"the world came back at step {since} and went on with a new episode"
        yield f"{text}: what it then does is not computed again", of_world


def _of_its_end(log: RunLog) -> Callable[[Difference], bool]:
    """Return what tells what may be missing as the world was killed, also in its last moment."""
    tracks, state = log.tracks, repr(log.tracks.statuses[-1].state)
    last = max(int(track.step.max(initial=0)) for track in (*tracks.states, tracks.clock))

    def explains(odd: Difference) -> bool:
        missing = odd.logged == MISSING and (odd.step or 0) >= last
        return (
            (missing and odd.quantity in (wire.LOCAL_STATE.name, wire.REWARD.name, THE_CLOCK))
            or (odd.quantity, odd.logged) == (wire.STATUS.name, state)
            or odd.quantity == wire.TABLES.name
            and odd.computed.startswith("the log ends at step")
        )

    return explains


def _robot_returns(log: RunLog, k: int, calls: Collection[str]) -> list[Cause]:
    """Return what follows where a robot came back; nothing once it obeyed an order to go back.

    Args:
        log: the log.
        k: its number.
        calls: names of orders by which nobody goes back.
    """
    life, name, backs = "", log.names[k], list[Cause]()
    for step, said in _said(log, wire.PROGRESS, read_progress, k):
        if life and said.life != life and said.resumed:

            def explains(odd: Difference, step: int = step, since: int = said.step) -> bool:
                """Whether it is of then; or the tables of its checkpoint, which come again."""
                again = (odd.quantity, odd.logged, odd.step)
                late = odd.step is not None and odd.step >= step
                return odd.robot == name and (late or again == (wire.TABLES.name, "twice", since))

            text = (
                f"{name} came back at step {step} with what it had learned until step {said.step}"
            )
            text += ", and went on with that: what it then does and learns is not computed again"
            backs.append((text, explains))
        life = said.life
        backs = backs if said.obeyed in calls else []
    return backs


def _said(
    log: RunLog, topic: wire.Topic, read: Callable[[Any], Any], k: int | None = None
) -> Iterator[tuple[int, Any]]:
    """Yield the log's time step and what is read of each message of a topic."""
    decode, period, name = Decoder(log.bag.topics), log.frame.period, log.tracks.topic(topic, k)
    for message in log.bag.messages({name}) if name in log.bag.topics else ():
        with suppress(AttributeError, ValueError):  # another message; its reader says so
            said = read(decode(name, message.data))
            yield round(message.log_time_ns / period), said
