# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controls of a page, and how they are checked before they are carried out."""

import queue
import time
from abc import abstractmethod
from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple

from sparse_coord_ros.base.errors import SettingError, SparseCoordError, retold
from sparse_coord_ros.core.game.scenario import load_scenario, scenario_names
from sparse_coord_ros.core.game.settings import Setting, SettingTable
from sparse_coord_ros.core.learners.registry import LEARNERS

HOST = "127.0.0.1"
PORT = 8765
"""Where the page is, unless it is wanted elsewhere."""

PAGE_SETTINGS = SettingTable(
    [
        Setting(
            "host",
            str,
            HOST,
            "address to serve the page on; 0.0.0.0: other machines can watch, too",
        ),
        Setting(
            "port", int, PORT, "port of the page; 0: any free port", low=0, high=65535
        ),
    ]
)

PAUSE = "pause"
STEP = "step"
RATE = "rate"
SEEK = "seek"
RESET = "reset"
NEXT = "next"
JUMP = "jump"
IMPORT = "import"
SAVE = "save"
TRAIN = "train"
STOP = "stop"
DRIVE = "drive"
AXIS = "axis"
LOOK = "look"
"""What a page may ask for: hold or go on; so many time steps on or back; time steps a second (0:
as fast as it goes); a time step to go to; a new episode; another run; the next moment of some
kind; to import a map with other values, to save what came of it, to let a team learn on it, to
stop that, and to drive the team that has learned; what several runs have in common on their time
line; the values of a cell and a peer's cell."""

QUESTION = "question"
MISCOORDINATION = "miscoordination"
CROSSING = "crossing"
POLICY = "policy"
EXCHANGE = "exchange"
STOPPED = "stopped"
STEP_KINDS = (QUESTION, MISCOORDINATION, CROSSING, POLICY, EXCHANGE, STOPPED)
"""A robot asks; robots miscoordinate; for the first time some are at one doorway and all arrive
without that; where a robot would ask changes; robots exchange their cells; a robot stays, as
another one is in its way."""

TIME_STEP = "step"
EPISODE = "episode"
LEARNED_EPISODE = "learned"
"""Another target of a jump: the episode that shows what was learned, in a loop."""

AXES = (LEARNED_EPISODE, EPISODE, TIME_STEP)
"""What several runs can have in common on one time line: both show the episode in which one sees
what they learned; both are in the same episode; both are at the same time step."""


class Control(NamedTuple):
    """A control that a page has sent, checked.

    Attributes:
        name: one of the above.
        value: of `pause` a bool; of `step` and `seek` a whole number; of `rate` a
            number; of `jump` and `axis` a word; of `next` a mapping of `scenario`, `penalty`,
            `learner` and `steps`; of `import`, `save` and `train` one that their source checks;
            of `reset`, `stop` and `drive` None.
    """

    name: str
    value: Any = None


class Controlled:
    """A source that can be paused, stepped and so on."""

    def __init__(self) -> None:
        self._wishes: queue.SimpleQueue[Control] = queue.SimpleQueue()

    def control(self, control: Control) -> None:
        """Carry out a control at the next tick. Called from the server's thread.

        Raises:
            SparseCoordError: it cannot be done; one line for the page.
        """
        self._wishes.put(control)

    def wishes(self) -> Iterator[Control]:
        """Yield the controls since the last call."""
        while not self._wishes.empty():
            yield self._wishes.get()


class Played(Controlled):
    """A source with a clock: time passes between two ticks, as far as the source lets it."""

    def __init__(self) -> None:
        super().__init__()
        self._then = time.monotonic()

    def stand_still(self) -> None:
        """Let no time pass."""
        self._then = time.monotonic()

    def tick(self) -> None:
        """Carry out the controls, move on, and show the time steps that are reached."""
        now = time.monotonic()
        passed = now - self._then
        self._then = now
        for control in self.wishes():
            self.carry_out(control)
        self.move_on(passed)
        self.show()

    @abstractmethod
    def carry_out(self, control: Control) -> None:
        """Do what a page asks for."""

    @abstractmethod
    def move_on(self, seconds: float) -> None:
        """Let so much time pass, unless time stands still."""

    @abstractmethod
    def show(self) -> None:
        """Put what belongs to the position on the board, where it is not there already."""


def parse_control(data: Mapping[str, Any], allowed: Collection[str]) -> Control:
    """Return the control in a page's message.

    Args:
        data: the message: `do` and `value`.
        allowed: the controls that there are now.

    Raises:
        SettingError: there is no such control, or its value is not allowed.
    """
    name: Any = data.get("do")
    value: Any = data.get("value")
    if not isinstance(name, str) or name not in allowed:
        raise SettingError(
            f"control {str(name)[:40]!r}: does not exist here; allowed: "
            f"{', '.join(allowed) or 'none'}"
        )
    if name == NEXT:
        return Control(name, _next(value))
    number = isinstance(value, int | float) and not isinstance(value, bool)
    whole = number and isinstance(value, int)
    mapping = (isinstance(value, Mapping), "an object")
    bare = (RESET, STOP, DRIVE)
    fits, words = {
        **dict.fromkeys((IMPORT, SAVE, TRAIN), mapping),
        PAUSE: (isinstance(value, bool), "true or false"),
        STEP: (whole and 0 < abs(value) <= 1000, "1 to 1000, or as much back"),
        SEEK: (whole and abs(value) <= 2**53, "a whole number"),
        RATE: (number and (value == 0 or 0.001 <= value <= 1e6), "0 or 0.001 to 1e6"),
        **dict.fromkeys(bare, (True, "")),
        AXIS: (value in AXES, ", ".join(AXES)),
        JUMP: (
            value in (*STEP_KINDS, LEARNED_EPISODE),
            ", ".join((*STEP_KINDS, LEARNED_EPISODE)),
        ),
    }[name]
    if not fits:
        raise _bad(name, value, words)
    if name == RATE:
        return Control(name, float(value))
    return Control(name, None if name in bare else value)


def _bad(name: str, value: Any, allowed: str) -> SettingError:
    return SettingError(
        f"control {name!r}: value is {str(value)[:40]!r}, allowed: {allowed}"
    )


def _next(value: Any) -> dict[str, Any]:
    """Return scenario, penalty, learner and steps of a run; no page names a file."""
    if not isinstance(value, Mapping):
        raise _bad(NEXT, value, "a scenario, a penalty, a learner and steps")
    scenario = value.get("scenario")
    penalty = value.get("penalty")
    learner = value.get("learner")
    steps = value.get("steps")
    if not isinstance(scenario, str) or scenario not in scenario_names():
        raise _bad("scenario", scenario, f"one of: {', '.join(scenario_names())}")
    if isinstance(penalty, bool) or not isinstance(penalty, int | float):
        raise _bad("penalty", penalty, "a number of at most 0")
    if not isinstance(learner, str) or learner not in LEARNERS.names:
        raise _bad("learner", learner, f"one of: {', '.join(LEARNERS.names)}")
    with retold(SettingError, SparseCoordError, "control 'next'"):
        load_scenario(scenario).with_settings({"penalty": penalty, "steps": steps})
    return {
        "scenario": scenario,
        "penalty": float(penalty),
        "learner": learner,
        "steps": steps,
    }
