# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world simulator node: local states, rewards and time for a team of robot nodes."""

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

from rclpy.timer import Timer

from sparse_coord_ros.base.errors import NameTakenError, RunError
from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.base.progress import in_time
from sparse_coord_ros.base.yaml_text import to_yaml
from sparse_coord_ros.core.game.interactions import can_miscoordinate, interactions_of
from sparse_coord_ros.core.game.world import Action, World
from sparse_coord_ros.core.runs.history import HISTORY_FILE
from sparse_coord_ros.core.runs.repeating import repeating_command
from sparse_coord_ros.core.runs.run_config import (
    RUN_FILE,
    SUMMARY_FILE,
    later_result,
)
from sparse_coord_ros.core.runs.saved_tables import TEAM_FILE, robot_file
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.lockstep.timeouts import REPEAT_SECONDS
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.lockstep.world_states import (
    GATHERING,
    MOVING,
    OVER,
    RETURNING,
    UNDER_WAY,
    Event,
    State,
    next_state,
)
from sparse_coord_ros.protocol.wire import RECORDER, WORLD, services
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.follower import REPORT_SECONDS, TICK_SECONDS
from sparse_coord_ros.ros.nodes.outputs import Output, holds_run, run_of
from sparse_coord_ros.ros.nodes.parameters import (
    PARAMETERS,
    NodePlace,
    ParameterNode,
)
from sparse_coord_ros.ros.nodes.restart import Restart
from sparse_coord_ros.ros.nodes.ros_messages import run_announced
from sparse_coord_ros.ros.nodes.spin import run_node, wait_for_readers
from sparse_coord_ros.ros.nodes.world_bodies import WorldBodies
from sparse_coord_ros.ros.nodes.world_speed import WorldSpeed
from sparse_coord_ros.ros.nodes.world_topics import WorldTopics

GO_ON = "go_on"
END = "end"
"""The value of `lost_robot` that ends the run; else the world waits."""

NOT_UNDER_WAY = "the run is not under way"

PROGRESS_SECONDS = 5.0
"""Between two lines of progress."""

CLEARLY_LESS = 0.9
"""The share of a wanted rate that a world should keep at least."""

CHECKPOINT_SECONDS = 10.0
"""Between two checkpoints by time."""

AHEAD_SECONDS = 0.5
"""How long before a checkpoint by time the robots hear of it."""


