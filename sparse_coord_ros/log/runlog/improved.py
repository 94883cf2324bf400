# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether robots' plans follow from what they had learned (`core.engine.improve`)."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sparse_coord_ros.core.engine.improve import improve
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.core.runs.tables import COUNT, saved_arrays
from sparse_coord_ros.log.runlog.agents import AgentCheck
from sparse_coord_ros.log.runlog.attached import read_plans
from sparse_coord_ros.log.runlog.difference import MISSING, Difference, first_entry
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.protocol import wire

OWN_TABLES = "what the robot had learned"
"""In place of a plan: a robot keeps that where a peer does not say what it has learned."""


def plans_due(log: RunLog) -> bool:
    """Whether the robots of a run make plans: it says so, and its budget was used up."""
    statuses = log.tracks.statuses
    return (
        log.run.improve
        and bool(statuses)
        and statuses[-1].state == wire.RunState.FINISHED
    )


def check_plans(log: RunLog, team: Sequence[AgentCheck]) -> list[Difference]:
    """Compare the plans in a log with those that follow from what was learned.

    Args:
        log: the log.
        team: each robot's check, with its agent as it was at the end.
    """
    plans, found = read_plans(log.bag, log.run)
    if not plans_due(log):
        return found + [
            _odd(log, plan.robot, "there", "none: no plan is due") for plan in plans
        ]
    agents = [one.agent for one in team if one.agent is not None]
    if len(agents) < len(log.names):
        return found  # what a robot remembers is not known
    there = {one.robot for one in found} | {log.names[plan.robot] for plan in plans}
    found += [
        _odd(log, one.k, MISSING, "a plan") for one in team if one.name not in there
    ]
    if not plans:
        return found
    memories = [agent.memory() for agent in agents]
    due = improve(log.run.scenario, log.run.rule, memories).tables
    for plan in sorted(plans, key=lambda plan: plan.robot):
        k = plan.robot
        found += _of_plan(team[k], plan.arrays, due[k].memory, memories[k])
    return found


def _of_plan(
    robot: AgentCheck, arrays: Mapping[str, np.ndarray], due: Memory, own: Memory
) -> Iterator[Difference]:
    """Yield in what a robot's plan is another one.

    Args:
        robot: the robot's check.
        arrays: those of its plan.
        due: what it ought to be.
        own: what the robot had learned.
    """
    log = robot.log
    k = robot.k
    counts = robot.last_counts
    if counts is None:  # its last tables are missing, which is said elsewhere
        counts = {name: int(arrays.get(f"{COUNT}{name}", 0)) for name in wire.COUNTS}
    odd = first_entry(arrays, saved_arrays({k + 1: due}, counts=counts), k)
    if odd is None:
        return
    if first_entry(arrays, saved_arrays({k + 1: own}, counts=counts), k) is None:
        yield _odd(log, k, OWN_TABLES, "a plan")
    else:
        entry, logged, computed = odd
        yield _odd(log, k, logged, computed, entry)


def _odd(
    log: RunLog, k: int, logged: str, computed: str, entry: str = ""
) -> Difference:
    name = log.names[k]
    quantity = f"{wire.improved_attachment(name)} {entry}".rstrip()
    return Difference(None, name, quantity, logged, computed)
