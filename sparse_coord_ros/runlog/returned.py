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
        since: the time step of its checkpoint, whose tables it publishes again; of the world none.
    """

    robot: str | None
    step: int
    text: str
    since: str = ""

    def explains(self, odd: Difference) -> bool:
        """Whether a difference may come of it."""
        if odd.step is None or odd.robot != self.robot and self.robot is not None:
            return False
        if (odd.quantity, odd.logged, f"{odd.step}") == (wire.TABLES.name, "twice", self.since):
            return True
        return odd.step >= self.step and (self.robot is not None or odd.quantity in OF_WORLD)


def left_open(log: RunLog, found: Sequence[Difference]) -> tuple[list[Difference], list[str]]:
    """Return what is left open as somebody went on without the team, and who, as sentences."""
    open_: list[Difference] = []
    said = []
    for one in (*_robots(log), *_worlds(log)) if found else ():
        mine = [odd for odd in found if one.explains(odd)]
        open_ += mine
        said += [one.text] if mine else []
    return open_, said


def _robots(log: RunLog) -> Iterator[Return]:
    for k, name in enumerate(log.names):
        life, backs = "", []
        for step, said in _values(log, log.tracks.topic(wire.PROGRESS, k)):
            if life and said.get("life") != life and said.get("resumed") == "1":
                since = said.get("step", "")
                text = (
                    f"{name} came back at step {step} with what it had learned until step "
                    f"{since}, and went on with that: what it then does and learns is not "
                    "computed again"
                )
                backs.append(Return(name, step, text, since))
            life = said.get("life", "")
            backs = [] if said.get("obeyed") else backs
        yield from backs


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
