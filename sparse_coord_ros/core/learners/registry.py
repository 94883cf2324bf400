# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners by their names: this package's and the user's own."""

from sparse_coord_ros.core.game.plugins import (
    Registry,
    allow_named,
    failing_as,
    is_shipped,
)
from sparse_coord_ros.core.learners.baselines import Indiv, NonCoop
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.cq import CQ
from sparse_coord_ros.core.learners.hysteretic import Hysteretic
from sparse_coord_ros.core.learners.joint import Joint
from sparse_coord_ros.core.learners.learner import Learner, check_attributes
from sparse_coord_ros.core.learners.voi import Voi


def _learner(name: str, thing: object) -> Learner:
    made = thing
    if isinstance(thing, type) and issubclass(thing, Learner):
        with failing_as(f"learner {name!r}", "being made"):
            made = thing()
    if not isinstance(made, Learner):
        remedy = (
            "it must be a subclass of sparse_coord_ros.Learner, or an instance of one"
        )
        raise TypeError(f"is no learner; {remedy}")
    check_attributes(made)
    if not is_shipped(made) and made.name in LEARNERS.installed:
        made.entry_point = made.name
    return made


LEARNERS: Registry[Learner] = Registry("learner", "sparse_coord_ros.learners", _learner)
"""Every learner, by what it is called in files."""

for _shipped in (
    Coop(),
    NonCoop(),
    Indiv(),
    Hysteretic(),
    Voi(),
    CQ(),
    Joint(),
):
    LEARNERS.register(_shipped.label, _shipped)


LearnerLike = str | Learner | type[Learner]


def chosen_learner(learner: LearnerLike) -> Learner:
    """Return a learner by its name; naming it here allows its module to be imported."""
    allow_named(learner)
    return learner_of(learner)


def learner_of(learner: LearnerLike) -> Learner:
    """Return a learner by its name; learners and their classes are taken as they are.

    Raises:
        SettingError: unknown learner.
    """
    if isinstance(learner, str):
        return LEARNERS.find(learner)
    made = LEARNERS.made(repr(learner), learner)
    known = LEARNERS.registered.get(made.label)
    if isinstance(learner, type) and type(known) is learner:
        return known
    return LEARNERS.register(made.label, made)


def register_learner(learner: "Learner | type[Learner]") -> Learner:
    """Register the user's own learner under its attribute `name`, in this process.

    Files name it as `module:Class`, so other processes and later calls find it. The name of an
    entry point of the group `sparse_coord_ros.learners` in an installed package also works.

    Raises:
        SettingError: it is no learner, or its name is invalid or taken.
    """
    made = LEARNERS.made(repr(learner), learner)
    return LEARNERS.register(made.name or made.label, made)
