# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world simulator node: local states, rewards and time for a team of robot nodes."""

import functools
import sys
import time
import uuid
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.timer import Timer
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from sparse_coord_ros import wire
from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.world import Action, Reward
from sparse_coord_ros.learn.history import HISTORY_FILE
from sparse_coord_ros.learn.run_config import RUN_FILE
from sparse_coord_ros.learn.tables import TEAM_FILE, robot_file
from sparse_coord_ros.lockstep.bodies import BodiesSide, BodyWorld, Goals, Reached
from sparse_coord_ros.lockstep.checkpoints import Checkpoints
from sparse_coord_ros.lockstep.rollback import NO_ORDER, ROLL_CALL, Progress, WorldRollback
from sparse_coord_ros.lockstep.waiting import Reminder
from sparse_coord_ros.lockstep.world_side import WorldSide
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.claim import JOINED, Claim
from sparse_coord_ros.nodes.episode_messages import MapLayout, MarkersLayout
from sparse_coord_ros.nodes.intake import Intake
from sparse_coord_ros.nodes.messages import (
    CLOCK_LAYOUT,
    Converter,
    goals_message,
    order_text,
    read_claim,
    read_progress,
    read_reached,
    status,
    typed,
)
from sparse_coord_ros.nodes.outputs import (
    SUMMARY_FILE,
    open_output,
    resumed_run,
    save_somewhere,
    saving,
)
from sparse_coord_ros.nodes.owners import Owners
from sparse_coord_ros.nodes.parameters import (
    CONTINUE,
    END,
    GO_ON,
    ROLL_BACK,
    WORLD_PARAMETERS,
    ParameterNode,
    run_from_parameters,
)
from sparse_coord_ros.nodes.scene import Scene, ScenePublisher
from sparse_coord_ros.nodes.spin import run_node, tidy_shared_memory, wait_for_readers
from sparse_coord_ros.nodes.tap import Tap
from sparse_coord_ros.wire import RECORDER, WORLD

DRIVER = "driver"
"""The executable that drives a body."""

TICK_SECONDS = 0.02
REPORT_SECONDS = 1.0
REPEAT_SECONDS = 0.5
"""After this silence the world publishes again what a missing robot may have lost."""


