# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Check of a robot's logged actions and tables against a computed agent."""

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.learners.mind import Memory, memory_before
from sparse_coord_ros.core.runs.saved_tables import saved_arrays
from sparse_coord_ros.log.runlog.difference import (
    Difference,
    Finding,
    Undecided,
    first_entry,
)
from sparse_coord_ros.log.runlog.log import RecordedTables, RunLog
from sparse_coord_ros.log.runlog.replay import Replay, agent_with, trajectory_of
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.messages import action_numbers


def first_memory(log: RunLog, k: int) -> tuple[Memory | None, Difference | None]:
    """Return a robot's memory at the run's beginning, and its difference from the log's tables.

    The memory is None if it is missing in the log.
    """
    run = log.run
    first = [
        tables for tables in log.all_tables if (tables.robot, tables.step) == (k, 0)
    ]
    if run.tables or run.greedy:
        return (first[0].tables.memory if first else None), None
    fresh = memory_before(run.rule, run.scenario, k)
    if not first:
        return fresh, None
    due = saved_arrays({k + 1: fresh})
    logged = {name: first[0].arrays.get(name) for name in due}
    entry = first_entry(logged, due, k)
    if entry is None:
        return fresh, None
    return fresh, Difference(0, log.names[k], *_of_tables(entry))


def _of_tables(entry: tuple[str, str, str]) -> tuple[str, str, str]:
    """Return a difference of arrays as one of tables: quantity, logged, computed."""
    name, logged, computed = entry
    return f"{wire.TABLES.name} {name}", logged, computed


