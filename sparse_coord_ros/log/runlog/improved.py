# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Check that robots' plans follow from their tables (`core.engine.improve`)."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sparse_coord_ros.core.engine.improve import improve
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.core.runs.tables import COUNT, saved_arrays
from sparse_coord_ros.log.runlog.agents import AgentCheck
from sparse_coord_ros.log.runlog.attached import read_plans
from sparse_coord_ros.log.runlog.difference import (
    Difference,
    Unknown,
    first_entry,
)
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.protocol import wire


def plans_due(log: RunLog) -> bool:
    """Return whether a run's robots make plans: it has `improve`, and its budget was used up."""
    statuses = log.messages.statuses
    if not log.run.improve or not statuses:
        return False
    return statuses[-1].state == wire.RunState.FINISHED


def check_plans(log: RunLog, team: Sequence[AgentCheck]) -> list[Difference | Unknown]:
    """Compare the plans in a log with those that follow from the robots' tables.

    Args:
        log: the log.
        team: each robot's check, with its agent at the run's end; empty: it is unknown.
    """
    found: list[Difference | Unknown] = []
    plans, problems = read_plans(log.bag, log.run)
    found += problems
    if not plans_due(log):
        for plan in plans:
            found.append(_difference(log, plan.robot, "there", "none: no plan is due"))
        return found
    agents = [one.agent for one in team if one.agent is not None]
    if len(agents) < len(log.names):
        return found
    unreadable = {one.robot for one in problems}
    planned = {plan.robot for plan in plans}
    end = int(log.step.max(initial=0))
    for one in team:
        if one.k not in planned and one.name not in unreadable:
            why = f"{one.name} made no plan (stopped before that?)"
            found.append(Unknown(end, None, why))
    if not plans:
        return found
    ends_unknown = [one.name for one in team if not one.end_known]
    if ends_unknown:
        why = (
            f"no log of whether {', '.join(ends_unknown)} learned from the last action"
        )
        found.append(Unknown(end, None, f"{why}: plans are not compared"))
        return found
    memories = [agent.memory() for agent in agents]
    due = improve(log.run.scenario, log.run.rule, memories).tables
    for plan in sorted(plans, key=lambda plan: plan.robot):
        k = plan.robot
        found += _check_plan(team[k], plan.arrays, due[k].memory, memories[k])
    return found


def _check_plan(
    robot: AgentCheck, arrays: Mapping[str, np.ndarray], due: Memory, own: Memory
) -> Iterator[Difference | Unknown]:
    """Yield the differences of a robot's plan from the computed one.

    Args:
        robot: the robot's check.
        arrays: the arrays of its plan.
        due: the computed plan.
        own: the robot's memory at the run's end.
    """
    k = robot.k
    counts = robot.last_counts
    if counts is None:  # its last tables are missing, which `AgentCheck` reports
        counts = {name: int(arrays.get(f"{COUNT}{name}", 0)) for name in wire.COUNTS}
    entry = first_entry(arrays, saved_arrays({k + 1: due}, counts=counts), k)
    if entry is None:
        return
    if first_entry(arrays, saved_arrays({k + 1: own}, counts=counts), k) is None:
        why = f"{robot.name} kept its own tables instead of a plan"
        because = "as if a peer did not send its tables, which the log does not hold"
        yield Unknown(robot.end, None, f"{why}, {because}")
    else:
        name, logged, computed = entry
        yield _difference(robot.log, k, logged, computed, name)


def _difference(
    log: RunLog, k: int, logged: str, computed: str, entry: str = ""
) -> Difference:
    name = log.names[k]
    quantity = f"{wire.improved_attachment(name)} {entry}".rstrip()
    return Difference(None, name, quantity, logged, computed)
