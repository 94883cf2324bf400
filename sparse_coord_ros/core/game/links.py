# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links that fail on purpose: at which time steps a robot gets no answer to its COORDINATE.

The paper's percept fails by where robots are (`core/game/perception.py`). A link fails by when a
robot asks: its answer is lost, late or refused, which makes no difference to the asker. Every
robot's link has a random stream of its own, a function of (seed, phase, robot). Its pattern has
`PERIOD` time steps and comes again after them. While a link is down the draw of the percept is
`DOWN_DRAW`, which no probability exceeds. So plain and compiled code need no second rule for
links.
"""

from typing import NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.specs import Form, Number, Spec, SpecFamily, probability
from sparse_coord_ros.core.game.streams import LEARNING, bit_generator

UP = Spec("up")
"""The link that never fails."""

LINKS = SpecFamily(
    "link",
    Form("up", "never fails"),
    Form("lost", "fails at each time step with this probability", (probability("p"),)),
    Form(
        "bursts",
        "goes down and comes back, each time step with a probability",
        (probability("p_down"), probability("p_up")),
    ),
    Form("dead", "is dead from this time step on", (Number("step", 0.0),)),
)
"""How a robot's link fails."""

LINK = 6
"""Role of the links' random stream, after those of `core.game.streams`."""

PERIOD = 1 << 16
"""Time steps of a link's pattern."""

DOWN_DRAW = 1.0
"""The draw of a percept that cannot succeed."""

NEVER = 1 << 62


class Link(NamedTuple):
    """When one robot's link is down.

    Attributes:
        pattern: whether it is down at time step t modulo its length, shape (PERIOD,); shape (0,)
            of a link without a pattern.
        dead_from: the time step from which it is down for good.
    """

    pattern: np.ndarray
    dead_from: int

    def down(self, step: int) -> bool:
        """Return whether it is down at a time step."""
        pattern = self.pattern
        return step >= self.dead_from or bool(
            len(pattern) and pattern[step % len(pattern)]
        )


def check_up(link: Spec, what: str) -> None:
    """Raise `SettingError` if links fail by time and `what` does not consider time."""
    if link != UP:
        why = "up, as a link that fails by time is no part of the joint state; evaluate by trials"
        raise SettingError(f"{what}: setting link is {str(link)!r}, allowed: {why}")


def link_of(link: Spec, seed: int, agent: int, phase: int = LEARNING) -> Link:
    """Return the link of one robot of a run; arguments as of `core.game.streams.Stream`."""
    pattern = np.zeros(0, dtype=np.bool_)
    dead_from = NEVER
    if link.kind == "dead":
        dead_from = int(link.numbers[0])
    elif link.kind != "up":
        draws = np.random.Generator(bit_generator(seed, agent, LINK, phase)).random(
            PERIOD
        )
        if link.kind == "lost":
            pattern = draws < link.numbers[0]
        else:
            pattern = _bursts(draws, *link.numbers)
    return Link(pattern, dead_from)


def _bursts(draws: np.ndarray, p_down: float, p_up: float) -> np.ndarray:
    """Return the pattern of a link that goes down and comes back, shape (PERIOD,), bool."""
    down = False
    found = []
    for draw in draws.tolist():
        down = draw >= p_up if down else draw < p_down
        found.append(down)
    return np.array(found)
