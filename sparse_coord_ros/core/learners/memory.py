# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of robots' memories from files and messages."""

import numpy as np

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.base.npz import member
from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.mind import Memory, memory_before
from sparse_coord_ros.core.learners.table import LearnedRows, Table


def check_memory(
    scenario: Scenario, learner: Learner, k: int, memory: Memory
) -> Memory:
    """Check the memory of a robot from a file or a message.

    Args:
        scenario: the problem.
        learner: its learner.
        k: the robot, from 0.
        memory: the memory to check.

    Returns:
        The memory, without arrays that the learner does not know.

    Raises:
        TablesError: an array is missing, or is not as robots of this scenario and learner have it.
    """
    try:
        return _checked(scenario, learner, k, memory)
    except (ValueError, LookupError, TypeError) as error:
        who = f"robot {k + 1} of scenario {scenario.name} with learner {learner.label}"
        remedy = "use the tables of a run of this scenario and learner"
        raise TablesError(f"tables do not match {who}: {error}; {remedy}") from None


def _checked(scenario: Scenario, learner: Learner, k: int, memory: Memory) -> Memory:
    mind = learner.begun(scenario, k)
    checked: dict[str, np.ndarray] = {}
    for name, value in mind._asdict().items():
        if name in learner.scratch:
            continue
        if isinstance(value, Table):
            _check_rows(memory, name, value)
            names = [f"{name}_{what}" for what in LearnedRows._fields]
        else:
            _check_array(memory, name, np.asarray(value))
            names = [name]
        checked |= {name: memory[name] for name in names}
    return checked


def _check_array(memory: Memory, name: str, begun: np.ndarray) -> None:
    """Check an array: type and shape are the initial ones, with numbers where those have some."""
    kind = np.int64 if begun.dtype.kind == "i" else begun.dtype
    array = member(memory, name, kind, *begun.shape)
    if kind != np.float64:
        return
    nothing = np.isnan(begun)
    _check_finite(array[~nothing], name)
    if not np.isnan(array[nothing]).all():
        raise ValueError(
            f"{name} has values of {ACTIONS[-1]}, which this learner never chooses"
        )


def _check_rows(memory: Memory, name: str, begun: Table) -> None:
    """Check a table of rows: its keys are those of joint states, each with a row of numbers."""
    keys = member(memory, f"{name}_keys", np.int64, None)
    if keys.max(initial=0) >= begun.most:
        raise ValueError(f"{name}_keys are not those of joint states of this scenario")
    columns = begun.values.shape[1]
    values = member(memory, f"{name}_values", np.float64, len(keys), columns)
    _check_finite(values, f"{name}_values")
    counts = begun.updates.shape[1]
    member(memory, f"{name}_updates", np.int64, len(keys), counts)


def _check_finite(values: np.ndarray, name: str) -> None:
    if not np.isfinite(values).all():
        raise ValueError(f"{name} has values that are no finite numbers")


def taught(scenario: Scenario, learner: Learner, k: int, memory: Memory) -> Memory:
    """Return the initial memory of a robot that learns on from the values of another run.

    It has the learned values; its counts begin at 0.

    Args:
        scenario: the problem.
        learner: the learner that continues.
        k: the robot, from 0.
        memory: the memory of the other run; it is checked already.
    """
    memory_of_robot = dict(memory_before(learner, scenario, k))
    for name in learner.values:
        if name in memory_of_robot:
            memory_of_robot[name] = memory[name]
        else:
            memory_of_robot[f"{name}_keys"] = memory[f"{name}_keys"]
            memory_of_robot[f"{name}_values"] = memory[f"{name}_values"]
            memory_of_robot[f"{name}_updates"] = np.zeros_like(
                memory[f"{name}_updates"]
            )
    return memory_of_robot