class WorldSimulator(ParameterNode):
    """Publishes X_k(t) and R_k(t), waits for the team's actions, owns /clock.

    Args:
        context: the ROS context.
        namespace: the team's namespace.
        values: parameters given by the program; None: by the command line.
        tap: the way to a recorder in the same process.

    Attributes:
        run: the run.
        lockstep: the world's side of the lock step.
        intake: its subscriptions.
        replaced: how often a robot was replaced while the run was under way.

    Raises:
        SparseCoordError: a bad parameter, a taken name, robots that do not come.
    """

    _checkpoints: Checkpoints | None = None

    def __init__(
        self,
        *,
        context: Context,
        namespace: str = "",
        values: Mapping[str, Any] | None = None,
        tap: Tap | None = None,
    ) -> None:
        super().__init__(
            WORLD,
            WORLD_PARAMETERS,
            context=context,
            namespace=namespace,
            values=values,
            tap=tap,
        )
        if self.values["resume"]:
            self.run = resumed_run(self.values)
        else:
            self.run = replace(run_from_parameters(self.values), id=uuid.uuid4().hex)
        self.show_settings(self.run.scenario)
        self._out: Path | None = None
        self._convert = Converter(self.run)
        self._map = MapLayout(self._convert)
        self._markers = MarkersLayout(self._convert, self.run.scenario)
        self._names = [robot.name for robot in self.run.scenario.robots]
        game = None
        self._bodies: BodiesSide | None = None
        if self.values["bodies"]:
            game = BodyWorld(self.run.scenario, self.run.seed, slips=self.values["slips"])
            self._bodies = BodiesSide(game, self)
        self._body_reminder = Reminder()
        self._bodies_heard = 0.0
        self._single = False
        self.lockstep = WorldSide(self.run, self, game)
        self._back = WorldRollback(self.lockstep, None, len(self._names))
        self._recorder_obeyed = NO_ORDER
        self._held_since = 0.0
        self._state = wire.WAITING
        self._opened = self._paused = self._started = self.done = self._over = False
        self._clock_step = -1
        self._since = self._stands_since = self._reported = time.monotonic()
        self._ticked = time.monotonic()
        self._reminder = Reminder()
        self.replaced = 0
        self._members: dict[int, str] = {}
        self._seconds = 0.0
        self._begun_with = self._reported_transitions = 0
        self._repeated = 0.0
        self._slow = [0.0] * len(self._names)
        self.intake = Intake(self)
        self._claim = Claim(self, self.intake)
        self._run_publisher = self.announce(interface.RUN)
        self._create_publishers()
        said = (self._run_publisher, self._status_publisher, self._clock_publisher)
        own = [*said, self._map_publisher, *self._state_publishers, *self._reward_publishers]
        heard = [
            subscription.topic_name
            for subscription in (*self._action_subscriptions, *self._reached_subscriptions)
        ]
        self._owners = Owners(self, [*(publisher.topic_name for publisher in own), *heard])
        self.create_timer(TICK_SECONDS, self._tick)
        self._rate_timer: Timer | None = None

    # Outgoing: the port of the protocol.

    def state(self, robot: int, step: int, cell: int) -> None:
        """Publish a robot's local state, and the clock when a step begins."""
        if step != self._clock_step:
            self._clock_step = step
            self._since = self._stands_since = time.monotonic()
            self._clock_publisher.publish(CLOCK_LAYOUT.pack(*self._convert.stamp(step)))
        self._state_publishers[robot].publish(self._convert.pack_state(step, cell))

    def reward(self, robot: int, step: int, reward: Reward) -> None:
        """Publish the reward of a robot's action at a time step."""
        self._reward_publishers[robot].publish(self._convert.pack_reward(step, reward))

    def episode(self, step: int) -> None:
        """Publish map and markers as they are when an episode begins."""
        self._map_publisher.publish(self._map.pack(step))
        self._publish_markers(scene=False)

    def checkpoint(self, step: int) -> None:
        """Save where the world is; the robots save under the same time step."""
        state = None if self._checkpoints is None else self.lockstep.snapshot(step)
        if self._checkpoints is not None and state is not None:
            with saving(self):
                self._checkpoints.save_world(state)

    def send(self, goals: Goals) -> None:
        """Tell the bodies where to go."""
        self._bodies_heard = time.monotonic()
        self._goals_publisher.publish(goals_message(self._convert, goals, self._names))

    # Incoming.

    def _on_reached(self, reached: Reached) -> None:
        """Take in where a body is; with the last one the step is made."""
        if self._bodies is None or not self._started or self._over:
            return
        self._bodies_heard = time.monotonic()
        there = self._bodies.reached(reached)
        if there and self.lockstep.complete and self._goes_on():
            self._advance()

    def _goes_on(self) -> bool:
        """Whether a step that can be made is made at once."""
        return self._single or (not self._paused and self.values["rate"] == 0)

    def _read_action(self, robot: int, data: bytes) -> tuple[int, Action]:
        said = self._convert.unpack_action(data)
        self._scene.actions[robot] = data
        return said

    def _on_action(self, robot: int, said: tuple[int, Action]) -> None:
        step, action = said
        if not self._started or self._over:
            return
        opened = self.lockstep.action(robot, step, action)
        self._slow[robot] = max(self._slow[robot], time.monotonic() - self._since)
        if opened and not self._paused and self.values["rate"] == 0:
            self._advance()

    def _on_claim(self, robot: int, claim: tuple[str, int]) -> None:
        """Note which node takes part as a robot; a new one has learned other things."""
        identity, rank = claim
        before = self._members.get(robot)
        if rank != JOINED or identity == before:
            return
        self._members[robot] = identity
        said = self._back.said(robot)
        if before is None:
            self.get_logger().info(f"{self._names[robot]} has joined")
        elif self._started:
            self.replaced += 1
            if said is not None and said.life == identity and said.resumed:
                return  # `_on_progress` says what becomes of it
            self.get_logger().warning(
                f"{self._names[robot]} was replaced at step {self.lockstep.world.step}: a new "
                "node has joined under its name, with tables of its own"
            )

    def _on_progress(self, robot: int, said: Progress) -> None:
        """Take in what a robot says of its checkpoints; one that comes back may take us along."""
        new = self._back.heard(robot, said)
        if not (new and said.resumed and self._started) or self.lockstep.finished:
            return
        name, step = self._names[robot], self.lockstep.world.step
        if self.values["returning"] == ROLL_BACK and self._take_back():
            self.get_logger().warning(
                f"{name} came back at step {step}: everybody goes back to the checkpoint of step "
                f"{self._back.order.step}"
            )
            return
        lost = max(0, step - said.step)
        self._back.lost += lost
        self.get_logger().warning(
            f"{name} came back at step {step} with what it had learned until step {said.step}: "
            f"the team goes on, {lost} time steps of {name} are lost"
        )

    def _on_recorder(self, said: Progress) -> None:
        self._recorder_obeyed = said.obeyed

    def _take_back(self) -> bool:
        """Go back to the last common checkpoint, and order it; return whether there is one."""
        if self._back.take_back(uuid.uuid4().hex) is None:
            return False
        self._held_since = time.monotonic()
        self._clock_step = -1  # also where the run stands at the checkpoint's step already
        self._say_state(self._running_state())
        return True

    def _go_on_when_all_obeyed(self, now: float) -> None:
        """End the hold after an order; who does not obey in time joins later."""
        late = now - self._held_since >= self.run.step_timeout
        recorded = not self.run.recorded or self._recorder_obeyed == self._back.order.name
        if not late and not (recorded and not self._missing_nodes()):
            return
        waiting = [self._names[k] for k in self._back.waiting]
        if not self._back.go_on(anyway=late):
            return
        self._since = self._stands_since = now
        if waiting:
            self.get_logger().warning(f"{', '.join(waiting)} did not obey; going on without")
        if self._back.lost:
            self.get_logger().warning(f"{self._back.lost} transitions are lost in the history")
        self._say_state(self._running_state())
        self._end_when_finished()

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response):
        self._paused = request.data
        self._since = self._stands_since = time.monotonic()
        self._say_state(self._running_state())
        if not self._paused and self.lockstep.complete and self.values["rate"] == 0:
            self._advance()
        response.success, response.message = True, self._state
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response):
        response.success = self._started and not self.lockstep.finished
        response.message = "the run is not under way"
        if response.success:
            self.lockstep.new_episode()
            response.message = f"episode {self.lockstep.world.episode} begins"
        return response

    def _on_step(self, request: Trigger.Request, response: Trigger.Response):
        """Hold, and make one time step where every robot has acted."""
        self._paused = True
        response.success = self._started and self.lockstep.complete and not self.done
        response.message = "the run is not under way, or a robot has not acted yet"
        if response.success:
            response.message = f"step {self.lockstep.world.step}"
            self._single = True
            self._advance()
        if not self.done:
            self._say_state(self._running_state())
        return response

    @property
    def doing(self) -> str:
        """What the world is doing: one of the states of `wire`."""
        return self._state

    # The course of the run.

    def _tick(self) -> None:
        now = time.monotonic()
        if now - self._ticked > REPEAT_SECONDS:
            self._since = now  # this process stood still itself: nobody was silent
        self._ticked = now
        if self._over:
            return
        if not self._opened:
            if now - self.born >= self.values["claim_window"]:
                self._claim.hold()
                self._open()
            return
        if not self._started:
            self._start_when_complete(now)
        elif self.lockstep.held:
            self._go_on_when_all_obeyed(now)
        elif not self.lockstep.finished:
            self._watch_the_barrier(now)
        if now - self._reported >= REPORT_SECONDS:
            self._report(now)

    def _open(self) -> None:
        """Offer the services and tell everybody what the run is."""
        robots = [robot_file(Path(), name).name for name in self._names]
        own = [RUN_FILE, SUMMARY_FILE, TEAM_FILE, HISTORY_FILE, *robots]
        resumed = self.values["resume"]
        self._out = open_output(self.values["out"], self.run.to_yaml(), [] if resumed else own)
        if self._out is not None:
            self._checkpoints = Checkpoints(self._out, WORLD, self.run)
            self._back = WorldRollback(self.lockstep, self._checkpoints, len(self._names))
            self._checkpoints.steps()
            for line in self._checkpoints.broken:
                self.get_logger().warning(line)
        for robot, name in enumerate(self._names):
            then = functools.partial(self._on_progress, robot)
            read = typed(interface.PROGRESS, read_progress)
            self.intake.listen(interface.PROGRESS, then, name, read=read)
        if self.run.recorded:
            read = typed(interface.PROGRESS, read_progress)
            self.intake.listen(interface.PROGRESS, self._on_recorder, RECORDER, read=read)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(Trigger, "~/step", self._on_step)
        self._run_publisher.publish(String(data=self.run.to_yaml()))
        if not resumed:
            self._map_publisher.publish(self._map.pack(0))
            self._publish_markers()
        self._say_state(wire.RESUMING if resumed else wire.WAITING)
        self._opened = True

    def _order_when_all_have_said(self) -> list[str]:
        """Where a run is resumed, say from where; return whose checkpoints are not known yet."""
        if not self.values["resume"] or self.lockstep.held:
            return []
        silent = [self._names[k] for k in self._back.silent]
        if silent:
            return silent
        if self.values["returning"] == CONTINUE:
            self._back.call(uuid.uuid4().hex)
            self._held_since = time.monotonic()
            self._say_state(wire.RESUMING)
        elif not self._take_back():
            raise RunError(
                "resume: a robot keeps no checkpoints; give every robot parameter 'out' and "
                "resume:=true, or this world returning:=continue"
            )
        step, order = self.lockstep.world.step, self._back.order
        self.get_logger().info(
            f"going on from the checkpoint of step {step if order.step < 0 else order.step} "
            f"(transition {self.lockstep.world.transitions}, next step {step})"
        )
        return []

    def _start_when_complete(self, now: float) -> None:
        missing = self._order_when_all_have_said() or self._missing_nodes()
        if missing:
            self.remind(self._reminder, ", ".join(missing))
            limit = self.values["startup_timeout"]
            if 0 < limit < now - self.born:
                command = f"robot --ros-args -r __node:={missing[0]}"
                if missing[0].startswith(f"{DRIVER} "):
                    command = missing[0]
                if RECORDER in missing:
                    command = f"{RECORDER} (the robots wait for it too)"
                raise RunError(
                    f"startup_timeout: after {limit:g} s still no node for {', '.join(missing)}; "
                    f"start each, e.g.: ros2 run sparse_coord_ros {command}"
                )
            return
        self._started = True
        self._claim.join()
        self._reminder.over()
        self._seconds = -now
        self._since = self._stands_since = self._reported = now
        self._begun_with = self._reported_transitions = self.lockstep.world.transitions
        self._say_state(self._running_state())
        self.get_logger().info(
            f"{self.run.scenario.name}: {len(self._names)} robots, {self.run.scenario.steps} "
            f"steps, seed {self.run.seed}"
        )
        if self.lockstep.held:
            self._held_since = now
        else:
            self.lockstep.start()

    def _missing_nodes(self) -> list[str]:
        """Return the robots, and the recorder where one is to be, that do not listen yet."""
        missing = []
        publishers = [self._clock_publisher, *self._state_publishers, *self._reward_publishers]
        for k, name in enumerate(self._names):
            own = (self._state_publishers[k], self._reward_publishers[k])
            speaks = self._action_subscriptions[k].get_publisher_count() > 0
            if not speaks or not all(self.heard_by(publisher, [name]) for publisher in own):
                missing.append(name)
        for name, subscription in zip(self._names, self._reached_subscriptions, strict=False):
            if subscription.get_publisher_count() == 0:
                missing.append(f"{DRIVER} --ros-args -p robot:={name}")
        if self.run.recorded and not all(self.heard_by(p, [RECORDER]) for p in publishers):
            missing.append(RECORDER)
        return missing

    def _watch_the_barrier(self, now: float) -> None:
        if self.values["rate"] > 0 and not self._paused:
            self._keep_the_rate()
        if self._bodies is not None:
            self._wait_for_bodies(self._bodies, now)
        silent = now - self._since
        if self.lockstep.complete and self.values["rate"] == 0 and not self._paused:
            self._advance()  # the rate was set to 0 while the team waited for its next step
        if self.lockstep.complete or silent < REPEAT_SECONDS:
            self._reminder.over()
            return
        if now - self._repeated >= REPEAT_SECONDS:
            self._repeated = now
            self.lockstep.repeat()
            self._say_state(self._state)
        if self._paused:
            return
        self._wait_for_the_lost(now)
        gone = all(
            self._action_subscriptions[k].get_publisher_count() == 0
            for k in self.lockstep.missing()
        )
        lost = silent >= self.run.step_timeout or (gone and bool(self.lockstep.missing()))
        if lost and self.values["lost_robot"] == END:
            raise RunError(
                f"lost_robot: step {self.lockstep.world.step}: {self._waited_for()} gone or "
                f"silent for {silent:.1f} s; this world ends the run, as it is told to"
            )
        if lost and self.values["lost_robot"] == GO_ON:
            late = [self._names[k] for k in self.lockstep.expire()]
            self._since = now
            self.get_logger().warning(
                f"step {self.lockstep.world.step}: {', '.join(late)} gone or silent for "
                f"{silent:.1f} s; going on without",
                throttle_duration_sec=5.0,
            )
            self._end_when_finished()

    def _waited_for(self) -> str:
        waited = set(self.lockstep.missing()) or self.lockstep.absent
        return ", ".join(self._names[k] for k in sorted(waited))

    def _wait_for_the_lost(self, now: float) -> None:
        """Say for whom the world stands still, and end where it has done so for too long."""
        stands, limit = now - self._stands_since, self.values["lost_timeout"]
        self.remind(self._reminder, f"{self._waited_for()} at step {self.lockstep.world.step}")
        if 0 < limit <= stands:
            raise RunError(
                f"lost_timeout: step {self.lockstep.world.step}: the world has stood still for "
                f"{stands:.0f} s for {self._waited_for()}; everything is saved"
            )

    def _keep_the_rate(self) -> None:
        if self._rate_timer is None or self._rate_timer.timer_period_ns != _period(self.values):
            if self._rate_timer is not None:
                self.destroy_timer(self._rate_timer)
            self._rate_timer = self.create_timer(_period(self.values) / 1e9, self._on_rate)

    def _on_rate(self) -> None:
        if self._over or self._paused or self.values["rate"] == 0:
            return
        if self.lockstep.complete:
            self._advance()
            self._publish_markers()

    def _advance(self) -> None:
        """Make the step; of a world with bodies when they are there, else they are sent."""
        if self._bodies is not None and not self._bodies.made(self.lockstep.actions):
            return
        self._single = False
        self.lockstep.advance()
        self._end_when_finished()

    def _wait_for_bodies(self, bodies: BodiesSide, now: float) -> None:
        """Say for whose bodies the step waits; what takes too long counts as not moved."""
        if not bodies.waiting:
            self._body_reminder.over()
            return
        names = ", ".join(self._names[k] for k in bodies.waiting)
        cells = ", ".join(self._place_of(k) for k in bodies.waiting)
        where = f" to be at {cells}" if bodies.placing else ""
        self.remind(self._body_reminder, f"the bodies of {names}{where}")
        limit = self.values["body_timeout"]
        if bodies.placing or not 0 < limit <= now - self._bodies_heard:
            return
        self._bodies_heard = now
        bodies.give_up()
        self.get_logger().warning(
            f"step {self.lockstep.world.step}: no report from the driver of {names} for "
            f"{limit:g} s (body_timeout): taken for not moved",
            throttle_duration_sec=5.0,
        )
        if self.lockstep.complete and self._goes_on():
            self._advance()

    def _place_of(self, robot: int) -> str:
        x, y = self._convert.centres[self.lockstep.world.cells[robot]]
        return f"({x:g}, {y:g})"

    def _end_when_finished(self) -> None:
        if self.lockstep.finished and not self.done:
            self._seconds += time.monotonic()
            self._report(time.monotonic())
            self._publish_markers()
            self._say_state(wire.FINISHED)
            self.done = True

    def destroy_node(self) -> None:
        """As `Node`'s; others may have its checkpoints then."""
        if self._checkpoints is not None:
            self._checkpoints.close()
        super().destroy_node()

    def finish(self, *, interrupted: bool) -> None:
        """Say good-bye, write summary and history, and let the last messages arrive."""
        self._over = True
        if not self._opened:
            return
        if interrupted and not self.done:
            if self._started:
                self._seconds += time.monotonic()
            self._say_state(wire.STOPPED)
        if self._started and not self.lockstep.held:
            self.checkpoint(self.lockstep.world.step)
        if self._out is not None:
            save_somewhere(self, self._out, self.run.to_yaml(), self._write_outcome)
        wait_for_readers(self.publishers)

    def _write_outcome(self, out: Path) -> None:
        text = yaml.safe_dump(self.summary(), sort_keys=False)
        (out / SUMMARY_FILE).write_text(text, encoding="utf-8")
        self.lockstep.history.history().save(out)

    def summary(self) -> dict[str, Any]:
        """Return what happened, as plain data."""
        world = self.lockstep.world
        seconds = max(0.0, self._seconds)
        made = max(0, world.transitions - self._begun_with)  # by this process, not before it
        bodies, moved = self._bodies, {}
        if bodies is not None:
            moved = {
                "moves_failed": bodies.failed,
                "bodies_lost": bodies.lost,
                "body_seconds": round(bodies.seconds, 3),
            }
        return {
            "transitions": world.transitions,
            "episodes": world.episode + 1,
            "last_step": world.step,
            "miscoordinations": world.miscoordinations,
            "timeouts": self.lockstep.timeouts,
            "stale_actions": self.lockstep.stale,
            "replaced_robots": self.replaced,
            "taken_back": self._back.taken_back,
            "transitions_lost": self._back.lost,
            "messages_dropped": self.intake.total,
            "executor": self.values["executor"],
            "rate": self.values["rate"],
            **moved,
            "seconds": round(seconds, 3),
            "steps_per_second": round(made / seconds, 1) if seconds else 0.0,
        }

    # Reports.

    @property
    def _is_here(self) -> bool:
        """Whether the game is where the team is; not so while a resumed one is yet to go back."""
        return not self.lockstep.held and (self._started or not self.values["resume"])

    def _running_state(self) -> str:
        if self.lockstep.held and self._back.order.step == ROLL_CALL:
            return wire.RESUMING  # where the team is will be known when all have answered
        if self._paused:
            return wire.PAUSED
        if self._started:
            return wire.GREEDY if self.run.greedy else wire.LEARNING
        return wire.RESUMING if self.values["resume"] else wire.WAITING

    def _say_state(self, state: str) -> None:
        self._state = state
        side = self.lockstep
        said = (side.world.step, side.world.transitions, side.left_out, side.began)
        values = dict(zip(wire.STATUS_VALUES, said, strict=True))
        values[wire.RUN_ID] = self.run.id
        values[wire.ROLLBACK] = order_text(self._back.order)
        self._status_publisher.publish(status(self.run.scenario.name, state, values))

    def _report(self, now: float) -> None:
        self._owners.look()
        world = self.lockstep.world
        before = self._reported_transitions
        rate = max(0, world.transitions - before) / (now - self._reported + 1e-9)
        self._reported, self._reported_transitions = now, world.transitions
        slowest = max(range(len(self._names)), key=self._slow.__getitem__)
        values = {
            "transitions": world.transitions,
            "budget": self.run.scenario.steps,
            "steps_per_second": f"{rate:.0f}",
            "episode": world.episode,
            "miscoordinations": world.miscoordinations,
            "slowest_robot": self._names[slowest],
            "slowest_seconds": f"{self._slow[slowest]:.4f}",
            "timeouts": self.lockstep.timeouts,
            "replaced_robots": self.replaced,
            "messages_dropped": self.intake.total,
            "topics_of_two_publishers": len(self._owners.doubled),
        }
        self._slow = [0.0] * len(self._names)
        message = DiagnosticArray(header=self._convert.header(world.step))
        message.status = [
            status(f"{self.full_name}: run", self._state, values, warn=bool(self.lockstep.absent))
        ]
        self._diagnostics_publisher.publish(message)
        self._say_state(self._state)
        if self._started and world.transitions != before:
            share = world.transitions / self.run.scenario.steps
            self.get_logger().info(
                f"{share:4.0%}  {world.transitions} of {self.run.scenario.steps} steps, "
                f"{rate:.0f} steps/s, episode {world.episode + 1}, "
                f"{world.miscoordinations} miscoordinations"
            )
        if self._is_here:
            self._publish_markers()

    def _publish_markers(self, *, scene: bool = True) -> None:
        world = self.lockstep.world
        self._marker_publisher.publish(self._markers.pack(world.step, world.cells))
        if scene:
            self._scene.publish(world.step, world.cells, always=self.lockstep.finished)

    def _create_publishers(self) -> None:
        self._status_publisher = self.announce(interface.STATUS)
        self._clock_publisher = self.announce(interface.CLOCK)
        self._map_publisher = self.announce(interface.MAP)
        self._marker_publisher = self.announce(interface.MARKERS)
        scene = Scene(self._convert, self._names)
        frames = self._bodies is None  # else the bodies say where they are
        self._scene = ScenePublisher(self, self.announce(interface.SCENE), scene, frames=frames)
        self._diagnostics_publisher = self.announce(interface.DIAGNOSTICS)
        self._state_publishers = [self.announce(interface.LOCAL_STATE, n) for n in self._names]
        self._reward_publishers = [self.announce(interface.REWARD, n) for n in self._names]
        self._action_subscriptions = [
            self.intake.listen(
                interface.ACTION,
                functools.partial(self._on_action, robot),
                name,
                read=functools.partial(self._read_action, robot),
            )
            for robot, name in enumerate(self._names)
        ]
        self._reached_subscriptions = []
        if self._bodies is not None:
            self._goals_publisher = self.announce(interface.BODY_GOALS)
            self._reached_subscriptions = [
                self.intake.listen(
                    interface.REACHED,
                    self._on_reached,
                    name,
                    read=typed(
                        interface.REACHED, functools.partial(read_reached, self._convert, robot)
                    ),
                )
                for robot, name in enumerate(self._names)
            ]
        read = typed(interface.CLAIM, read_claim)
        for robot, name in enumerate(self._names):
            then = functools.partial(self._on_claim, robot)
            self.intake.listen(interface.CLAIM, then, name, read=read, qos=interface.CLAIMS_QOS)


def _period(values: Mapping[str, Any]) -> int:
    """Return the nanoseconds between two steps at the wanted rate."""
    return round(1e9 / values["rate"])


def main(args: list[str] | None = None) -> int:
    """Run the node `world_simulator`."""
    tidy_shared_memory()
    return run_node(lambda context: WorldSimulator(context=context), args)


if __name__ == "__main__":
    sys.exit(main())
