# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether what robots made of what they had learned is what follows from it (`engine.improve`)."""

from collections.abc import Sequence
from typing import NamedTuple

from sparse_coord_ros import wire
from sparse_coord_ros.engine.improve import improve
from sparse_coord_ros.errors import TablesError
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.simulation import tables_equal
from sparse_coord_ros.learn.tables import unpack_saved
from sparse_coord_ros.runlog.agents import AgentCheck
from sparse_coord_ros.runlog.difference import MISSING, Difference, first_entry
from sparse_coord_ros.runlog.log import RunLog


class Plans(NamedTuple):
    """What is odd about improved tables; how many robots kept theirs as a peer was silent."""

    odd: tuple[Difference, ...] = ()
    kept: int = 0


def check_plans(log: RunLog, team: Sequence[AgentCheck]) -> Plans:
    """Compare the improved tables in a log with those that follow from what was learned.

    Args:
        log: the log.
        team: each robot's, with its agent as it was at the end.
    """
    agents, statuses = [one.agent for one in team if one.agent is not None], log.tracks.statuses
    finished = statuses and statuses[-1].state == wire.RunState.FINISHED
    if not (log.run.improve and finished and len(agents) == len(log.names)):
        return Plans()
    due = improve(log.run.scenario, log.run.rule, [agent.memory() for agent in agents]).tables
    odd, kept = [], 0
    for k, name in enumerate(log.names):
        attachment = wire.improved_attachment(name)
        recorded = _recorded(log, attachment, k)
        if isinstance(recorded, str):
            odd.append(Difference(None, name, attachment, recorded, "improved tables"))
        elif tables_equal([recorded], [due[k]]):
            continue
        elif tables_equal([recorded], [agents[k].tables]):
            kept += 1
        else:
            entry, logged, computed = first_entry(recorded, due[k])
            odd.append(Difference(None, name, f"{attachment} {entry}", logged, computed))
    return Plans(tuple(odd), kept)


def _recorded(log: RunLog, attachment: str, k: int) -> Tables | str:
    """Return robot k's improved tables in the log, or what is there instead."""
    found = [one for one in log.bag.attachments if one.name == attachment]
    if not found:
        return MISSING
    try:
        return unpack_saved(found[-1].data, [k + 1], where=attachment)[0].tables
    except TablesError as error:
        return str(error)