class WorldSimulator(ParameterNode):
    """Publishes X_k(t) and R_k(t), and waits for the team's actions.

    The world listens whether another one has announced a run, opens, begins when all nodes are
    there, and then makes a time step when all robots have acted. Its `state` says what it does.

    Args:
        place: where the node is made, and with what: see `NodePlace`.

    Attributes:
        startup_timeout: the seconds that it waits for the other nodes.
        lost_timeout: the seconds that it waits for lost robots before it ends.
        run: the run.
        resumed: whether its output directory held the run, which goes on.
        state: its state, which `next_state` changes.
        lockstep: the world's side of the lock step.
        bodies: the robots' bodies; None: robots without bodies.
        topics: its publishers.
        speed: the speed of the run.
        restart: orders the team to begin; it exists once the world has opened.
        rate_timer: the timer of the parameter `rate`, if it is not 0.

    Raises:
        SparseCoordError: a bad parameter, another world, robots that do not come.
    """

    startup_timeout = 60.0
    lost_timeout = 60.0
    restart: Restart
    state = State.LISTENING
    _output: Output | None = None
    rate_timer: Timer | None = None
    # The rate of that timer.
    _timed_rate = 0.0
    _told = -math.inf
    # The rate that is being watched, when that began, and the transitions by then.
    _watched = (0.0, 0.0, 0)
    # The rate of which the world has said that it cannot keep it.
    _missed = 0.0
    # When and at which time step the last checkpoint by time was ordered.
    _ordered = 0.0
    _ordered_at = 0

    def __init__(self, **place: Unpack[NodePlace]) -> None:
        super().__init__(WORLD, PARAMETERS[WORLD], **place)
        self.resumed = holds_run(self.values["out"])
        self.run = run_of(self.values)
        self.show_settings(self.run.scenario)
        self._names = self.run.scenario.names
        self.bodies: WorldBodies | None = None
        if self.run.bodies:
            self.bodies = WorldBodies(self, self.run, self._step_when_due)
            game: World = self.bodies.game
        else:
            game = World(self.run.scenario, self.run.seed)
        self.topics = WorldTopics(self, self.run, game, self._save)
        self._silence = self.topics.silence
        self.topics.hear_actions(self._on_action)
        self.lockstep = WorldSide(self.run, self.topics, game)
        self.speed = WorldSpeed(game, time.monotonic())
        self._others = self.subscriber.listen_packed(
            ros_topics.RUN, lambda data: (run_announced(data),), self._refuse
        )
        self.create_timer(TICK_SECONDS, self._tick)

    # Its state.

    @property
    def doing(self) -> str:
        """The world's activity: a `wire.RunState`."""
        return self.state.published(greedy=self.run.greedy, resuming=self.resumed)

    def _happens(self, event: Event) -> None:
        """Change the state by an event, and make the time step that is due."""
        self.state = next_state(self.state, event)
        self._step_when_due()

    def _step_when_due(self) -> None:
        """Make the time step if all have acted, and the state allows it.

        Bodies first get goals, and must arrive: they drive while the world rests.
        """
        side = self.lockstep
        moving = self.state in MOVING
        if not (moving or self.state is State.RESTING) or not side.complete:
            return
        if side.world.step >= self.restart.limit:
            return
        if self.bodies is not None and not self.bodies.side.made(side.actions):
            return
        if not moving:
            return
        side.advance()
        if self.state is State.STEPPING:
            self.state = next_state(self.state, Event.MADE)
            self._say()
        if self.values["rate"] > 0:
            self.state = next_state(self.state, Event.MADE_BY_RATE)
            self._show()
        self._end_when_finished()

    def _end_when_finished(self) -> None:
        if self.lockstep.finished and self.state not in OVER:
            self.state = next_state(self.state, Event.BUDGET_USED)
            self.done = True
            self.speed.end(time.monotonic())
            self._report(time.monotonic())

    def _say(self) -> None:
        if self._output is not None:
            restart = self.restart
            self.topics.say(self.doing, self.lockstep, restart.order, restart.oldest)

    def _show(self) -> None:
        """Publish the robots' places; not of a resumed team that has not gone back yet."""
        gathering = self.state in GATHERING and self.resumed
        if self.state not in RETURNING and not gathering:
            self.topics.show(always=self.lockstep.finished)

    # Incoming.

    def _on_action(
        self, robot: int, step: int, action: Action, report: wire.SelfReport
    ) -> None:
        if self.state in UNDER_WAY:
            self.topics.newest[robot] = (step, action, report)
            if self.lockstep.action(robot, step, action):
                self._step_when_due()

    def _on_pause(self, hold: bool) -> tuple[bool, str]:
        self._silence.begin(time.monotonic())
        self._happens(Event.PAUSE if hold else Event.CONTINUE)
        self._say()
        return True, self.doing

    def _on_reset(self) -> tuple[bool, str]:
        if self.state not in UNDER_WAY:
            return False, NOT_UNDER_WAY
        self.lockstep.new_episode()
        return True, f"episode {self.lockstep.world.episode + 1} begins"

    def _on_step(self) -> tuple[bool, str]:
        """Pause, and make one time step if every robot has acted."""
        side = self.lockstep
        if self.state in OVER:
            return False, NOT_UNDER_WAY
        if self.state in UNDER_WAY and side.complete:
            self._happens(Event.STEP)
            self._say()
            return True, f"paused after {side.world.transitions} steps"
        self._happens(Event.PAUSE)
        self._say()
        if self.state not in UNDER_WAY:
            return False, f"paused; {NOT_UNDER_WAY}"
        silent = ", ".join(self._names[k] for k in side.missing() or side.absent)
        return False, f"paused; waits for the action of {silent}: call again"

    def _refuse(self, run: str) -> None:
        """Refuse to begin: a run comes, so its world lives; a killed one sends nothing.

        Raises:
            NameTakenError: always.
        """
        topic = self.resolve_topic_name(ros_topics.RUN.name)
        raise NameTakenError(
            f"another world announces a run on {topic}; stop that one, or start this one in "
            "another namespace or ROS domain"
        )

    # The course of the run.

    def _tick(self) -> None:
        now = time.monotonic()
        self._silence.tick(now)
        if self.state is State.LISTENING:
            if self.looked_around(now):
                self._open()
            return
        if self.state in GATHERING:
            self._start_when_complete(now)
        elif self.state in RETURNING:
            self.restart.look(now, all_listen=lambda: not self._missing())
        elif self.state in UNDER_WAY:
            self._watch_the_barrier(now)
        if self.state is not State.STOPPED:
            if now - self.speed.reported >= REPORT_SECONDS:
                self._report(now)

    def _open(self) -> None:
        """Offer the services and publish the run."""
        self.subscriber.leave(self._others)
        robots = [robot_file(Path(), name).name for name in self._names]
        files = [RUN_FILE, SUMMARY_FILE, TEAM_FILE, HISTORY_FILE, *robots]
        self._output = Output(self, WORLD, self.run, files)
        self.restart = Restart(self.run, self.lockstep, self._output, self._on_restart)
        self.offer(services.PAUSE, self._on_pause)
        self.offer(services.RESET, self._on_reset)
        self.offer(services.STEP, self._on_step)
        self.topics.open(resumed=self.resumed)
        self._happens(Event.OPENED)
        self._say()

    def _missing(self) -> list[str]:
        """Return the missing nodes of the team: robots, drivers as commands, the recorder."""
        missing = self.topics.missing()
        if self.bodies is not None:
            missing = missing + self.bodies.missing()
        return missing

    def _start_of(self, missing: Sequence[str]) -> str:
        """Return the command that starts the first missing node; robots wait for a recorder."""
        node = missing[0].partition(" ")[0]
        started = missing[0]  # a driver
        if RECORDER in missing:
            started = RECORDER
        elif node in self._names:
            started = f"robot --ros-args -r __node:={node}"
        space = self.get_namespace()
        if space != "/":
            started += "" if "--ros-args" in started else " --ros-args"
            started += f" -r __ns:={space}"
        return f"ros2 run sparse_coord_ros {started}"

    def _start_when_complete(self, now: float) -> None:
        missing = self.restart.begin_when_complete() or self._missing()
        if missing:
            self.remind(self.reminder, ", ".join(missing))
            limit = self.startup_timeout
            if limit < now - self.born:
                raise RunError(
                    f"after {limit:g} s still no node for {', '.join(missing)}; "
                    f"start each one, as in: {self._start_of(missing)}"
                )
            return
        self.reminder.over()
        self._silence.begin(now)
        self.speed.begin(now)
        self._ordered = now
        self._ordered_at = self.lockstep.world.step
        self._happens(Event.ALL_THERE)
        self._say()
        self.get_logger().info(
            f"{self.run.scenario.name}: {len(self._names)} robots, {self.run.scenario.steps} "
            f"steps, seed {self.run.seed}"
        )
        self.topics.show_floor()
        self.lockstep.start()
        self._end_when_finished()

    def _on_restart(self) -> None:
        """The team has an order to begin or to return, or it goes on again."""
        self._silence.begin(time.monotonic())
        if self.lockstep.held:
            self.topics.start_anew()
            self._happens(Event.RETURN)
        elif self.state in RETURNING:
            self.topics.show_floor()
            self._happens(Event.ALL_THERE)
            self._end_when_finished()
        self._say()

    def _watch_the_barrier(self, now: float) -> None:
        self.keep_the_rate()
        self._save_now_and_then(now)
        if self.bodies is not None:
            self.bodies.look(now, held=self.state is State.PAUSED)
        if self.lockstep.world.step >= self.restart.limit:
            self._wait_for_the_recorder(now)
            return
        self._step_when_due()  # the recorder may have written meanwhile
        if self.lockstep.complete or self._silence.lasts(now) < REPEAT_SECONDS:
            self.reminder.over()
            return
        if self._silence.repeats(now):
            self.lockstep.repeat()
            self._say()
        if self.state in (State.RUNNING, State.RESTING):
            self._wait_for_the_lost(now)

    def _save_now_and_then(self, now: float) -> None:
        """Order a checkpoint after some time: in about half a second, when all know of it."""
        if not self.run.checkpoint or now - self._ordered < CHECKPOINT_SECONDS:
            return
        step = self.lockstep.world.step
        made = step - self._ordered_at
        self._ordered = now
        self._ordered_at = step
        if made > 0:
            ahead = int(made * AHEAD_SECONDS / CHECKPOINT_SECONDS)
            self.lockstep.save_at = step + 1 + ahead
            self._say()

    def _wait_for_the_recorder(self, now: float) -> None:
        """Log that the world waits; continue without a recorder that is lost."""
        step = self.lockstep.world.transitions
        self.remind(self.reminder, f"{RECORDER} to write what came before step {step}")
        if self._silence.stands(now) >= self.lost_timeout:
            self.restart.do_without_recorder()
            self.get_logger().warning(
                f"step {step}: {RECORDER} is lost; continuing without it"
            )

    def _wait_for_the_lost(self, now: float) -> None:
        """Log the awaited robots; continue or end by the parameters."""
        side = self.lockstep
        silent = self._silence.lasts(now)
        stands = self._silence.stands(now)
        missing = side.missing()
        names = ", ".join(self._names[k] for k in sorted(missing or side.absent))
        at = f"step {side.world.transitions}"
        self.remind(self.reminder, f"{names} at {at}")
        if silent < self.run.step_timeout and not (
            missing and self.topics.gone(missing)
        ):
            return
        what = f"{at}: {names} gone or silent for {silent:.1f} s"
        if self.values["lost_robot"] == END:
            raise RunError(
                f"lost_robot: {what}; this world ends the run (parameter lost_robot)"
            )
        if self.values["lost_robot"] == GO_ON and side.expire():
            self._silence.since = now
            self.get_logger().warning(
                f"{what}; continuing without them", throttle_duration_sec=5.0
            )
            self._step_when_due()
        elif self.lost_timeout <= stands:
            why = f"the world has waited for {stands:.0f} s for {names}"
            saved = "all is saved; start all nodes again"
            if not self.values["out"]:
                saved = "parameter 'out' is empty: the run is not saved"
            raise RunError(f"{at}: {why}; {saved}")

    def keep_the_rate(self) -> None:
        """Make the timer of the rate, which may have changed; without a rate a step is due."""
        rate = self.values["rate"]
        if rate == 0 and self.state is State.RESTING:
            self._happens(Event.DUE)
        if rate == self._timed_rate:
            return
        if self.rate_timer is not None:
            self.destroy_timer(self.rate_timer)
            self.rate_timer = None
        if rate > 0:
            self.rate_timer = self.create_timer(1 / rate, self.beat)
        self._timed_rate = rate

    def _watch_the_rate(self, now: float) -> None:
        """Say once which rate the world keeps, if it is clearly less than the wanted one.

        It does not judge while it waits for a silent robot, which is told by itself.
        """
        wanted = self.values["rate"]
        rate, since, before = self._watched
        transitions = self.lockstep.world.transitions
        runs = self.state in (State.RUNNING, State.RESTING)
        silence = 0.0 if self.lockstep.complete else self._silence.lasts(now)
        if wanted != rate or not runs or silence >= PROGRESS_SECONDS / 2:
            self._watched = (wanted, now, transitions)
            return
        seconds = now - since
        if seconds < PROGRESS_SECONDS or silence >= REPEAT_SECONDS:
            return
        self._watched = (wanted, now, transitions)
        made = transitions - before
        if made + 1 < CLEARLY_LESS * wanted * seconds and self._missed != wanted:
            self._missed = wanted
            self.get_logger().warning(
                f"rate {wanted:g} cannot be kept: {made / seconds:.3g} steps/s"
            )

    def beat(self) -> None:
        """The next step is due, by the `rate`; it is made as soon as all actions are there.

        A step with late bodies does not wait for another beat.
        """
        self._happens(Event.DUE)

    # Saving and reports.

    def _save(self, step: int) -> None:
        """Save the world's state; the robots save under the same time step."""
        if self._output is not None:
            self._output.checkpoint(self.lockstep.snapshot(step))

    def finish(self, *, interrupted: bool) -> None:
        """Publish the last status, write summary and history, and wait for the readers."""
        under_way = self.state in (*UNDER_WAY, State.FINISHED)
        self._happens(Event.END)
        if self._output is None:
            return
        if interrupted and not self.done:
            self.speed.end(time.monotonic())
            self._say()
        if under_way:
            self._save(self.lockstep.world.step)
        self._output.save(self._write_outcome)
        wait_for_readers(self.publishers)

    def _write_outcome(self, out: Path) -> None:
        summary = self.summary()
        if self.done and not self.run.greedy:
            # The robots' tables may still be in their processes.
            summary = {"result": later_result(out), **summary}
        write_whole(out / SUMMARY_FILE, to_yaml(summary))
        self.lockstep.history.so_far.save(out)

    def _counts(self) -> dict[str, Any]:
        """Return the counts of summary and diagnostics."""
        return {
            "transitions": self.lockstep.world.transitions,
            "miscoordinations": self.lockstep.world.miscoordinations,
            "timeouts": self.lockstep.timeouts,
        }

    def summary(self) -> dict[str, Any]:
        """Return the run's summary as plain data; `repeat`: the command that computes it again."""
        return {
            "repeat": repeating_command(self.run),
            **self._counts(),
            "episodes": self.lockstep.world.episode + 1,
            **({} if self.bodies is None else self.bodies.summary()),
            **self.speed.summary(),
        }

    def _report(self, now: float) -> None:
        world = self.lockstep.world
        run = self.run
        rate, moved = self.speed.report(now)
        self._watch_the_rate(now)
        values = {
            **self._counts(),
            "messages_dropped": self.subscriber.total,
            "budget": run.scenario.steps,
            "steps_per_second": f"{rate:.0f}",
            "episode": world.episode + 1,
        }
        self.topics.report(self.doing, values, warn=bool(self.lockstep.absent))
        self._say()
        if moved and (self.done or now - self._told >= PROGRESS_SECONDS):
            self._told = now
            done = percent(world.transitions / run.scenario.steps, whole=True)
            line = (
                f"{done:>5}  {world.transitions} of "
                f"{run.scenario.steps} steps, {rate:.0f} steps/s, episode {world.episode + 1}"
            )
            left = run.scenario.steps - world.transitions
            if left and rate:
                line += f", about {in_time(left / rate)} left"
            if can_miscoordinate(interactions_of(run.scenario)):
                count = world.miscoordinations
                what = "miscoordination" if count == 1 else "miscoordinations"
                line += f", {count} {what}"
            self.get_logger().info(line)
        self._show()


def main() -> int:
    """Run the node `world_simulator`."""
    return run_node(lambda context: WorldSimulator(context=context))
