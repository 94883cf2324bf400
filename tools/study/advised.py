# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The study of docs/when.md that tests the advice, on buildings that no threshold has seen."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np
import pandas as pd

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.unseen import KINDS, VERSIONS
from sparse_coord_ros.core.solve.advice import (
    AVOIDABLE,
    MAY_PAY,
    WILL_NOT_PAY,
    WILL_PAY,
    advice,
)
from sparse_coord_ros.studies.catalogue import (
    WHEN,
    WHEN_COSTS,
    WHEN_PENALTIES,
    WHEN_TEAM_PENALTIES,
)
from sparse_coord_ros.studies.conditions import Condition, make_condition
from sparse_coord_ros.studies.report.text import of
from sparse_coord_ros.studies.report.when import RESAMPLES, TINY, points
from tools.study.coordination import Found, Rows, Study

SEED = 6_100_000
"""Seed of the first team."""

FIRST = 6_000_000
"""Seed of the first building."""

SHAPES = ("2x1x4", "2x2x3", "4x1x3", "3x2x3")
"""Of generated offices."""

PAIRS = tuple(
    f"{VERSIONS[0]}-{kind}-2r-{FIRST + number}"
    for kind, number in product(KINDS, range(4))
) + tuple(
    f"building-{shape}-2r-{FIRST + number}"
    for shape, number in product(SHAPES, range(2))
)
"""Buildings of two robots, with a conflict or without."""

FOURS = tuple(
    f"{VERSIONS[0]}-{kind}-4r-{FIRST + number}"
    for kind, number in product(KINDS, range(3))
)
"""The same of four."""

GAMES: Mapping[str, tuple[Sequence[str], Mapping[str, Sequence[object]]]] = {
    "`together`": (PAIRS, {"penalty": WHEN_PENALTIES, "ask_cost": WHEN_COSTS}),
    "`together`, half of the questions answered": (
        PAIRS,
        {"penalty": WHEN_PENALTIES, "perception": ["probability:0.5"]},
    ),
    "`together`, four robots": (FOURS, {"penalty": WHEN_TEAM_PENALTIES}),
    "`swap`": (
        PAIRS,
        {
            "interactions": ["swap"],
            "penalty": WHEN_PENALTIES,
            "ask_cost": (1, 5),
        },
    ),
    "`block:anywhere`": (
        PAIRS,
        {"interactions": ["block:anywhere"], "ask_cost": (0.2, 1, 5, 20)},
    ),
}
"""Buildings, and settings that vary."""

FEW_QUESTIONS = 0.2
"""Of a robot in an episode: it hardly asks."""


def _table(found: Found) -> Rows:
    """Yield what became of each advice."""
    for game, (names, over) in GAMES.items():
        rows = [_judged(found, one) for one in _conditions(names, over)]
        data = pd.DataFrame(rows)
        data = data[data["gap"] > TINY]
        for said in (WILL_NOT_PAY, MAY_PAY, WILL_PAY, AVOIDABLE):
            own = data[data["advice"] == said]
            if len(own):
                yield {"interaction": game, "advice": said, **_row(own, said)}


def _conditions(
    names: Sequence[str], over: Mapping[str, Sequence[object]]
) -> Iterator[Condition]:
    for name in names:
        for values in product(*over.values()):
            changed = dict(zip(over, values, strict=True))
            yield make_condition(name, "factored", {**WHEN, **changed})


def _judged(found: Found, condition: Condition) -> dict[str, object]:
    """Return the point of a condition, and what was said of it beforehand."""
    result = found(condition)
    point = points([result]).iloc[0]
    said = {"advice": advice(result.scenario).kind}
    return said | {str(name): value for name, value in point.items()}


def _row(own: pd.DataFrame, said: str) -> dict[str, str]:
    close = own["half"]
    right: pd.Series | None = None
    few = (own["questions"] < FEW_QUESTIONS).astype(float)
    if said == WILL_NOT_PAY:
        right = few
    elif said == WILL_PAY:
        right = close
    elif said == AVOIDABLE:
        right = close * few
    return {
        "buildings": str(own["scenario"].nunique()),
        "conditions": str(len(own)),
        "close half of the gap": _percent(own, close),
        "questions": _with_error(own, own["questions"]),
        "advice right": "-" if right is None else _percent(own, right),
        "failed teams": of(int(own["failed"].sum()), int(own["teams"].sum())),
    }


def _percent(own: pd.DataFrame, value: pd.Series) -> str:
    mean, error = _mean(own, value)
    return f"{percent(mean, whole=True)} ({100.0 * error:.0f})"


def _with_error(own: pd.DataFrame, value: pd.Series) -> str:
    mean, error = _mean(own, value)
    return f"{mean:.2f} ({error:.2f})"


def _mean(own: pd.DataFrame, value: pd.Series) -> tuple[float, float]:
    """Return a mean over conditions, and its standard error: a bootstrap over buildings."""
    known = own.assign(value=value, count=1.0)[value.notna()]
    sums = known.groupby("scenario")[["value", "count"]].sum().to_numpy(dtype=float)
    number = len(sums)
    rng = np.random.default_rng(0)
    times = rng.multinomial(number, np.full(number, 1.0 / number), size=RESAMPLES)
    drawn = times @ sums
    error = (drawn[:, 0] / drawn[:, 1]).std(ddof=1) if number > 1 else np.nan
    return float(known["value"].mean()), float(error)


STUDIES = (Study("advised", (6, 6), 200, _table, seed=SEED, page="when.md"),)
