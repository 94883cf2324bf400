# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Computes a recorded run again and compares; the engine behind `sparse_coord verify`.

Step by step the world is computed from the logged actions, and each robot's agent is fed the
logged states, percepts and rewards. There are three results: the run is identical; it differs at a
time step in a quantity; or it is undecided from a time step on, because messages are missing in
the log, or code may not be imported. The first finding ends the computation.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from sparse_coord_ros.core.game.plugins import leaving_out
from sparse_coord_ros.log.runlog.agent_check import AgentCheck
from sparse_coord_ros.log.runlog.difference import Difference, Finding, Undecided
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.log.runlog.percept_check import PerceptCheck
from sparse_coord_ros.log.runlog.reading import read_run
from sparse_coord_ros.log.runlog.world_check import WorldCheck

LEFT_OUT = "robots' steps that the world made without their action"
RESETS = "episodes that began early (reset, or no robot left)"
UNLEARNED = "transitions from which a robot did not learn"
"""Names of the notes."""


TOLD_EVERY = 500
"""Time steps between two calls that say how far the computation is."""


@dataclass(frozen=True)
class Verification:
    """The result of `verify`.

    Attributes:
        log: the log.
        difference: the first difference; None: there is none up to where the run is undecided.
        undecided: from where on the run is undecided; None: nowhere, or there is a difference.
        notes: counts, by name, of irregularities that a run may have. They do not change the
            result.
        steps: number of the world's transitions that were computed again and agree.
        choices: number of actions that were computed again and agree.
        updates: number of updates of tables that were computed again.
        tables: number of recorded tables that were compared.
    """

    log: RunLog
    difference: Difference | None
    undecided: Undecided | None
    notes: Mapping[str, int]
    steps: int
    choices: int
    updates: int
    tables: int

    @property
    def same(self) -> bool:
        """True if the run is identical."""
        return self.first is None

    @property
    def first(self) -> Difference | Undecided | None:
        """The finding that ended the computation; None: the run is identical."""
        return self.difference or self.undecided


def verify(path: Path) -> Verification:
    """Read a recorded run, compute it again from its seed and its log alone, and compare.

    Args:
        path: as in `read_run`.

    Raises:
        BagError: the bag cannot be read, contains no run, or has another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    return verify_log(read_run(path))


def verify_log(
    log: RunLog, progress: Callable[[int, int], None] = lambda done, total: None
) -> Verification:
    """Compute a run again from its seed and its log alone, and compare.

    Args:
        log: the log.
        progress: called with the time steps done and those of the log, now and then.
    """
    comparison = _Comparison(log)
    finding = next(comparison.findings(progress), None) or comparison.left_out
    if isinstance(finding, Difference):
        finding = comparison.doubted(finding)
    world = comparison.world
    agents = comparison.agents
    return Verification(
        log=comparison.log,
        difference=finding if isinstance(finding, Difference) else None,
        undecided=finding if isinstance(finding, Undecided) else None,
        notes=comparison.notes(),
        steps=world.transitions,
        choices=sum(agent.choices for agent in agents),
        updates=sum(agent.updates for agent in agents),
        tables=sum(agent.compared for agent in agents),
    )


class _Comparison:
    """Compares a log.

    Args:
        log: the log.

    Attributes:
        log: the log.
        world: the check of the world.
        agents: the checks of the robots; empty if their learner may not be imported.
        left_out: what cannot be compared at all; None: all is.
    """

    def __init__(self, log: RunLog) -> None:
        self.log = log
        self.world = WorldCheck(log)
        self.left_out: Undecided | None = None
        self.agents: list[AgentCheck] = []
        self._percepts: list[PerceptCheck] = []
        robots = range(len(log.names))
        agents = [AgentCheck(log, k) for k in robots]
        self._places = [
            {step: index for index, step in enumerate(agent.trajectory.step.tolist())}
            for agent in agents
        ]
        with leaving_out("percepts", self._leave_out):
            self._percepts = [
                PerceptCheck(log, k, agents[k].trajectory) for k in robots
            ]
        with leaving_out("actions and tables", self._leave_out):
            _ = log.run.rule
            self.agents = [agents[k] for k in robots if self._publishes_tables(k)]

    def _leave_out(self, why: str) -> None:
        """Note what cannot be compared."""
        self.left_out = self.left_out or Undecided(0, why)

    def _publishes_tables(self, k: int) -> bool:
        """Return whether a robot's actions can be computed; note the reason if not."""
        why = self.log.why_not_computed(k)
        if why is not None:
            self._leave_out(why)
        return why is None

    def findings(self, progress: Callable[[int, int], None]) -> Iterator[Finding]:
        """Yield differences, and where the run is undecided; only the first one is valid."""
        log = self.log
        problems = deque(sorted(log.problems, key=lambda problem: problem.step))
        while problems and problems[0].step <= 0:
            yield problems.popleft()
        for agent in self.agents:
            yield from agent.begin()
        steps = self.world.steps
        for done, step in enumerate(steps):
            if done % TOLD_EVERY == 0:
                progress(done, len(steps))
            while problems and problems[0].step <= step:
                yield problems.popleft()
            yield from self.world.arrive(step)
            for agent in self.agents:
                yield from agent.decide(step)
            for index_of, percepts in zip(self._places, self._percepts, strict=False):
                if step in index_of:
                    yield from percepts.check(index_of[step])
            for agent in self.agents:
                yield from agent.act(step)
            yield from self.world.advance(step)
        yield from self.world.end()
        yield from problems
        for agent in self.agents:
            yield from agent.end()

    def doubted(self, difference: Difference) -> Finding:
        """Return a difference, or that the run is undecided if lost messages may explain it."""
        unsure = [self.world.unsure]
        unsure += [
            agent.unsure for agent in self.agents if agent.name == difference.robot
        ]
        steps = [step for step in unsure if step is not None]
        if not steps:
            return difference
        why = f"the log lacks messages, or a robot was left out; then {difference}"
        return Undecided(min(steps), why)

    def notes(self) -> dict[str, int]:
        """Return the notes of `Verification`."""
        counts = {
            LEFT_OUT: self.world.left_out,
            RESETS: self.world.resets,
            UNLEARNED: sum(agent.unlearned for agent in self.agents),
        }
        return {name: count for name, count in counts.items() if count}
