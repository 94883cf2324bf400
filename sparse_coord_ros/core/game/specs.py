# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings that name a kind and its numbers, written `kind` or `kind:number[:number ...]`.

`perception=probability:0.7`, `step_size=power:0.6` and `epsilon=linear:1:0.05:0.5` are such
settings. A family of them (the perception models, the schedules) is one `SpecFamily`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from sparse_coord_ros.base.errors import SettingError, did_you_mean
from sparse_coord_ros.core.game.plugins import of_file


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
        return in_range("a number", self.low, self.high)


def in_range(words: str, low: float, high: float) -> str:
    """Return the allowed range in words; an infinite limit means no bound."""
    if math.isinf(low):
        return words if math.isinf(high) else f"{words} of at most {_shown(high)}"
    if math.isinf(high):
        return f"{words} of at least {_shown(low)}"
    return f"{words} from {_shown(low)} to {_shown(high)}"


def _shown(number: float) -> str:
    return str(number) if isinstance(number, int) else f"{number:g}"


def probability(name: str) -> Number:
    """Return a number from 0 to 1."""
    return Number(name, 0.0, 1.0)


@dataclass(frozen=True)
class Spec:
    """A parsed setting: the kind and its numbers; `str()` writes it as it was read."""

    kind: str
    numbers: tuple[float, ...] = ()

    def __str__(self) -> str:
        """Return `kind[:number ...]`."""
        # repr() and not :g, which would round: the robots of a run read this text.
        return ":".join(
            [self.kind, *(repr(n).removesuffix(".0") for n in self.numbers)]
        )


class Form(NamedTuple):
    """One kind that a setting allows, e.g. `probability:P`.

    Attributes:
        kind: its name.
        meaning: one line.
        numbers: what follows the name.
    """

    kind: str
    meaning: str
    numbers: tuple[Number, ...] = ()

    @property
    def repeated(self) -> bool:
        """True if its last number can be given several times."""
        return bool(self.numbers) and self.numbers[-1].repeated

    @property
    def text(self) -> str:
        """Its form, e.g. `probability:P`; capital letters stand for numbers."""
        names = [number.name.upper() for number in self.numbers]
        return ":".join([self.kind, *names, *["..."] * self.repeated])


class SpecFamily:
    """The kinds that one setting allows, each with its numbers.

    Args:
        setting: the setting's name.
        forms: the kinds.
    """

    def __init__(self, setting: str, *forms: Form) -> None:
        self.setting = setting
        self._forms = forms

    @property
    def forms(self) -> tuple[Form, ...]:
        """The allowed forms, one for each kind."""
        return self._forms

    @property
    def usage(self) -> str:
        """The allowed forms, for help and error texts."""
        return ", ".join(form.text for form in self.forms)

    def parse(self, value: object) -> Any:
        """Read a setting's value, as a `Spec` where a family does not say otherwise.

        Raises:
            SettingError: unknown kind, wrong count of numbers, or a number out of range.
        """
        if isinstance(value, Spec):
            return value
        kind, *numbers = str(value).split(":")
        for form in self.forms:
            if form.kind == kind:
                return self.numbered(form, numbers)
        raise self.unknown(str(value), [form.kind for form in self.forms])

    def unknown(self, text: str, known: Sequence[str]) -> SettingError:
        """Return the error for an unknown kind; a lone number may lack its kind."""
        first = [form.kind for form in self.forms if len(form.numbers) == 1]
        hint = of_file(text) or did_you_mean(text.split(":")[0], known)
        if first and not math.isnan(_number(text)):
            hint = f" (did you mean '{first[0]}:{text}'?)"
        return SettingError(
            f"setting {self.setting}: unknown value {text!r}{hint}; allowed: {self.usage}"
        )

    def numbered(self, form: Form, texts: Sequence[str]) -> Spec:
        """Return a spec of a kind and the texts of its numbers.

        Raises:
            SettingError: wrong count of numbers, or a number out of range.
        """
        wanted = form.numbers
        if form.repeated:
            wanted += wanted[-1:] * (len(texts) - len(wanted))
        if len(texts) != len(wanted):
            plural = "s" * (len(texts) != 1)
            raise SettingError(
                f"setting {self.setting}: {':'.join([form.kind, *texts])!r} has {len(texts)} "
                f"number{plural}, {form.kind!r} takes {len(wanted)}"
                f"{' or more' if form.repeated else ''}; allowed: {self.usage}"
            )
        values = tuple(map(_number, texts))
        for number, value, text in zip(wanted, values, texts, strict=True):
            if not number.low <= value <= number.high:
                why = f"{number.name} is {text!r}, allowed: {number.allowed}"
                raise SettingError(f"setting {self.setting}: {why}")
        return Spec(form.kind, values)


class KindFamily(SpecFamily):
    """Kinds of which a setting names one or more: `together+swap`.

    A kind may stand in several variants, such as `block` and `block:anywhere`. Only one of them
    can be named.
    """

    @property
    def usage(self) -> str:
        """The allowed kinds, for help and error texts."""
        return f"{super().usage}; several are joined by '+'"

    def parse(self, value: object) -> str:
        """Read the kinds, and return them in the order of the forms, joined by '+'.

        Raises:
            SettingError: an unknown kind, or two variants of one.
        """
        if isinstance(value, list | dict):
            raise SettingError(
                f"setting {self.setting}: value is {value!r}, allowed: one text; write "
                "'together+swap'"
            )
        known = [form.kind for form in self.forms]
        texts = [text.strip() for text in str(value).split("+")]
        if len(texts) > 1 and "" in texts:
            raise SettingError(
                f"setting {self.setting}: {str(value)!r} has a '+' too many; leave it "
                f"out, allowed: {self.usage}"
            )
        for text in texts:
            if text not in known:
                raise self.unknown(text, known)
        bare = [text.split(":")[0] for text in texts]
        for kind in bare:
            if bare.count(kind) > 1:
                raise SettingError(
                    f"setting {self.setting}: {str(value)!r} names {kind!r} "
                    f"{bare.count(kind)} times, allowed: once; leave the others out"
                )
        return "+".join(kind for kind in known if kind in texts)


def _number(text: str) -> float:
    """Return a text as a number; NaN if it is no number."""
    try:
        return float(text)
    except ValueError:
        return math.nan
