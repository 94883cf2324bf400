# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One robot's side of the lock step, as a state machine without ROS.

`state`, `peer_state`, `reward` and `answer` receive messages, in any order between topics, perhaps
twice. The robot acts through `RobotPort`. The result depends on the messages' content, never on
their times.
"""

from collections import deque
from typing import NamedTuple, Protocol

from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.agent import Agent, Choice, Decision
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol.lockstep.saving import saves
from sparse_coord_ros.protocol.wire import COUNTS, PerceptEnd, SelfReport

NO_STEP = 0
"""The step of a request by a person, who does not know the time step."""

BEFORE_ANY_STEP = -1

ASKS = COUNTS[:4]
"""Counters of the ends of percepts, and of repeated requests; see `RobotSide.asks`."""


class RobotPort(Protocol):
    """The actions of a robot on its surroundings."""

    def ask(self, peer: int, step: int, cell: int) -> None:
        """Request the peer's local state of a time step; `cell` is the asker's own."""

    def act(self, step: int, action: Action, report: SelfReport) -> None:
        """Publish the action that answers the local state of a time step."""

    def percept(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> None:
        """Publish the result of COORDINATE: the peers' cells, or None for a failed percept."""

    def episode(self, step: int) -> None:
        """An episode begins for this robot at a time step, before its action there."""

    def checkpoint(self, step: int) -> None:
        """Publish and save: the tables contain exactly the learning before a time step."""


class Answer(NamedTuple):
    """The asked robot's side of COORDINATE.

    Attributes:
        step: the asked robot's time step; older than the request's: it is not there yet.
        cell: its local state, or None: not perceived.
    """

    step: int
    cell: int | None


class RobotState(NamedTuple):
    """The state of a robot from which it continues with the same bits.

    Attributes:
        step: the time step; the memory contains exactly the learning before it.
        cell: its local state X_k(step).
        transitions: transitions that it has seen.
        episode_start: the time step at which the episode began.
        learned_last: whether its next action reports that it has learned from the one before.
        counts: `RobotSide.asks`, `learned` and `dropped`, in this order.
        memory: its agent's memory.
    """

    step: int
    cell: int
    transitions: int
    episode_start: int
    learned_last: bool
    counts: tuple[int, ...]
    memory: Memory


