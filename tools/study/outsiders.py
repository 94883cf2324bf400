# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The search for the settings of each learner of docs/leaderboard.md: twelve trials for each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sparse_coord_ros.core.solve.shipped import known_top
from sparse_coord_ros.studies.catalogue import unseen_conditions
from sparse_coord_ros.studies.standings import Standing, standing
from tools.study import coordination, rules
from tools.study.coordination import Found, Rows, Study

PAGE = "leaderboard.md"
SEED = 3_100_000

Settings = Mapping[str, object]

TASKS = ((2, 10_000), (2, 100_000), (4, 100_000))
"""Robots and steps of learning by which settings are chosen, by the mean of the three shares."""

LIKE_FACTORED: Settings = {
    "epsilon": "linear:0.3:0.02:0.8",
    "starts": "exploring:1:0:0.5",
    "step_size": "floored:0.6:0.1:0.01",
}

PROTOCOLS: Sequence[Settings] = (
    {},
    {"epsilon": "linear:0.3:0.02:0.8"},
    {"epsilon": "linear:0.05:0.02:0.8"},
    {"step_size": "floored:0.6:0.1:0.01"},
    {"step_size": "floored:0.7:0.05:0.01"},
    {"step_size": "constant:0.1"},
    {"starts": "exploring:1:0:0.5"},
    {"starts": "exploring:1:0.2:0.8"},
    {"credit": "team"},
    LIKE_FACTORED,
    {**LIKE_FACTORED, "credit": "team"},
)
"""Settings that each learner but factored was tried with."""

AS_USERS_START: Settings = {
    "q_star_init": 0,
    "epsilon": "constant:0.1",
    "step_size": "constant:0.1",
    "starts": "fixed",
}
"""Plain Q-learning of a textbook: values begin at 0, everything else stays as it is."""

BAD_NEWS = ("Tenth", "Third", "Half")
"""Hysteretic learners, by beta / alpha."""


@dataclass(frozen=True)
class Trial:
    """One setting of a learner that was tried.

    Attributes:
        learner: the learner.
        settings: the changed settings.
    """

    learner: str
    settings: Settings

    def __str__(self) -> str:
        """Return it in words."""
        what = self.learner.partition(":")[2]
        said = [what] if what else []
        said += [f"{name}={value}" for name, value in self.settings.items()]
        return ", ".join(said) or "the defaults"


def _tried(
    learner: str, *more: Settings, always: Settings | None = None
) -> list[Trial]:
    given = [*PROTOCOLS, *more]
    return [Trial(learner, {**(always or {}), **one}) for one in given]


HYSTERETIC = [
    Trial(f"{rules.__name__}:{share}", settings)
    for share in BAD_NEWS
    for settings in (
        {},
        {"epsilon": "linear:0.3:0.02:0.8"},
        LIKE_FACTORED,
        {"step_size": "constant:0.1"},
    )
]

TRIALS: Mapping[str, Sequence[Trial]] = {
    "independent": _tried("noncoop", AS_USERS_START),
    "hysteretic": HYSTERETIC,
    "coop": _tried("coop", {"q_coord_init": 20}),
    "cq": _tried(
        "cq",
        {"starts": "exploring:1:0.5:0.8"},
        always={"peers": "all"},
    ),
    "joint": _tried("joint", {"starts": "exploring:1:0.5:0.8"}),
    "factored": [Trial("factored", one) for one in coordination.PROTOCOL.values()],
}
"""Twelve trials of each learner."""


def _stood(found: Found, trial: Trial) -> list[Standing]:
    """Return how a trial's teams stand in each of `TASKS` that its learner can learn."""
    tasks = TASKS[:2] if trial.learner == "joint" else TASKS
    stood = []
    for robots, steps in tasks:
        given = {**trial.settings, "steps": steps}
        made = unseen_conditions(trial.learner, "tuning", given, (robots,))
        stood.append(standing([found(one) for one in made], known_top))
    return stood


def _tuning(found: Found) -> Rows:
    """Yield each trial of each learner; the best of each learner is marked."""
    for learner, trials in TRIALS.items():
        judged = [_stood(found, trial) for trial in trials]
        means = [sum(one.share.mean for one in own) / len(own) for own in judged]
        for trial, stood, mean in zip(trials, judged, means, strict=True):
            row: dict[str, str | None] = {
                "learner": learner,
                "settings": str(trial),
                "chosen": "yes" if mean == max(means) else None,
            }
            for place, (robots, steps) in enumerate(TASKS):
                one = stood[place] if place < len(stood) else None
                said = None if one is None else _in_short(one)
                row[f"{robots}r, {steps:,} steps"] = said
            yield row


def _in_short(one: Standing) -> str:
    """Return the share of the gap with its error, and the number of failed teams."""
    share, _ = one.share_and_failed().split(";")
    return f"{share}; {one.failed}"


STUDIES = (Study("tuned", (6, 3), 200, _tuning, SEED, PAGE),)
