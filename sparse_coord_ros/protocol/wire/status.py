# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world's messages `status` on the run, and the nodes' `_progress` on their checkpoints.

The fields' names are the labels of the messages' values, with noted exceptions.
"""

from typing import Any, NamedTuple

NO_ATTEMPT = ""
"""In place of the name of an attempt: there is none yet."""


class Order(NamedTuple):
    """The world's order to all nodes: begin at a checkpoint.

    The part of a run between two orders is an attempt. What later attempts do again replaces what
    earlier ones did.

    Attributes:
        attempt: a new name for each order; `NO_ATTEMPT`: the run has not begun.
        checkpoint: the time step of the checkpoint; 0: the run's beginning.
    """

    attempt: str = NO_ATTEMPT
    checkpoint: int = 0


class RunStatus(NamedTuple):
    """The content of `status`.

    Attributes:
        run: the identity of the world's run, `id` in `run.yaml`.
        state: a `RunState`; it is the status's text, not one of its values.
        step: the time step.
        transitions: number of transitions made.
        left_out: number of (robot, step) pairs: transitions without the robot's action although it
            had not arrived.
        began: why the episode began, a `StartReason`.
        order: the last order; its fields are values of the message.
        oldest: the oldest checkpoint to which the team may go back; nodes remove older ones.
        save_at: a time step at which all save, beside every `checkpoint` steps; 0: none.
    """

    run: str
    state: str
    step: int
    transitions: int
    left_out: int = 0
    began: str = ""
    order: Order = Order()
    oldest: int = 0
    save_at: int = 0

    def values(self) -> dict[str, object]:
        """Return the values of its message."""
        values = {**self._asdict(), **self.order._asdict()}
        del values["state"], values["order"]
        return values


NUMBERS = ("step", "transitions", "left_out", "checkpoint", "oldest", "save_at")
"""The values of `status` that are numbers."""


def values_of(message: Any, *needed: str) -> dict[str, str]:
    """Return the values of a diagnostic_msgs/DiagnosticStatus; ValueError: one is missing."""
    values = {value.key: value.value for value in message.values}
    missing = [name for name in needed if name not in values]
    if missing:
        raise ValueError(f"has no value {missing[0]!r}")
    return values


def read_status(message: Any) -> RunStatus:
    """Return the status of the run in a message on `status`.

    Raises:
        ValueError: a value is missing, or not a number.
    """
    values = values_of(message, *NUMBERS, "began", "attempt")
    numbers = {name: int(values[name]) for name in NUMBERS}
    if min(numbers.values()) < 0:
        raise ValueError(f"has a negative number: {numbers}")
    return RunStatus(
        run=values.get("run", ""),
        state=str(message.message),
        step=numbers["step"],
        transitions=numbers["transitions"],
        left_out=numbers["left_out"],
        began=values["began"],
        order=Order(values["attempt"], numbers["checkpoint"]),
        oldest=numbers["oldest"],
        save_at=numbers["save_at"],
    )


LEFT = -1
"""In place of the time step up to which a recorder has written: it records no more."""


class Progress(NamedTuple):
    """A node's report: when it joins a team, has saved, or has begun as the world ordered.

    Attributes:
        checkpoints: the time steps at which it can begin, 0 (the run's beginning) among them;
            empty: at any, as it learns nothing.
        attempt: the attempt that it has begun; `NO_ATTEMPT`: a new process, which waits for an
            order.
        written: of a recorder: the time step up to which the bag holds everything; `LEFT`: it
            records no more.
    """

    checkpoints: tuple[int, ...] = ()
    attempt: str = NO_ATTEMPT
    written: int = 0

    def values(self) -> dict[str, object]:
        """Return the values of its message."""
        return {
            "checkpoints": " ".join(map(str, self.checkpoints)),
            "attempt": self.attempt,
            "written": self.written,
        }


def read_progress(message: Any) -> Progress:
    """Return the progress of a node in its message.

    Raises:
        ValueError: it is malformed.
    """
    values = values_of(message, "checkpoints", "attempt")
    checkpoints = tuple(int(text) for text in values["checkpoints"].split())
    if any(step < 0 for step in checkpoints):
        raise ValueError(f"says checkpoints {values['checkpoints']!r}")
    return Progress(checkpoints, values["attempt"], int(values.get("written", 0)))