class RobotSide:
    """Drives one `Agent` by messages.

    Args:
        run: the run.
        agent: the agent; its number is the robot's place in the scenario.
        port: the robot's actions on its surroundings.

    Attributes:
        run: the run.
        newest: the last local state received, as (step, cell); step 0 before the first.
        asks: numbers of its percepts by their ends: "answered" (by every asked peer), "refused"
            (by one of them), "late" (no answer by the deadline); and the number of requests that
            were "repeated" because the peer was a step behind.
        transitions: transitions that it has seen.
        learned: transitions from which it has learned.
        save_at: a time step at which all save, beside every `checkpoint` steps; 0: none.
        dropped: transitions without learning, because the reward or a peer's state did not come.
    """

    def __init__(self, run: RunConfig, agent: Agent, port: RobotPort) -> None:
        self.run = run
        self.newest = (NO_STEP, -1)
        self.save_at = 0
        self._asks_before: tuple[int, ...] = ()
        self._port = port
        self._checkpoint = run.checkpoint
        self._max_steps = run.scenario.max_steps
        self._budget = run.scenario.steps
        self._robots = len(run.scenario.robots)
        self._sees_all = run.sees_all
        # the cells of all robots by time step, as far as it has heard of them
        self._cells_at: dict[int, dict[int, int]] = {}
        self._due = False  # it chooses when it knows the cells of all robots
        self._states: deque[tuple[int, int]] = deque()
        self._reward: Reward | None = None
        self._choice: Choice | None = None  # its outcome is not known yet
        # published beside it
        self._self_report = SelfReport(PerceptEnd.DID_NOT_ASK, False)
        self._asked: Decision | None = None  # its peers are asked, one after the other
        self._seen: tuple[int, ...] = ()  # cells of the peers that have answered
        self._percepts = Percepts(run.scenario, run.seed)
        self.go_on_from(agent, None)

    @property
    def waiting(self) -> tuple[str, int] | None:
        """The message with a deadline that the robot waits for, and its time step.

        "percept"; or "reward", which its peers' states belong to if it sees them. When its
        deadline passes, call `expire`.
        """
        if self._asked is not None:
            return ("percept", self._handled)
        if self._states and self._choice is not None:
            return ("reward", self._handled)
        return None

    @property
    def handled(self) -> int:
        """The time step of the tables: of the last local state that was processed.

        They contain all learning before it; 0 before the first state.
        """
        return max(self._handled, NO_STEP)

    @property
    def asking(self) -> int:
        """The peer whose answer it waits for, or -1."""
        return -1 if self._asked is None else self._asked.peers[len(self._seen)]

    @property
    def counts(self) -> dict[str, int]:
        """The numbers stored beside its tables: `wire.COUNTS`."""
        counts = {
            "dropped": self.dropped,
            "learned": self.learned,
            "step": self.handled,
        }
        return {**self.asks, **counts}

    def state(self, step: int, cell: int) -> None:
        """Process the robot's own local state X_k of a time step."""
        if self._sees_all:
            self._note(self.agent.number, step, cell)
        if step <= self.newest[0]:
            self._repeat(step, cell)
            return
        self.newest = (step, cell)
        self._states.append((step, cell))
        # if it still asks, or still waits to choose, the world has continued without it
        self._asked = None
        self._due = False
        self._go_on()

    def peer_state(self, peer: int, step: int, cell: int) -> None:
        """Process a peer's local state of a time step, which only `run.sees_all` needs."""
        self._note(peer, step, cell)
        if self._due:
            self._choose_when_due()
        else:
            self._go_on()

    def reward(self, step: int, reward: Reward) -> None:
        """Process R_k of the action at a time step."""
        if self._choice is not None and step == self._handled:
            self._reward = reward
            self._go_on()

    def answer(self, peer: int, request_step: int, answer: Answer) -> None:
        """Process a peer's answer to the request of a time step."""
        step = self._handled
        asked = self._asked
        if asked is None or step != request_step or self.asking != peer:
            return
        if answer.step < step:
            self.asks["repeated"] += 1
            self._port.ask(peer, step, self._cell)
        elif answer.step > step or answer.cell is None:
            self._act(None, PerceptEnd.REFUSED)
        else:
            self._seen += (answer.cell,)
            if len(self._seen) < len(asked.peers):
                self._port.ask(self.asking, step, self._cell)
            else:
                self._act(self._seen, PerceptEnd.ANSWERED)

    def expire(self) -> None:
        """The deadline on `waiting` has passed: a failed percept, or no learning."""
        if self._asked is not None:
            self._act(None, PerceptEnd.LATE)
        elif self.waiting is not None:
            self.dropped += 1
            self._choice = None
            self._go_on()

    def asked(self, asker: int, step: int, asker_cell: int | None) -> Answer:
        """Answer a peer's request; the environment's perception model decides.

        Args:
            asker: the asking agent's number.
            step: the time step of the request; 0 from a person, who gets the newest state.
            asker_cell: the cell of the asker; None if its position is no free cell.
        """
        own_step, own_cell = self.newest
        if step == NO_STEP:
            return Answer(own_step, own_cell if own_step != NO_STEP else None)
        if own_step != step or asker_cell is None:
            return Answer(own_step, None)
        seen = self._percepts.sees(step, asker, asker_cell, own_cell)
        return Answer(own_step, own_cell if seen else None)

    def snapshot(self) -> RobotState:
        """Return the robot's state, a copy, at the time step `handled`.

        An agent learns only when it processes a state, so this may be called at any time.
        """
        # It will choose the same action at this step again.
        chosen = self._asked is not None or self._choice is not None
        asks = self._asks_before if chosen else self.asks.values()
        told = self._learned_last if self._choice is None else self._self_report.learned
        here = self.handled, self._cell, self.transitions, self._episode_start
        return RobotState(
            *here, told, (*asks, self.learned, self.dropped), self.agent.memory()
        )

    def self_report_of(self, step: int) -> SelfReport | None:
        """Return the robot's self-report of a time step; None: it is not the current step."""
        return (
            self._self_report
            if self._choice is not None and step == self._handled
            else None
        )

    def go_on_from(self, agent: Agent, state: RobotState | None) -> None:
        """Continue from an earlier state of this robot, and drop all newer messages.

        Messages in flight belong to the time that is taken back: subscribe anew.

        Args:
            agent: a fresh agent of the run.
            state: the state; None: the run's beginning.
        """
        self.agent = agent
        self._states.clear()
        self._cells_at.clear()
        self._due = False
        self._reward = self._choice = self._asked = None
        if state is not None:
            agent.go_on_from(state.memory)
        begin = (BEFORE_ANY_STEP, -1, 0, NO_STEP, False, (0,) * (len(ASKS) + 2))
        (
            step,
            cell,
            self.transitions,
            self._episode_start,
            self._learned_last,
            counts,
        ) = begin if state is None else state[:-1]
        self._handled = step
        self._cell = cell
        self.newest = (max(step, NO_STEP), cell)
        *asks, self.learned, self.dropped = counts
        self.asks = dict(zip(ASKS, asks, strict=True))

    def _go_on(self) -> None:
        """Process the received states, as far as their rewards and answers are there."""
        while self._states:
            step, cell = self._states[0]
            before = self._handled
            if self._choice is not None and step == before + 1:
                if self._reward is None:
                    return
                if self._sees_all and self._lacks_cells(step):
                    return
                self._learn(self._choice, self._reward, step, cell)
            self._choice = self._reward = None
            self._states.popleft()
            if step == before + 1:
                self.transitions += 1
            else:
                self._episode_start = step
                self._port.episode(step)
            self._handled = step
            self._cell = cell
            if saves(before, step, self._checkpoint, self.save_at):
                self._port.checkpoint(step)
            if self._states:
                continue  # the world has gone on
            if not self._rests(step, cell):
                self._choose_when_due()

    def _learn(self, choice: Choice, reward: Reward, step: int, cell: int) -> None:
        """Learn from the transition to a state."""
        before = self._handled
        team = None
        if self._sees_all:
            team = (self._all_cells(before), self._all_cells(step))
            for old in [earlier for earlier in self._cells_at if earlier < step]:
                del self._cells_at[old]
        self.agent.learn(before, choice, reward, cell, team)
        self._learned_last = self.agent.learning
        self.learned += self.agent.learning

    def _repeat(self, step: int, cell: int) -> None:
        """The world repeats a state because the action is missing: repeat it, or choose it."""
        if self._choice is not None and self._handled == step:
            self._port.act(step, self._choice.action, self._self_report)
        elif self._asked is None and self._handled == step and not self._done(cell):
            self._choose_when_due()

    def _note(self, robot: int, step: int, cell: int) -> None:
        """Note the cell of a robot at a time step."""
        if step >= self._handled:
            self._cells_at.setdefault(step, {})[robot] = cell

    def _lacks_cells(self, step: int) -> bool:
        """Return whether it does not know yet all cells of a time step from which it learns."""
        return len(self._cells_at.get(step, ())) < self._robots

    def _all_cells(self, step: int) -> tuple[int, ...]:
        """Return the cells of all robots at a time step."""
        cells = self._cells_at[step]
        return tuple(cells[k] for k in range(self._robots))

    def _rests(self, step: int, cell: int) -> bool:
        """Return whether no action is due: arrived, end of the episode, or end of the run."""
        return self._done(cell) or step - self._episode_start >= self._max_steps

    def _done(self, cell: int) -> bool:
        """Return whether it has arrived in a cell, or the run's budget is used."""
        return cell == self.agent.goal or self.transitions >= self._budget

    def _choose_when_due(self) -> None:
        """Choose an action; before it, all cells from which it will learn must be known."""
        self._due = self._sees_all and self._lacks_cells(self._handled)
        if not self._due:
            self._choose()

    def _choose(self) -> None:
        if self._handled == self._episode_start:
            self.agent.begin_episode()
        self._asks_before = tuple(self.asks.values())
        decision = self._asked = self.agent.decide(self._handled, self._cell)
        self._seen = ()
        if decision.peers:
            self._port.ask(self.asking, self._handled, self._cell)
        elif decision.action == COORDINATE:
            self._act(None, PerceptEnd.NOBODY_TO_ASK)
        else:
            self._act(None, PerceptEnd.DID_NOT_ASK)

    def _act(self, perceived: tuple[int, ...] | None, ended: PerceptEnd) -> None:
        decision = self._asked
        self._asked = None
        assert decision is not None
        step = self._handled
        cell = self._cell
        if ended in (PerceptEnd.ANSWERED, PerceptEnd.REFUSED, PerceptEnd.LATE):
            self.asks[ended.words] += 1
        action = self.agent.act(step, cell, decision, perceived)
        report = self._self_report = SelfReport(ended, self._learned_last)
        self._learned_last = False
        self._choice = Choice(self._cell, decision, action, perceived)
        if action.asked:
            self._port.percept(step, cell, perceived)
        self._port.act(step, action, report)
