# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world once more, from the seed and the logged actions: `World` makes each step again.

Where robots have bodies these make the moves, and nobody can compute where they get: the states
are taken as they are logged, and all that follows from them is compared.

And what comes more than once: map and markers with each episode, messages again after a silence.
"""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.game.world import Action, World
from sparse_coord_ros.core.learners.agent import NOBODY
from sparse_coord_ros.log.bags.metadata import SPLIT
from sparse_coord_ros.log.runlog.difference import MISSING, Difference
from sparse_coord_ros.log.runlog.log import NONE, RunLog, cell_numbers
from sparse_coord_ros.log.runlog.replay import Stretch
from sparse_coord_ros.log.runlog.tracks import THE_CLOCK
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.lockstep.bodies import BodyWorld


class WorldCheck:
    """A world that makes the logged steps, as long as it comes to the logged states and rewards.

    The log says who acted: the world rewards exactly those. The others that had not arrived were
    left out; the status says how many.

    Args:
        log: the log.
        stretch: the time steps to check; with the last one also the run's end.

    Attributes:
        world: the world, in the last time step that was computed.
        transitions: steps of the world that agree.
        left_out: number of (robot, step) that the world made without the robot's action; also
            those before the stretch.
        resets: episodes that began early: by a reset, or as no robot was left to wait for.
        starts: the first time steps of the episodes.
        went_on: whether the time step before was a transition.
        reasons: why the episode can have begun.
        first: the first difference in states, rewards, clock or status; None: there is none.
    """

    def __init__(self, log: RunLog, stretch: Stretch) -> None:
        self.log = log
        self.stretch = stretch
        self.odd = log.tracks.odd
        self.centres = np.array(log.frame.centres)
        run = log.run
        self.world = World(run.scenario, run.seed)
        if run.bodies:
            self.world = BodyWorld(run.scenario, run.seed, slips=run.slips)
        self.robots = range(len(log.names))
        tracks = log.tracks
        # Steps that only actions or percepts speak of are not the world's.
        of_world = (*tracks.states, *tracks.rewards, tracks.clock)
        steps = np.unique(np.concatenate([track.step for track in of_world])).tolist()
        self.steps = [step for step in steps if stretch.holds(step)]
        self.clock = set(tracks.clock.step.tolist())
        self.rewarded = [set(track.step.tolist()) for track in tracks.rewards]
        self.acted = [set(track.step.tolist()) for track in tracks.actions]
        known = set(self.steps)
        self.statuses = [status for status in tracks.statuses if status.step in known]
        self.move = log.move.tolist()
        self.asked = log.asked.tolist()
        self.parts = len(wire.REWARD.labels) + bool(log.run.scenario.referee)
        self.transitions = self.left_out = self.resets = 0
        self.starts: list[int] = []
        self.went_on = False
        self.reasons: tuple[str, ...] = (wire.Began.START,)
        if stretch.start is not None:
            position, self.left_out, _ = stretch.start
            self.world.go_on_from(position)
            self.reasons = tuple(wire.Began)
            if position.under_way:
                self.starts = [position.episode_start]
                self.went_on = True
        self.first = next(self._made_again(), None)

    def differences(self) -> list[Difference]:
        """Return in what states, rewards, clock, status, map, markers and repeats differ."""
        first = [] if self.first is None else [self.first]
        return [*first, *self._maps(), *self._markers(), *self._repeats()]

    def _made_again(self) -> Iterator[Difference]:
        """Make the steps, and yield what differs; what comes after that makes no sense."""
        for step in self.steps:
            yield from self._arrive(step)
            if step not in self.clock:
                yield Difference(step, None, THE_CLOCK, MISSING, "this step")
            yield from self._states(step)
            yield from self._statuses(step)
            self.went_on = any(step in steps for steps in self.rewarded)
            if self.went_on:
                yield from self._transition(step)
        if self.stretch.last is None:
            yield from self._end()

    def _arrive(self, step: int) -> Iterator[Difference]:
        """Come to a time step of the log: the next one, or that of a new episode."""
        world = self.world
        due = world.step
        if self.starts and not self.went_on:
            if world.transitions == world.scenario.steps:
                yield Difference(
                    step, None, wire.LOCAL_STATE.name, "there", "the run is over"
                )
            if step == due + 1:
                acted = [k for k in self.robots if due in self.acted[k]]
                what = (acted[0], wire.REWARD.name) if acted else (0, wire.ACTION.name)
                also = "it acted and " if acted else ""
                yield self.odd(due, *what, MISSING, f"one: {also}the world went on")
            due += EPISODE_GAP
        if step != due:
            yield self.odd(due, 0, wire.LOCAL_STATE.name, MISSING, "a state")
        if self.starts and not self.went_on:
            self.reasons = (wire.Began.RESET, wire.Began.NOBODY_LEFT)
            if world.episode_over:
                self.reasons = (
                    wire.Began.ARRIVED if all(world.arrived) else wire.Began.STEPS,
                )
            self.resets += not world.episode_over
            world.begin_episode()
        if not self.went_on:
            self.starts.append(step)

    def _states(self, step: int) -> Iterator[Difference]:
        log = self.log
        row = self.log.row_of.get(step)
        for k, cell in enumerate(self.world.cells):
            track = log.tracks.states[k]
            due = self.centres[cell]
            if row is None or not _says(
                log.position[row, k], due, track.others.get(step, ())
            ):
                logged = (
                    self._place(log.position[row, k]) if step in track.step else MISSING
                )
                yield self.odd(step, k, wire.LOCAL_STATE.name, logged, self._place(due))
            log.cells[row, k] = cell

    def _place(self, where: np.ndarray) -> str:
        x, y = where.tolist()
        cell = self.log.frame.cell(x, y)
        return f"{'no free cell' if cell is None else f'cell {cell}'} ({x!r}, {y!r})"

    def _statuses(self, step: int) -> Iterator[Difference]:
        """Compare what the world says of itself with what was counted."""
        odd: list[tuple[str, Difference]] = []
        right: set[str] = set()
        while self.statuses and self.statuses[0].step <= step:
            status = self.statuses.pop(0)
            if status.transitions != self.world.transitions:
                words = f"{status.transitions} transitions", f"{self.world.transitions}"
            elif status.left_out != self.left_out:
                words = f"{status.left_out} robots' steps left out", f"{self.left_out}"
            elif status.began not in self.reasons:
                words = f"episode began: {status.began}", " or ".join(self.reasons)
            else:
                right.add(status.state)
                continue
            odd.append(
                (status.state, self.odd(status.step, None, wire.STATUS.name, *words))
            )
        # Where the world was right about this step in the same state, a stranger may have spoken.
        self.log.tracks.suspects += [one for state, one in odd if state in right]
        yield from (one for state, one in odd if state not in right)

    def _transition(self, step: int) -> Iterator[Difference]:
        """Let the world make a transition with the actions of whom the log rewards."""
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
            said = self.log.rewards[row, k, : self.parts]
            due = np.array(outcome.rewards[k][: self.parts], dtype=np.float64)
            if not _says(said, due, self.log.tracks.rewards[k].others.get(step, ())):
                parts = _parts(said.tolist()), _parts(due.tolist())
                yield self.odd(step, k, wire.REWARD.name, *parts)
        self.transitions += 1
        self.left_out += len(left)

    def _bodies(self, world: BodyWorld, step: int) -> Iterator[Difference]:
        """Let the bodies be where the next states say; yield which of these are missing."""
        after = self.log.row_of.get(step + 1)
        for k in self.robots:
            cell = NONE if after is None else int(self.log.cells[after, k])
            if cell == NONE:
                yield self.odd(step + 1, k, wire.LOCAL_STATE.name, MISSING, "a state")
            world.there[k] = cell

    def _rewarded(self, step: int, k: int) -> Iterator[Difference]:
        """Yield why a robot cannot have been rewarded in a time step."""
        row = self.log.row_of[step]
        world = self.world
        over = world.episode_over or world.transitions == world.scenario.steps
        if over or world.arrived[k]:
            logged = f"{tuple(self.log.rewards[row, k, : self.parts].tolist())}"
            computed = "none" if over else "none: it has arrived"
            yield self.odd(step, k, wire.REWARD.name, logged, computed)
        elif step not in self.acted[k]:
            yield self.odd(
                step, k, wire.ACTION.name, MISSING, "one, for it is rewarded"
            )
        elif self.move[row][k] == NONE:
            logged = f"(east, north) {tuple(self.log.numbers[row, k, :2].tolist())}"
            yield self.odd(step, k, wire.ACTION.name, logged, "an action")

    def _left_out(self, step: int, left: Sequence[int]) -> Iterator[Difference]:
        """Yield whose reward or action is missing, as the world says that it left out fewer."""
        if self.statuses and self.left_out + len(left) > self.statuses[0].left_out:
            acted = [k for k in left if step in self.acted[k]]
            quantity = wire.REWARD.name if acted else wire.ACTION.name
            due = "one, for the world does not say that it left the robot out"
            yield self.odd(step, (acted or left)[0], quantity, MISSING, due)

    def _end(self) -> Iterator[Difference]:
        """The log must say how the run ended, and end there."""
        world = self.world
        status = (self.world.step, None, wire.STATUS.name)
        left = world.scenario.steps - world.transitions
        end = next(reversed(self.log.tracks.statuses), None)
        if self.went_on or (world.episode_over and left):
            due = world.step + (0 if self.went_on else EPISODE_GAP)
            yield self.odd(due, 0, wire.LOCAL_STATE.name, MISSING, "a state")
        elif end is None or end.state not in wire.OVER:
            logged = MISSING if end is None else repr(end.state)
            yield self.odd(*status, logged, "the end of the run")
        elif end.step != world.step:
            yield self.odd(*status, f"step {end.step}", "the last step")
        elif (end.state == wire.RunState.FINISHED) != (left == 0):
            yield self.odd(*status, repr(end.state), f"{left} steps of the budget left")

    def _maps(self) -> Iterator[Difference]:
        """Yield what is missing of what is shown as an episode begins, and maps too many."""
        log = self.log
        last = self.stretch.last
        maps = self.log.tracks.maps
        of_robots = enumerate(log.tracks.coordination_maps)
        shown: list[tuple[int | None, wire.Topic, np.ndarray]] = [
            (None, wire.MAP, maps)
        ]
        shown += [
            (k, wire.COORDINATION_MAP, at)
            for k, (at, _) in of_robots
            if not log.hides(k)
        ]
        if log.run.markers_tell_steps:
            shown.append((None, wire.MARKERS, log.tracks.markers[0]))
        for k, topic, steps in shown:
            # Where a gap follows, only those before the last one that was shown.
            until = np.inf if last is None else min(last, steps.max(initial=0))
            for step in sorted(set(self.starts) - set(steps.tolist())):
                if step <= until and (k is None or step in self.acted[k]):
                    yield self.odd(
                        step, k, topic.name, MISSING, "one as the episode begins"
                    )
        # A recorder that was started again gets the last one a second time.
        again = sum(
            (file.continued or {}).get("why", SPLIT) != SPLIT for file in log.bag.files
        )
        for step in maps[1:][np.diff(maps) == 0].tolist()[again:]:
            yield Difference(step, None, wire.MAP.name, "twice", "once")
        until = self.world.step if last is None else min(self.world.step, last)
        for step in maps[~np.isin(maps, [0, *self.starts]) & (maps <= until)].tolist():
            yield Difference(
                step, None, wire.MAP.name, "there", "none: no episode begins"
            )

    def _markers(self) -> Iterator[Difference]:
        """Yield where markers show robots elsewhere than they are."""
        log = self.log
        for step, (_, places) in zip(
            *map(np.ndarray.tolist, log.tracks.markers), strict=True
        ):
            row = log.row_of.get(step)
            if row is None:
                continue
            stated = log.position[row]
            if not np.isnan(stated).any() and (stated != places).any():
                logged = f"robots in cells {cell_numbers(log.frame, places).tolist()}"
                computed = f"in {log.cells[row].tolist()}"
                yield Difference(step, None, wire.MARKERS.name, logged, computed)

    def _repeats(self) -> Iterator[Difference]:
        """Yield what came twice without a reason.

        The world repeats state and last reward together, to a robot whose action it misses; only
        then the robot repeats its action. A percept is never repeated. A world that went back to
        a checkpoint has no reward to repeat before its next step.
        """
        returned = {one.step for one in self.log.tracks.rollbacks}
        for k in self.robots:
            again = [Counter(track.repeats.tolist()) for track in self.log.tracks.of(k)]
            states, rewards, actions, percepts = again
            for step in sorted(
                {*states, *actions, *percepts, *(step + 1 for step in rewards)}
            ):
                due = states[step] if step - 1 in self.rewarded[k] else 0
                if step in percepts:
                    yield self.odd(step, k, wire.PERCEPT.name, "twice", "once")
                if actions[step] > states[step]:
                    yield self.odd(
                        step, k, wire.ACTION.name, "twice", "once, as its state"
                    )
                if rewards[step - 1] > due:
                    yield self.odd(step - 1, k, wire.REWARD.name, "twice", "once")
                elif rewards[step - 1] < due and step not in returned:
                    yield self.odd(
                        step, k, wire.LOCAL_STATE.name, "twice", "once, as its reward"
                    )


def _says(said: np.ndarray, due: np.ndarray, others: Sequence[np.ndarray]) -> bool:
    """Whether what the log says is what is due; if another message says so, it is that."""
    if any(other[1].tobytes() == due.tobytes() for other in others):
        said[:] = due
    return said.tobytes() == due.tobytes()


def _parts(numbers: Sequence[float]) -> str:
    labels = (*wire.REWARD.labels, wire.PARTNERS)
    return " ".join(f"{label}={n!r}" for label, n in zip(labels, numbers, strict=False))
