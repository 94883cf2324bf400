# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Trials of a user's own learner: do its two forms agree, and can its memory be saved?"""

import re
import sys
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from sparse_coord_ros.base.errors import PluginError, SparseCoordError
from sparse_coord_ros.core.game.plugins import is_shipped
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.core.learners.tables import memories_equal
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team

STEPS = 1000
"""Time steps that a learner of one's own makes in both forms before it is used compiled."""

TRIED_ON = "env1"

TELLING = (
    "No implementation of function",
    "Untyped global name",
    "Unknown attribute",
    "Cannot",
)
"""Beginnings of the lines in which numba says what it cannot compile."""

_tried: dict[type[Learner], bool] = {}


def agrees(learner: Learner) -> bool:
    """Return whether the compiled form of a learner can be used.

    Tests check this package's learners. A user's own learner learns for `STEPS` steps
    in both forms, once a process. If numba cannot compile it, or a bit differs (powers and
    exponentials do differ), it is said once, and the learner runs in plain Python.
    """
    rule = learner.Mind.learner
    if is_shipped(rule):
        return True
    if rule not in _tried:
        problem = _problem(learner)
        _tried[rule] = problem is None
        if problem is not None:
            said = f"learner {learner.label}: runs in plain Python, not compiled: {problem}"
            print(said, file=sys.stderr)
    return _tried[rule]


def _problem(learner: Learner) -> str | None:
    """Return why a learner cannot run compiled; None: it can."""
    scenario = learner.with_defaults(
        load_scenario(TRIED_ON).with_settings({"steps": STEPS})
    )
    plain = LearningRun(
        Team(scenario, learner, compiled=False), seed=0, gathering=False
    )
    plain.advance(STEPS)
    try:
        compiled = LearningRun(
            Team(scenario, learner, compiled=True), seed=0, gathering=False
        )
        compiled.advance(STEPS)
    except PluginError as error:  # plain Python has run it: numba cannot compile it
        return f"numba cannot compile it ({_reason(error)})"
    pairs = zip(plain.memories, compiled.memories, strict=True)
    if all(memories_equal(one, other) for one, other in pairs):
        return None
    return "it learns other numbers compiled than in plain Python"


def _reason(error: PluginError) -> str:
    """Return numba's innermost reason, the last line of its message."""
    lines = [line.strip() for line in str(error.__cause__).splitlines()]
    reasons = [line for line in lines if line.startswith(TELLING)]
    if not reasons:
        return type(error.__cause__).__name__
    return re.sub(r" at 0x[0-9a-f]+|\) found for signature:$", "", reasons[-1])


_kept: set[type[Learner]] = set()


def check_own_memory(learner: Learner) -> None:
    """Let a user's own learner learn a little, and check that its memory keeps its form.

    An array that begins with whole numbers and learns fractions, or changes its shape, could not
    be read back from files and logs. Learners without a memory of their own are not tried.

    Raises:
        PluginError: its memory does not keep its form.
    """
    rule = type(learner)
    if is_shipped(rule) or not learner.own_memory or rule in _kept:
        return
    _kept.add(rule)
    memories: Sequence[Memory] = ()
    with suppress(SparseCoordError):  # it may need another scenario, or fail by itself
        scenario = learner.with_defaults(
            load_scenario(TRIED_ON).with_settings({"steps": STEPS})
        )
        team = Team(scenario, learner, compiled=False)
        run = LearningRun(team, seed=0, gathering=False)
        run.advance(STEPS)
        memories = run.memories
    for k, memory in enumerate(memories):
        for name in learner.own_memory:
            begun = np.asarray(getattr(learner.mind(scenario, k), name))
            found = memory[name]
            if (found.dtype.kind, found.shape) != (begun.dtype.kind, begun.shape):
                _kept.discard(rule)
                raise PluginError(
                    f"learner {learner.label}: memory {name!r} begins as {begun.dtype} of "
                    f"shape {begun.shape} and becomes {found.dtype} of shape {found.shape}; "
                    "let it begin with the type and shape that it keeps, such as "
                    "np.zeros(shape)"
                )