class AgentCheck:
    """Compares one robot's actions and tables with those of an agent fed from the log.

    Call `begin`; for each time step, in their order, `decide`, then `act`; at the end `end`. The
    first finding ends the check.

    Args:
        log: the log.
        k: the robot's number.

    Attributes:
        trajectory: the robot's actions in the log.
        choices, updates, compared: numbers of actions, updates and tables that agree.
        name: the robot's name.
        unsure: the first time step of which the log may lack the robot's action, and with it
            whether the robot learned from the one before; None: there is none since the last
            tables that agree.
    """

    def __init__(self, log: RunLog, k: int) -> None:
        self.trajectory = trajectory_of(log, k)
        self.choices = 0
        self.updates = 0
        self.compared = 0
        self.name = log.names[k]
        self.unsure: int | None = None
        self._log = log
        self._k = k
        recorded = [tables for tables in log.all_tables if tables.robot == k]
        self._recorded = sorted(recorded, key=lambda tables: tables.step)
        self._tables = deque(self._recorded)
        self._due = deque(self._due_steps())
        self._replay: Replay | None = None

    @property
    def unlearned(self) -> int:
        """Transitions of the world from which the robot has not learned."""
        if self._log.run.greedy:
            return 0
        trajectory = self.trajectory
        rewarded = ~np.isnan(self._log.column("individual")[trajectory.row, self._k])
        return int((rewarded & ~trajectory.learned)[: self.choices].sum())

    def begin(self) -> Iterator[Finding]:
        """Make the agent as it is at the run's beginning, and compare its tables."""
        memory, difference = first_memory(self._log, self._k)
        if difference is not None:
            yield difference
        if memory is None:
            yield self._not_there(0)
            return
        agent = agent_with(self._log, self._k, memory)
        self._replay = Replay(self._log, self.trajectory, agent)
        yield from self._compare_tables(0)

    def decide(self, step: int) -> Iterator[Finding]:
        """Compare the tables up to a time step, then whether the robot asks there."""
        yield from self._compare_tables(step)
        index = self.choices
        if not self._acts_at(step):
            return
        assert self._replay is not None
        yield from self._learned_before(index)
        asks = self._replay.decide().action == COORDINATE
        if asks != self._log.asked[self.trajectory.row[index], self._k]:
            yield Difference(
                step,
                self.name,
                wire.ACTION.name,
                f"coordinate={not asks:d}",
                f"coordinate={asks:d}",
            )

    def act(self, step: int) -> Iterator[Finding]:
        """Compare the action of a time step, if there is one; its percept must be right."""
        index = self.choices
        if not self._acts_at(step):
            return
        assert self._replay is not None
        if not self._replay.advance(index + 1):
            assert self._replay.other is not None
            yield self._other_action(index, self._replay.other)
        self.choices += 1
        learns = not self._log.run.greedy and self.trajectory.learned[index]
        self.updates += bool(learns)

    def end(self) -> Iterator[Finding]:
        """Check that the log has the robot's last tables, and none after the last time step."""
        acted = int(self.trajectory.step.max(initial=0))
        newest = max((tables.step for tables in self._recorded), default=0)
        if newest < acted:
            why = f"{self.name} saved no tables at its end (killed?)"
            yield Undecided(acted, why)
        if self._tables:
            step = self._tables[0].step
            yield Undecided(step, f"the states of time step {step} are not in the log")

    # Actions.

    def _acts_at(self, step: int) -> bool:
        """Return whether the robot's next action is of a time step."""
        index = self.choices
        steps = self.trajectory.step
        return index < len(steps) and steps[index] == step

    def _learned_before(self, index: int) -> Iterator[Finding]:
        """Check that an action's number `learned` is possible."""
        step = int(self.trajectory.step[index])
        logged = self._log.column("learned")[self.trajectory.row[index], self._k]
        if logged == 0.0:
            self._may_lack_an_action(index)
            return
        words = wire.ACTION.name, f"learned={logged:g}"
        if logged != 1.0 or self._log.run.greedy or not index:
            possible = logged == 1.0
            due = "0: there was nothing to learn from" if possible else "0 or 1"
            yield Difference(step, self.name, *words, due)
        elif not self.trajectory.told[index - 1]:
            before = int(self.trajectory.step[index - 1])
            why = f"{self.name} learned from time step {before}, of which the log lacks messages"
            yield Undecided(before, why)

    def _may_lack_an_action(self, index: int) -> None:
        """Note if the robot did not act in the step after its action before, as far as is logged.

        An action there, which came too late for the world, would say whether it learned.
        """
        trajectory = self.trajectory
        if not index or not trajectory.told[index - 1] or self._log.run.greedy:
            return
        goal = self._log.run.scenario.robots[self._k].goal
        next_step = int(trajectory.step[index - 1]) + 1
        could_act = (
            trajectory.step[index] > next_step
            and trajectory.next_cell[index - 1] != goal
        )
        if could_act and self.unsure is None:
            self.unsure = next_step

    def _other_action(self, index: int, computed: Action) -> Difference:
        """Return the difference for an action that the agent does not choose."""
        logged = self._log.numbers[self.trajectory.row[index], self._k]
        words = different_numbers(logged, action_numbers(computed))
        step = int(self.trajectory.step[index])
        return Difference(step, self.name, wire.ACTION.name, *words)

    # Tables.

    def _due_steps(self) -> list[int]:
        """Return the time steps of the robot's start and its checkpoints."""
        log = self._log
        every = log.run.checkpoint
        states = log.series[wire.LOCAL_STATE, self._k].step
        if not every or not len(states):
            return [0]
        # A robot has processed a state when it acts on it, or rests at the goal.
        rows = np.searchsorted(log.step, states)
        acted = log.move[rows, self._k] >= 0
        rests = log.cells[rows, self._k] == log.run.scenario.robots[self._k].goal
        crossed = states[:-1] // every < states[1:] // every
        due = crossed & (acted | rests)[1:]
        return [0, *states[1:][due].tolist()]

    def _not_there(self, step: int) -> Undecided:
        why = f"the tables of {self.name} of time step {step} are not in the log"
        return Undecided(step, why)

    def _compare_tables(self, step: int) -> Iterator[Finding]:
        """Compare the recorded tables up to a time step, before the action there."""
        recorded = set()
        while self._tables and self._tables[0].step <= step:
            entry = self._tables.popleft()
            recorded.add(entry.step)
            yield from self._compare(entry)
            self.compared += 1
            self.unsure = None
        while self._due and self._due[0] <= step:
            due = self._due.popleft()
            if due not in recorded:
                yield self._not_there(due)

    def _compare(self, entry: RecordedTables) -> Iterator[Finding]:
        """Compare tables and the counts beside them with the agent's."""
        assert self._replay is not None
        counts = self._due_counts(entry, self.choices)
        acts = self.choices < len(self.trajectory.step)
        if acts and entry is self._recorded[-1]:
            # A robot may save its last tables after its action at their time step.
            after = self._due_counts(entry, self.choices + 1)
            counts = after if entry.counts == after else counts
        memory = self._replay.agent.memory()
        due = saved_arrays({self._k + 1: memory}, counts=counts)
        words = first_entry(entry.arrays, due, self._k)
        if words is not None:
            quantity = _of_tables(words)
            yield Difference(entry.step, self.name, *quantity)

    def _due_counts(self, entry: RecordedTables, end: int) -> dict[str, int]:
        """Return the counts beside tables, with the percepts of the first `end` actions."""
        ended = self._log.column(wire.PERCEPT.name)[self.trajectory.row[:end], self._k]
        ends = wire.PerceptEnd
        counts = {
            way.words: int((ended == way).sum())
            for way in (ends.ANSWERED, ends.REFUSED, ends.LATE)
        }
        counts["learned"] = int(self.trajectory.learned[: self.choices].sum())
        counts["step"] = entry.step
        # The log does not show these faults of the network; only a bound of one.
        unlearned = self.choices - counts["learned"]
        counts["dropped"] = min(max(entry.counts.get("dropped", 0), 0), unlearned)
        counts["repeated"] = entry.counts.get("repeated", 0)
        return counts


def different_numbers(logged: np.ndarray, computed: Sequence[float]) -> tuple[str, str]:
    """Return the numbers of an action that differ, as words: logged, computed."""
    pairs = zip(wire.ACTION_LABELS, logged.tolist(), computed, strict=False)
    different = [(name, a, b) for name, a, b in pairs if repr(a) != repr(b)]
    return (
        " ".join(f"{name}={a:g}" for name, a, _ in different),
        " ".join(f"{name}={b:g}" for name, _, b in different),
    )
