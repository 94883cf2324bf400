# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a log is what its seed and Algorithm 1 say: `verify`."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sparse_coord_ros.runlog.agents import AgentCheck
from sparse_coord_ros.runlog.difference import Difference
from sparse_coord_ros.runlog.episode_maps import check_world_maps
from sparse_coord_ros.runlog.log import RunLog, read_run
from sparse_coord_ros.runlog.percepts import check_percepts
from sparse_coord_ros.runlog.repeats import check_repeats, repeat_count
from sparse_coord_ros.runlog.world import check_world


@dataclass(frozen=True)
class Verification:
    """What `verify` found.

    Attributes:
        log: the log.
        differences: in the order of time; of what each robot's agent and the world compute only
            the first, as all that follows from it differs too.
        steps: transitions of the world that were computed again and agree.
        choices: actions that were computed again; updates: of tables.
        tables: recorded tables that were compared.
        left_out: robots' steps that the world went on without.
        dropped: transitions that a left-out robot has not learned from, as its tables show.
        resets: episodes that began early.
        repeats: messages that came again after a silence.
        unchecked: time steps at the end of an unfinished log that are not checked.
    """

    log: RunLog
    differences: tuple[Difference, ...]
    steps: int
    choices: int
    updates: int
    tables: int
    left_out: int
    dropped: int
    resets: int
    repeats: int
    unchecked: int

    @property
    def same(self) -> bool:
        """Whether the log is whole and nothing differs."""
        return not self.differences

    @property
    def first(self) -> Difference | None:
        """The first difference."""
        return self.differences[0] if self.differences else None


def verify(path: Path) -> Verification:
    """Compute a recorded run again from its seed and its log, and compare.

    Raises:
        BagError: nothing can be read, or the bag holds no run.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    log = read_run(path)
    last = log.last_step
    unchecked = 0 if last is None else int(np.count_nonzero(log.step > last))
    within = [p for p in log.problems if last is None or p.step is None or p.step <= last]
    percepts, found = check_percepts(log, last)
    differences = [*found, *within, *check_repeats(log, last)]
    world = check_world(log, last)
    differences += [] if world.difference is None else [world.difference]
    differences += check_world_maps(log, world.starts, world.end, last)
    choices = updates = tables = dropped = 0
    for k in range(len(log.names)):
        agent = AgentCheck(log, k, percepts, world.left_out, last)
        difference = agent.follow()
        dropped += len(agent.dropped)
        differences += [] if difference is None else [difference]
        differences += [*agent.maps.missing, *agent.without_tables()]
        choices, updates = choices + agent.choices, updates + agent.updates
        tables += agent.compared
    return Verification(
        log=log,
        differences=tuple(sorted(dict.fromkeys(differences), key=lambda one: one.rank)),
        steps=world.transitions,
        choices=choices,
        updates=updates,
        tables=tables,
        left_out=len(world.left_out),
        dropped=dropped,
        resets=world.resets,
        repeats=repeat_count(log),
        unchecked=unchecked,
    )
