# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Check of the world's messages against a computed world with the logged actions.

`World` computes each step again from the seed and the logged actions. The motion of bodies cannot
be computed: if robots have bodies, the check takes the logged states, and compares everything that
follows from them.

Map and markers at each episode's start, and messages that are repeated after a silence, are
checked too.
"""

import struct
from collections import Counter, deque
from collections.abc import Iterator, Sequence

import numpy as np

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.game.world import Action, World
from sparse_coord_ros.core.learners.agent import NOBODY
from sparse_coord_ros.log.bags.metadata import SPLIT
from sparse_coord_ros.log.runlog.difference import (
    MISSING,
    TWICE,
    Difference,
    Unknown,
)
from sparse_coord_ros.log.runlog.log import NONE, RunLog, cell_numbers
from sparse_coord_ros.log.runlog.replay import Interval, Start
from sparse_coord_ros.log.runlog.run_messages import THE_CLOCK
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.lockstep.bodies import BodyWorld
from sparse_coord_ros.protocol.wire.status import RunStatus


class WorldCheck:
    """Compares the world's messages with those of a computed world.

    The rewards in the log show which robots acted: the world rewards exactly those. The others
    that had not arrived were left out; the status has their number.

    Args:
        log: the log.
        interval: the time steps to check; with the last one also the run's end.

    Attributes:
        world: the world, at the last computed time step.
        transitions: number of the world's steps that agree.
        left_out: number of (robot, step) pairs without the robot's action, including those before
            the interval.
        resets: number of episodes that began early: by a reset, or as the world had no robot left
            to wait for.
        starts: the first time steps of the episodes.
        went_on: whether the time step before was a transition.
        reasons: the possible reasons why the episode began.
        first: the first difference in states, rewards, clock or status, or None.
        lost_copies: copies of map, markers and coordination maps that may be lost, by topic,
            after `check`.
    """

    def __init__(self, log: RunLog, interval: Interval) -> None:
        messages = log.messages
        self.log = log
        self.interval = interval
        self.difference = messages.difference
        self.centres = np.array(log.frame.centres)
        self.world = World(log.run.scenario, log.run.seed)
        if log.run.bodies:
            self.world = BodyWorld(log.run.scenario, log.run.seed, slips=log.run.slips)
        self.robots = range(len(log.names))
        self.steps = self._steps_of_world()
        self.clock = set(messages.clock.step.tolist())
        self.rewarded = [set(series.step.tolist()) for series in messages.rewards]
        self.acted = [set(series.step.tolist()) for series in messages.actions]
        known = set(self.steps)
        self.statuses = deque(one for one in messages.statuses if one.step in known)
        self.move = log.move.tolist()
        self.asked = log.asked.tolist()
        self._centre_bytes = [centre.tobytes() for centre in self.centres]
        self._position_bytes = _bytes_of_robots(log.position)
        self._reward_bytes = _bytes_of_robots(log.rewards)
        self._packed = struct.Struct(f"={len(wire.REWARD.labels)}d").pack
        self.transitions = 0
        self.left_out = 0
        self.resets = 0
        self.lost_copies: Counter[str] = Counter()
        self.starts: list[int] = []
        self.went_on = False
        self.reasons: tuple[str, ...] = (wire.StartReason.START,)
        if interval.start is not None:
            self._go_on_from(interval.start)
        self.first = next(self._made_again(), None)

    def _steps_of_world(self) -> list[int]:
        """Return the time steps of the world; steps with only actions or percepts do not count."""
        messages = self.log.messages
        of_world = (*messages.states, *messages.rewards, messages.clock)
        steps = np.unique(np.concatenate([series.step for series in of_world]))
        return [step for step in steps.tolist() if self.interval.holds(step)]

    def _go_on_from(self, start: Start) -> None:
        """Continue from a checkpoint."""
        self.left_out = start.left_out
        self.world.go_on_from(start.position)
        self.reasons = tuple(wire.StartReason)
        if start.position.under_way:
            self.starts = [start.position.episode_start]
            self.went_on = True

    def check(self) -> list[Difference | Unknown]:
        """Return the differences in states, rewards, clock, status, map, markers and repeats."""
        first = [] if self.first is None else [self.first]
        return [
            *first,
            *self._missing_copies(),
            *self._maps_too_many(),
            *self._markers(),
            *self._repeats(),
        ]

    def _made_again(self) -> Iterator[Difference]:
        """Make the steps, and yield the differences; only the first one is valid."""
        for step in self.steps:
            yield from self._arrive(step)
            if step not in self.clock:
                yield Difference(step, None, THE_CLOCK, MISSING, "this step")
            yield from self._states(step)
            yield from self._statuses(step)
            self.went_on = any(step in steps for steps in self.rewarded)
            if self.went_on:
                yield from self._transition(step)
        if self.interval.last is None:
            yield from self._end()

    def _arrive(self, step: int) -> Iterator[Difference]:
        """Go to a time step of the log: the next one, or that of a new episode."""
        world = self.world
        due = world.step
        new_episode = bool(self.starts) and not self.went_on
        if new_episode:
            if world.transitions == world.scenario.steps:
                yield Difference(
                    step, None, wire.LOCAL_STATE.name, "there", "the run is over"
                )
            if step == due + 1:
                yield self._missing_transition(due)
            due += EPISODE_GAP
        if step != due:
            yield self.difference(due, 0, wire.LOCAL_STATE.name, MISSING, "a state")
        if new_episode:
            self.resets += not world.episode_over
            self.reasons = self._reasons()
            world.begin_episode()
        if not self.went_on:
            self.starts.append(step)

    def _missing_transition(self, step: int) -> Difference:
        """Return the difference for a time step without rewards that the world has passed."""
        for k in self.robots:
            if step in self.acted[k]:
                due = "one: it acted and the world went on"
                return self.difference(step, k, wire.REWARD.name, MISSING, due)
        due = "one: the world went on"
        return self.difference(step, 0, wire.ACTION.name, MISSING, due)

    def _reasons(self) -> tuple[str, ...]:
        """Return the possible reasons for the end of the world's episode."""
        if not self.world.episode_over:
            return wire.StartReason.RESET, wire.StartReason.NOBODY_LEFT
        if all(self.world.arrived):
            return (wire.StartReason.ARRIVED,)
        return (wire.StartReason.STEPS,)

    def _states(self, step: int) -> Iterator[Difference]:
        """Compare the robots' states with the world's."""
        log = self.log
        row = log.row_of.get(step)
        for k, cell in enumerate(self.world.cells):
            if row is None:
                words = wire.LOCAL_STATE.name, MISSING, self._place(self.centres[cell])
                yield self.difference(step, k, *words)
            elif self._position_bytes[k][row] != self._centre_bytes[cell]:
                yield from self._other_state(step, k, cell)
            log.cells[row, k] = cell

    def _other_state(self, step: int, k: int, cell: int) -> Iterator[Difference]:
        """Yield a difference for a wrong state, unless another message of the step is right."""
        series = self.log.messages.states[k]
        logged = self.log.position[self.log.row_of[step], k]
        due = self.centres[cell]
        if _take_right(logged, due, series.others.get(step, ())):
            return
        place = self._place(logged) if step in series.step else MISSING
        words = wire.LOCAL_STATE.name, place, self._place(due)
        yield self.difference(step, k, *words)

    def _place(self, where: np.ndarray) -> str:
        x, y = where.tolist()
        cell = self.log.frame.cell(x, y)
        return f"{'no free cell' if cell is None else f'cell {cell}'} ({x!r}, {y!r})"

    def _statuses(self, step: int) -> Iterator[Difference]:
        """Compare the statuses up to a time step with the world's counts."""
        right: set[str] = set()
        wrong: list[tuple[str, Difference]] = []
        while self.statuses and self.statuses[0].step <= step:
            status = self.statuses.popleft()
            words = self._wrong_count(status)
            if words is None:
                right.add(status.state)
            else:
                found = self.difference(status.step, None, wire.STATUS.name, *words)
                wrong.append((status.state, found))
        for state, found in wrong:
            # Beside a right status of the same state, a wrong one may be from a foreign node.
            if state in right:
                self.log.messages.foreign.append(found)
            else:
                yield found

    def _wrong_count(self, status: RunStatus) -> tuple[str, str] | None:
        """Return the first wrong count of a status, as (logged, computed)."""
        if status.transitions != self.world.transitions:
            return f"{status.transitions} transitions", f"{self.world.transitions}"
        if status.left_out != self.left_out:
            return f"{status.left_out} robots' steps left out", f"{self.left_out}"
        if status.began not in self.reasons:
            return f"episode began: {status.began}", " or ".join(self.reasons)
        return None

    def _transition(self, step: int) -> Iterator[Difference]:
        """Let the world make a transition with the actions of the robots that the log rewards."""
        world = self.world
        row = self.log.row_of[step]
        rewarded = [k for k in self.robots if step in self.rewarded[k]]
        left = [k for k in self.robots if k not in rewarded and not world.arrived[k]]
        for k in rewarded:
            yield from self._rewarded(step, k)
        if left:
            yield from self._left_out(step, left)
        actions: list[Action | None] = [None] * len(self.robots)
        for k in rewarded:
            actions[k] = Action(self.move[row][k], self.asked[row][k], NOBODY, False)
        if isinstance(world, BodyWorld):
            yield from self._bodies(world, step)
        outcome = world.advance(actions)
        for k in rewarded:
            due = outcome.rewards[k]
            if self._reward_bytes[k][row] != self._packed(*due):
                yield from self._other_reward(step, k, due)
        self.transitions += 1
        self.left_out += len(left)

    def _other_reward(
        self, step: int, k: int, due: Sequence[float]
    ) -> Iterator[Difference]:
        """Yield a difference for a wrong reward, unless another message of the step is right."""
        logged = self.log.rewards[self.log.row_of[step], k]
        others = self.log.messages.rewards[k].others.get(step, ())
        if not _take_right(logged, np.array(due, dtype=np.float64), others):
            words = wire.REWARD.name, _parts(logged.tolist()), _parts(due)
            yield self.difference(step, k, *words)

    def _bodies(self, world: BodyWorld, step: int) -> Iterator[Difference]:
        """Put the bodies into the cells of the next states; yield missing states."""
        after = self.log.row_of.get(step + 1)
        for k in self.robots:
            cell = NONE if after is None else int(self.log.cells[after, k])
            if cell == NONE:
                yield self.difference(
                    step + 1, k, wire.LOCAL_STATE.name, MISSING, "a state"
                )
            world.there[k] = cell

    def _rewarded(self, step: int, k: int) -> Iterator[Difference]:
        """Yield a difference if a robot's reward of a time step is impossible."""
        row = self.log.row_of[step]
        world = self.world
        over = world.episode_over or world.transitions == world.scenario.steps
        if over or world.arrived[k]:
            logged = f"{tuple(self.log.rewards[row, k].tolist())}"
            computed = "none" if over else "none: it has arrived"
            yield self.difference(step, k, wire.REWARD.name, logged, computed)
        elif step not in self.acted[k]:
            yield self.difference(
                step, k, wire.ACTION.name, MISSING, "one, for it is rewarded"
            )
        elif self.move[row][k] == NONE:
            logged = f"(east, north) {tuple(self.log.numbers[row, k, :2].tolist())}"
            yield self.difference(step, k, wire.ACTION.name, logged, "an action")

    def _left_out(self, step: int, left: Sequence[int]) -> Iterator[Difference]:
        """Yield a missing reward or action: by its status, the world left out fewer robots."""
        if not self.statuses:
            return
        if self.left_out + len(left) <= self.statuses[0].left_out:
            return
        due = "one, for the world does not say that it left the robot out"
        acted = [k for k in left if step in self.acted[k]]
        if acted:
            yield self.difference(step, acted[0], wire.REWARD.name, MISSING, due)
        else:
            yield self.difference(step, left[0], wire.ACTION.name, MISSING, due)

    def _end(self) -> Iterator[Difference]:
        """Check that the log contains the run's end, and ends there."""
        world = self.world
        status = (self.world.step, None, wire.STATUS.name)
        left = world.scenario.steps - world.transitions
        end = next(reversed(self.log.messages.statuses), None)
        if self.went_on or (world.episode_over and left):
            due = world.step + (0 if self.went_on else EPISODE_GAP)
            yield self.difference(due, 0, wire.LOCAL_STATE.name, MISSING, "a state")
        elif end is None or end.state not in wire.OVER:
            logged = MISSING if end is None else repr(end.state)
            yield self.difference(*status, logged, "the end of the run")
        elif end.step != world.step:
            yield self.difference(
                *status, f"time step {end.step}", "the last time step"
            )
        elif (end.state == wire.RunState.FINISHED) != (left == 0):
            yield self.difference(
                *status, repr(end.state), f"{left} steps of the budget left"
            )

    def _missing_copies(self) -> Iterator[Difference | Unknown]:
        """Yield the maps, markers and coordination maps that are missing at an episode's start."""
        messages = self.log.messages
        yield from self._missing_of(wire.MAP, None, messages.maps)
        if self.log.run.markers_tell_steps:
            yield from self._missing_of(wire.MARKERS, None, messages.markers[0])
        for k, (steps, _) in enumerate(messages.coordination_maps):
            if self.log.why_not_computed(k) is None:
                yield from self._missing_of(wire.COORDINATION_MAP, k, steps)

    def _missing_of(
        self, topic: wire.Topic, k: int | None, steps: np.ndarray
    ) -> Iterator[Difference | Unknown]:
        """Yield the episode starts without a message of a topic; lost copies are counted.

        ROS keeps only the last message of these topics for a slow recorder. So a missing copy is
        lost if the topic has others, and no foreign message is in its place.
        """
        name = self.log.messages.topic(topic, k)
        has_others = self.log.bag.counts.get(name, 0) > 0
        until = self.interval.last
        if until is not None:  # a gap follows: only starts before the last copy count
            until = min(until, int(steps.max(initial=0)))
        for step in sorted(set(self.starts) - set(steps.tolist())):
            if until is not None and step > until:
                continue
            if k is not None and step not in self.acted[k]:
                continue
            if has_others and not self._foreign_near(step, name, topic):
                self.lost_copies[name] += 1
            elif self.log.messages.incomplete:
                yield Unknown(step, step, f"a message of {name} is not in the log")
            else:
                words = topic.name, MISSING, "one as the episode begins"
                yield self.difference(step, k, *words)

    def _foreign_near(self, step: int, name: str, topic: wire.Topic) -> bool:
        """Return whether a foreign message of a topic is near a time step."""
        quantities = (f"topic {name}", f"{topic.name} stamp")
        return any(
            one.step is not None
            and one.quantity in quantities
            and abs(one.step - step) <= EPISODE_GAP
            for one in self.log.messages.foreign
        )

    def _maps_too_many(self) -> Iterator[Difference]:
        """Yield repeated maps, and maps of time steps at which no episode begins."""
        maps = self.log.messages.maps
        # A restarted recorder receives the last map a second time.
        restarts = sum(
            (file.continued or {}).get("why", SPLIT) != SPLIT
            for file in self.log.bag.files
        )
        twice = maps[1:][np.diff(maps) == 0].tolist()
        for step in twice[restarts:]:
            yield Difference(step, None, wire.MAP.name, TWICE, "once")
        until = self.world.step
        if self.interval.last is not None:
            until = min(until, self.interval.last)
        beside = ~np.isin(maps, [0, *self.starts]) & (maps <= until)
        for step in maps[beside].tolist():
            words = wire.MAP.name, "there", "none: no episode begins"
            yield Difference(step, None, *words)

    def _markers(self) -> Iterator[Difference]:
        """Yield markers whose robots are in other cells than their states."""
        log = self.log
        steps, rows = log.messages.markers
        for step, (_, places) in zip(steps.tolist(), rows.tolist(), strict=True):
            row = log.row_of.get(step)
            if row is None:
                continue
            stated = log.position[row]
            if not np.isnan(stated).any() and (stated != places).any():
                logged = f"robots in cells {cell_numbers(log.frame, places).tolist()}"
                computed = f"in {log.cells[row].tolist()}"
                yield Difference(step, None, wire.MARKERS.name, logged, computed)

    def _repeats(self) -> Iterator[Difference]:
        """Yield repeated messages without a reason.

        The world repeats state and last reward together, to a robot whose action it misses; only
        then the robot repeats its action. A percept is never repeated. A world that went back to
        a checkpoint has no reward to repeat before its next step.
        """
        returned = {one.step for one in self.log.messages.rollbacks}
        for k in self.robots:
            states, rewards, actions, percepts = (
                Counter(series.repeats.tolist())
                for series in self.log.messages.of_robot(k)
            )
            after_rewards = {step + 1 for step in rewards}
            for step in sorted({*states, *actions, *percepts, *after_rewards}):
                before = step - 1
                due = states[step] if before in self.rewarded[k] else 0
                if step in percepts:
                    yield self.difference(step, k, wire.PERCEPT.name, TWICE, "once")
                if actions[step] > states[step]:
                    words = wire.ACTION.name, TWICE, "once, as its state"
                    yield self.difference(step, k, *words)
                if rewards[before] > due:
                    yield self.difference(before, k, wire.REWARD.name, TWICE, "once")
                elif rewards[before] < due and step not in returned:
                    words = wire.LOCAL_STATE.name, TWICE, "once, as its reward"
                    yield self.difference(step, k, *words)


def _bytes_of_robots(numbers: np.ndarray) -> list[list[bytes]]:
    """Return numbers, shape (T, K, n), as bytes: [robot][row], n numbers each."""
    size = numbers.shape[2] * numbers.itemsize
    found = []
    for k in range(numbers.shape[1]):
        data = numbers[:, k].tobytes()
        found.append([data[at : at + size] for at in range(0, len(data), size)])
    return found


def _take_right(
    logged: np.ndarray, due: np.ndarray, others: Sequence[np.ndarray]
) -> bool:
    """Replace the logged numbers by those of another message that equal the computed ones.

    Returns:
        True if there is such a message.
    """
    if any(other[1].tobytes() == due.tobytes() for other in others):
        logged[:] = due
        return True
    return False


def _parts(numbers: Sequence[float]) -> str:
    pairs = zip(wire.REWARD.labels, map(float, numbers), strict=True)
    return " ".join(f"{label}={number!r}" for label, number in pairs)
