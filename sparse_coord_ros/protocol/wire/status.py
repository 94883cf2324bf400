# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world's messages `status` on the run, and the robots' `_progress` on their checkpoints.

The fields' names are the labels of the messages' values, with noted exceptions.
"""

from typing import Any, NamedTuple

NO_ORDER = ""
"""In place of the name of an order: there is no order."""

NO_ROLLBACK = -1
"""In place of a checkpoint's step: robots publish their progress, and keep their states."""

FURTHEST_STEP = 2**25
"""Upper limit of time steps: a run has 10^7 transitions at most, and two steps between
episodes."""


class Order(NamedTuple):
    """The world's order to go back.

    Attributes:
        name: a new one for each order; `NO_ORDER`: there is no order.
        step: the checkpoint to go back to, or `NO_ROLLBACK`.
        first: the time step of the first local state after it.
    """

    name: str = NO_ORDER
    step: int = 0
    first: int = 0


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
        order: the current order to go back to a checkpoint: the value `rollback`.
    """

    run: str
    state: str
    step: int
    transitions: int
    left_out: int = 0
    began: str = ""
    order: Order = Order()

    def values(self) -> dict[str, object]:
        """Return the values of its message."""
        order = " ".join(map(str, self.order)) if self.order.name else ""
        values = {**self._asdict(), "rollback": order}
        del values["state"], values["order"]
        return values


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
    values = values_of(message, "step", "transitions", "left_out", "began")
    step, transitions, left_out = (int(values[name]) for name in RunStatus._fields[2:5])
    if step < 0 or transitions < 0:
        raise ValueError(f"says step {step} with {transitions} transitions")
    name, *steps = values.get("rollback", "").split() or [NO_ORDER]
    if len(steps) != (2 if name else 0):
        raise ValueError(f"says rollback {values['rollback']!r}")
    order = Order(name, *map(int, steps))
    began = values["began"]
    run = values.get("run", "")
    return RunStatus(
        run, str(message.message), step, transitions, left_out, began, order
    )


class Progress(NamedTuple):
    """A robot's report when it joins, has saved, or has obeyed.

    Attributes:
        life: the identity of the process; a new one means that the robot was replaced.
        step: the time step that it has processed.
        transitions: number of transitions that it has seen.
        checkpoints: steps of its checkpoints, 0 (the run's beginning) included; empty if it keeps
            none.
        obeyed: the newest order that it has obeyed.
        resumed: it was started to continue where its predecessor was, not to begin anew.
    """

    life: str
    step: int
    transitions: int
    checkpoints: tuple[int, ...] = ()
    obeyed: str = NO_ORDER
    resumed: bool = False

    def values(self) -> dict[str, object]:
        """Return the values of its message."""
        checkpoints = " ".join(map(str, self.checkpoints))
        return {
            **self._asdict(),
            "resumed": int(self.resumed),
            "checkpoints": checkpoints,
        }


def read_progress(message: Any) -> Progress:
    """Return the progress of a robot in its message.

    Raises:
        ValueError: it is malformed.
    """
    values = values_of(message, *Progress._fields)
    step = int(values["step"])
    transitions = int(values["transitions"])
    checkpoints = tuple(int(text) for text in values["checkpoints"].split())
    if not all(
        0 <= number <= FURTHEST_STEP for number in (step, transitions, *checkpoints)
    ):
        raise ValueError(
            f"says step {step} with {transitions} transitions, more than a run can have"
        )
    resumed = values["resumed"] == "1"
    return Progress(
        values["life"], step, transitions, checkpoints, values["obeyed"], resumed
    )
