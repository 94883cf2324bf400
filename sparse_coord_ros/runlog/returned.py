# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who came back in mid-run and went on without taking the team back (`returning:=continue`).

What it had learned, or counted, since its checkpoint is lost. The log does not say what it began
with, so what follows from that is left open, and said.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple

from sparse_coord_ros import wire
from sparse_coord_ros.runlog.decode import Decoder
from sparse_coord_ros.runlog.difference import Difference
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.tracks import THE_CLOCK
from sparse_coord_ros.wire.frame import Frame
from sparse_coord_ros.wire.status import ROLL_CALL, values_of

OF_WORLD = {THE_CLOCK, wire.LOCAL_STATE.name, wire.REWARD.name, wire.STATUS.name}
OF_WORLD |= {wire.MAP.name, wire.MARKERS.name, wire.COORDINATION_MAP.name}
"""What depends on where the world is in its game."""


class Return(NamedTuple):
    """Who came back and went on.

    Attributes:
        robot: its name; None: the world.
        step: the time step from which on what it says is of its own.
        text: a sentence.
    """

    robot: str | None
    step: int
    text: str


def left_open(log: RunLog, found: Sequence[Difference]) -> tuple[list[Difference], list[str]]:
    """Return what is left open as somebody went on without the team, and who, as sentences."""
    open_: list[Difference] = []
    said = []
    for one in (*_robots(log), *_worlds(log)) if found else ():
        mine = [
            odd
            for odd in found
            if odd.step is not None
            and odd.step >= one.step
            and (odd.quantity in OF_WORLD if one.robot is None else odd.robot == one.robot)
        ]
        open_ += mine
        said += [one.text] if mine else []
    return open_, said


def _robots(log: RunLog) -> Iterator[Return]:
    for k, name in enumerate(log.names):
        life, back = "", None
        for step, said in _values(log, log.tracks.topic(wire.PROGRESS, k)):
            if life and said.get("life") != life and said.get("resumed") == "1":
                text = (
                    f"{name} came back at step {step} with what it had learned until step "
                    f"{said.get('step')}, and went on with that: what it then does and learns"
                )
                back = Return(name, step, f"{text} is not computed again")
            life = said.get("life", "")
            back = None if said.get("obeyed") else back
        if back is not None:
            yield back


def _worlds(log: RunLog) -> Iterator[Return]:
    for step, said in _values(log, log.tracks.topic(wire.STATUS)):
        if said.get("rollback", "").split()[1:2] == [str(ROLL_CALL)]:
            text = f"the world came back at step {step} and went on with a new episode"
            yield Return(None, step, f"{text}: what it then does is not computed again")
            return


def _values(log: RunLog, topic: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the log's time step and the values of each message of a topic."""
    decode, period = Decoder(log.bag.topics), Frame(log.run).period
    for message in log.bag.messages({topic}) if topic in log.bag.topics else ():
        with suppress(AttributeError, ValueError):  # no DiagnosticStatus; its reader says so
            said = values_of(decode(topic, message.data))
            yield round(message.log_time_ns / period), said
