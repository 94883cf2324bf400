# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings that name a kind and its numbers, written `kind` or `kind:number[:number ...]`.

`perception=probability:0.7`, `step_size=power:0.6` and `epsilon=linear:1:0.05:0.5` are such
settings. A family of them (the perception models, the schedules) is one `SpecFamily`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from sparse_coord_ros.errors import SettingError, did_you_mean


@dataclass(frozen=True)
class Number:
    """One number of a spec.

    Attributes:
        name: what error messages and help call it.
        low: smallest value allowed.
        high: largest value allowed.
        repeated: whether it can be given several times; only the last number of a kind can.
    """

    name: str
    low: float = -math.inf
    high: float = math.inf
    repeated: bool = False

    @property
    def allowed(self) -> str:
        """What may be given, in words."""
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"a number from {self.low:g} to {self.high:g}"
        if math.isfinite(self.low):
            return f"a number of at least {self.low:g}"
        return f"a number of at most {self.high:g}" if math.isfinite(self.high) else "a number"


@dataclass(frozen=True)
class Spec:
    """A parsed setting: the kind and its numbers; `str()` writes it as it was read."""

    kind: str
    numbers: tuple[float, ...] = ()

    def __str__(self) -> str:
        """Return `kind[:number ...]`."""
        # repr() and not :g, which would round: the robots of a run read this text.
        return ":".join([self.kind, *(repr(n).removesuffix(".0") for n in self.numbers)])


class Form(NamedTuple):
    """One way to write a setting, e.g. `probability:P`.

    Attributes:
        text: how it is written; capital letters stand for numbers.
        numbers: what these are.
        meaning: one line.
    """

    text: str
    numbers: tuple[Number, ...]
    meaning: str


@dataclass(frozen=True)
class SpecFamily:
    """The kinds that one setting allows, each with its numbers.

    Attributes:
        setting: the setting's name.
        kinds: the numbers of each kind.
        meanings: one line for each kind.
    """

    setting: str
    kinds: Mapping[str, tuple[Number, ...]]
    meanings: Mapping[str, str] = field(default_factory=dict)

    @property
    def forms(self) -> tuple[Form, ...]:
        """The allowed forms, one for each kind."""
        forms = []
        for kind, numbers in self.kinds.items():
            text = ":".join([kind, *(number.name.upper() for number in numbers)])
            repeated = bool(numbers) and numbers[-1].repeated
            meaning = self.meanings.get(kind, "")
            forms.append(Form(f"{text}:..." if repeated else text, numbers, meaning))
        return tuple(forms)

    @property
    def usage(self) -> str:
        """The allowed forms, for help and error texts."""
        return ", ".join(form.text for form in self.forms)

    def parse(self, value: object) -> Spec:
        """Read a setting's value.

        Raises:
            SettingError: unknown kind, wrong count of numbers, or a number out of range.
        """
        if isinstance(value, Spec):
            return value
        text = str(value)
        kind, *texts = text.split(":")
        if kind not in self.kinds:
            raise self.unknown(text, kind, self.kinds)
        return self.numbered(text, kind, texts, self.kinds[kind])

    def unknown(
        self, text: str, kind: str, known: Mapping[str, tuple[Number, ...]]
    ) -> SettingError:
        """Return the error for a kind that is not known; a lone number may lack its kind."""
        first = next((k for k, wanted in known.items() if len(wanted) == 1), None)
        hint = did_you_mean(kind, known)
        if first is not None and _is_number(text):
            hint = f" (did you mean '{first}:{text}'?)"
        return SettingError(
            f"setting {self.setting}: unknown value {text!r}{hint}; allowed: {self.usage}"
        )

    def numbered(
        self, text: str, kind: str, texts: Sequence[str], wanted: tuple[Number, ...]
    ) -> Spec:
        """Return a spec of the numbers of a kind.

        Raises:
            SettingError: wrong count of numbers, or a number out of range.
        """
        repeated = bool(wanted) and wanted[-1].repeated
        if repeated:
            wanted += wanted[-1:] * (len(texts) - len(wanted))
        if len(texts) != len(wanted):
            plural = "s" * (len(texts) != 1)
            raise SettingError(
                f"setting {self.setting}: {text!r} has {len(texts)} number{plural}, {kind!r} "
                f"takes {len(wanted)}{' or more' if repeated else ''}; allowed: {self.usage}"
            )
        return Spec(kind, tuple(self._number(n, t) for n, t in zip(wanted, texts, strict=True)))

    def _number(self, number: Number, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not number.low <= value <= number.high:
            raise SettingError(
                f"setting {self.setting}: {number.name} is {text!r}, allowed: {number.allowed}"
            )
        return value


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
