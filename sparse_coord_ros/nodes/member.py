# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot's part in one run: all that exists once the run is known."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path as PathMessage
from nav_msgs.srv import GetPlan
from std_srvs.srv import Trigger

from sparse_coord_ros import wire
from sparse_coord_ros.errors import RunError, TablesError, did_you_mean, os_error_text
from sparse_coord_ros.game.world import Action, Reward
from sparse_coord_ros.learn.agent import Agent, Tables
from sparse_coord_ros.learn.tables import TEAM_FILE, pack_tables, robot_file, write_tables
from sparse_coord_ros.lockstep.checkpoints import Checkpoints
from sparse_coord_ros.lockstep.gate import StepGate
from sparse_coord_ros.lockstep.robot_side import NO_STEP, Answer, RobotSide
from sparse_coord_ros.lockstep.rollback import ROLL_CALL, Order, RobotRollback
from sparse_coord_ros.lockstep.waiting import Deadline, Reminder, WorldPresence
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.episode_messages import CoordinationMapLayout
from sparse_coord_ros.nodes.messages import (
    Announced,
    Converter,
    progress_message,
    status,
    tables_message,
)
from sparse_coord_ros.nodes.outputs import begin_with, open_output, save_somewhere, saving
from sparse_coord_ros.nodes.peers import Clients, Peer, introspect
from sparse_coord_ros.wire import RECORDER, WORLD
from sparse_coord_ros.wire.frame import Account

if TYPE_CHECKING:
    from sparse_coord_ros.nodes.robot import RobotNode

PEER_PATIENCE_SECONDS = 2.0
"""How long a robot that is ready itself waits for its peers' services before it says so."""


class Member:
    """One agent of a run and its place on the wire; the port of its side of the lock step.

    Args:
        node: the robot's node.
        announced: the run.
        presence: whether its world is there.
        clients: those of the robots of this process.

    Attributes:
        lockstep: the robot's side of the lock step, with its agent.
        joined: whether the robot listens to the world.

    Raises:
        SparseCoordError: the scenario has no such robot, or the tables to begin with do not fit.
    """

    def __init__(
        self, node: "RobotNode", announced: Announced, presence: WorldPresence, clients: Clients
    ) -> None:
        self._node, self._presence = node, presence
        self.run, self._text = run, text = announced
        self._names = [robot.name for robot in run.scenario.robots]
        number = self._number()
        self._convert = Converter(run)
        self._map = CoordinationMapLayout(self._convert)
        own = [robot_file(Path(), node.name).name, TEAM_FILE]
        resumed = node.values["resume"]
        self._out = open_output(node.values["out"], text, [] if resumed else own)
        if resumed and self._out is None:
            raise RunError(
                f"robot {node.name}: parameter resume needs parameter 'out', the output directory"
            )
        self._checkpoints: Checkpoints | None = None
        if self._out is not None:
            self._checkpoints = Checkpoints(self._out, node.name, run)
        self.lockstep = RobotSide(run, self._fresh_agent(), self)
        self._back = RobotRollback(
            self.lockstep, self._checkpoints, self._fresh_agent, node.claim.id, resumed=resumed
        )
        self._unsaid = resumed
        if resumed:
            self._begin_again()
        self._gate = StepGate()
        self._kept = (0, 0)
        self._reminder = Reminder()
        self.joined = False
        self._ears: list[Any] = []
        self._ready_since = 0.0
        self._deadline = Deadline(run.percept_timeout, run.step_timeout)
        service = f"{node.name}/{wire.ACTIVE_PERCEPTION}"
        introspect(
            node, node.create_service(interface.ACTIVE_PERCEPTION_TYPE, service, self._on_asked)
        )
        node.create_service(Trigger, wire.SAVE, self._on_save)
        self._peers = {
            k: Peer(
                node, clients.of(name, node), node.guarded(functools.partial(self._on_answer, k))
            )
            for k, name in enumerate(self._names)
            if k != number
        }
        self.say_progress()

    def _number(self) -> int:
        name, names = self._node.name, self._names
        if name not in names:
            raise RunError(
                f"robot {name!r}: scenario {self.run.scenario.name} has no such robot"
                f"{did_you_mean(name, names)}; its robots are {', '.join(names)}; name the "
                f"node with --ros-args -r __node:={names[0]}"
            )
        return names.index(name)

    def _fresh_agent(self) -> Agent:
        """Return an agent as it is at the run's beginning."""
        run, number = self.run, self._number()
        tables = self._initial_tables(number)
        return run.rule.agent(
            run.scenario, number, run.seed, tables=tables, learning=not run.greedy
        )

    def _begin_again(self) -> None:
        """Go on from the newest checkpoint of one's own, and say so."""
        step = self._back.begin()
        for line in self._checkpoints.broken if self._checkpoints is not None else ():
            self._node.get_logger().warning(line)
        what = f"goes on from its checkpoint of step {step}" if step else "has no checkpoint yet"
        self._node.get_logger().info(f"{self._node.name} {what}")

    def say_progress(self) -> None:
        """Tell the world which checkpoints there are."""
        said = progress_message(self._node.name, self._back.progress())
        self._node.progress_publisher.publish(said)

    def obey(self, order: Order) -> None:
        """Go back to a checkpoint, where the world orders it."""
        if not self._back.obey(order):
            return
        if order.step == ROLL_CALL:
            if self.joined:
                self.say_progress()
            return
        self._unsaid = False
        self._gate = StepGate(order.first)
        for peer in self._peers.values():
            peer.start_anew()
        self._node.get_logger().info(f"went back to the checkpoint of step {order.step}")
        self.joined = False  # the world goes on when all listen anew, and have said so

    def _say_what_is_known(self, step: int) -> None:
        self.publish_map(step)
        self.publish_tables(wire.INITIAL)

    def _initial_tables(self, number: int) -> Tables | None:
        source = self._node.values["tables"] or self.run.tables
        if source:
            return begin_with(Path(source), self.run)[number]
        if self.run.greedy:
            raise TablesError(
                f"robot {self._node.name}: the run is greedy but parameter 'tables' names no "
                "learned tables; give the output directory of a run"
            )
        return None

    # Outgoing: the port of the lock step.

    def act(self, step: int, action: Action, account: Account) -> None:
        """Publish the action that answers the local state of a time step."""
        self._node.action_publisher.publish(self._convert.pack_action(step, action, account))

    def percept(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> None:
        """Publish what came of COORDINATE."""
        self._node.percept_publisher.publish(self._convert.path(step, (cell, *(perceived or ()))))

    def ask(self, peer: int, step: int, cell: int) -> None:
        """Request the peer's local state; a peer that fell silent is not waited for."""
        if not self._peers[peer].request(self._convert.pose(step, cell), step):
            self.lockstep.expire()

    def episode(self, step: int) -> None:
        """Publish the coordination map as it is when an episode begins."""
        self.publish_map(step)

    def checkpoint(self, step: int) -> None:
        """Publish the tables on the way, and save where the robot is."""
        self.publish_tables(wire.CHECKPOINT)
        self._save_checkpoint()

    def _save_checkpoint(self) -> None:
        if self._checkpoints is not None:
            with saving(self._node):
                self._checkpoints.save_robot(self.lockstep.snapshot())
            self.say_progress()

    # Incoming.

    def _on_state(self, said: tuple[int, int]) -> None:
        if not self.joined:  # it went back, and is yet to listen anew
            return
        step, cell = said
        if not self._gate.passes(step):
            self._kept = said
            self._drop(
                interface.LOCAL_STATE,
                f"step {step} does not follow {self._gate.newest}, and the world has not said "
                "that it is so far",
            )
            return
        if self._presence.sees(step):
            self._node.intake.drop(interface.STATUS.name, "the run was said to be over")
        if self._unsaid:  # no order to go back has come: it goes on from its own checkpoint
            self._unsaid = False
            self._say_what_is_known(step)
        self.lockstep.state(step, cell)

    def world_said(self, step: int) -> None:
        """Take in the time step that the world's status names."""
        if self._gate.confirmed(step):
            self.lockstep.state(*self._kept)

    def _on_reward(self, said: tuple[int, Reward]) -> None:
        self.lockstep.reward(*said)

    def _on_asked(self, request: GetPlan.Request, response: GetPlan.Response) -> GetPlan.Response:
        """Answer a peer (or a person, who gives no stamp and no name)."""
        stamp, position = request.start.header.stamp, request.start.pose.position
        asker = request.goal.header.frame_id
        try:
            step = self._convert.checked_step(stamp.sec, stamp.nanosec)
            if step and asker not in self._names:
                raise ValueError(f"asker {asker!r} is no robot of the scenario")
        except ValueError as error:
            self._node.intake.drop(f"{self._node.name}/{wire.ACTIVE_PERCEPTION}", error)
            answer = Answer(self.lockstep.newest[0], None)
        else:
            number = self._names.index(asker) if asker in self._names else 0
            answer = self.lockstep.asked(number, step, self._convert.cell(position.x, position.y))
        response.plan = self._convert.path(answer.step, (answer.cell,))
        return response

    def _on_answer(self, peer: int, request_step: int, plan: PathMessage) -> None:
        cell = None
        try:
            step = self._convert.checked_step(plan.header.stamp.sec, plan.header.stamp.nanosec)
            if plan.poses:
                position = plan.poses[0].pose.position
                cell = self._convert.cell(position.x, position.y)
                if cell is None:
                    raise ValueError(f"position ({position.x:g}, {position.y:g}) is no free cell")
        except ValueError as error:
            self._node.intake.drop(f"{self._names[peer]}/{wire.ACTIVE_PERCEPTION}", error)
            return
        self.lockstep.answer(peer, request_step, Answer(step, cell))

    def _on_save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            path = self._save()
        except OSError as error:
            response.success, response.message = False, os_error_text(error)
            return response
        response.success = path is not None
        response.message = f"saved {path}" if path else "no parameter 'out': nowhere to save"
        return response

    # The course of the run.

    def join_when_ready(self, now: float) -> None:
        """Listen to the world once everybody who should hear this robot does.

        The world waits for these subscriptions: with them the robot says that it is ready.
        """
        missing = self._not_heard_by()
        if missing:
            self._node.remind(self._reminder, missing)
            return
        self._ready_since = self._ready_since or now
        if now - self._ready_since < PEER_PATIENCE_SECONDS and not all(
            peer.ready() for peer in self._peers.values()
        ):
            return
        self._listen()
        self._node.claim.join()
        self.say_progress()
        if not self._unsaid:
            self._say_what_is_known(self.lockstep.handled)

    def _listen(self) -> None:
        """Listen to the world from now on: nothing that it published before comes any more."""
        for ear in self._ears:
            self._node.destroy_subscription(ear)
        if not self._ears:
            run = self.run
            self._node.get_logger().info(f"joined run {run.scenario.name}, seed {run.seed}")
        name, listen, convert = self._node.name, self._node.intake.listen, self._convert
        self._ears = [
            listen(interface.REWARD, self._on_reward, name, read=convert.unpack_reward),
            listen(interface.LOCAL_STATE, self._on_state, name, read=convert.unpack_state),
        ]
        self.joined = True

    def _not_heard_by(self) -> str:
        """Return who is to hear this robot and does not yet, or an empty text."""
        if not self._node.heard_by(self._node.action_publisher, [WORLD]):
            return "the world simulator to listen to this robot"
        if self.run.recorded and not self._recorder_hears():
            return "a recorder to listen to this robot"
        return ""

    def _recorder_hears(self) -> bool:
        """Whether a recorder listens to what this robot does, asks and answers."""
        own = (self._node.action_publisher, self._node.percept_publisher)
        return all(self._node.heard_by(publisher, [RECORDER]) for publisher in own) and all(
            self._node.is_recorded(interface.SERVICE_EVENTS.of(robot.name))
            for robot in self.run.scenario.robots
        )

    def watch_the_deadline(self, now: float) -> None:
        """Give up what has been waited for too long; send requests that could not be sent."""
        asked = self._peers.get(self.lockstep.asking)
        heard = 0.0 if asked is None else asked.heard
        if self._deadline.passed(self.lockstep.waiting, heard, now):
            if asked is not None:
                asked.gave_up()
            self.lockstep.expire()
        for peer in self._peers.values():
            if peer.waits:
                peer.send_what_waits()

    def _save(self) -> Path | None:
        """Write the tables and return where; None: no directory was given."""
        if self._out is None:
            return None
        packed, name = self._packed(), self._node.name

        def write(out: Path) -> None:
            write_tables(robot_file(out, name), packed)

        place = save_somewhere(self._node, self._out, self._text, write)
        return robot_file(place, name)

    def finish(self) -> None:
        """Publish the last coordination map and the tables, and save them."""
        if self.lockstep.handled and not self._unsaid:
            self._save_checkpoint()
        path = self._save()
        if path is not None:
            self._node.get_logger().info(f"saved {path}")
        self.report()
        self.publish_tables(wire.FINAL)

    def close(self) -> None:
        """Let others have its checkpoints."""
        if self._checkpoints is not None:
            self._checkpoints.close()

    def has_learned(self, last_step: int) -> bool:
        """Whether all is learned that happened before a time step, the run's last."""
        return self.lockstep.waiting is None and self.lockstep.newest[0] >= last_step

    def _packed(self) -> bytes:
        """Return the tables as they are, with what they are of."""
        agent = self.lockstep.agent
        return pack_tables({agent.number + 1: agent.tables}, counts=self.lockstep.counts)

    # Reports.

    def report(self) -> None:
        """Say how learning goes, and where the robot would ask."""
        step = self.lockstep.newest[0]
        if self.joined and step == NO_STEP:
            self._node.remind(self._reminder, "the world to begin")
        values = {
            **{f"asks_{how}": count for how, count in self.lockstep.asks.items()},
            "epsilon": f"{self.lockstep.agent.epsilon(step):.4f}",
            "transitions_dropped": self.lockstep.dropped,
            "messages_dropped": self._node.intake.total,
        }
        message = DiagnosticArray(header=self._convert.header(step))
        message.status = [
            status(
                f"{self._node.full_name}: agent",
                wire.LEARNING if self.lockstep.agent.learning else wire.GREEDY,
                values,
            )
        ]
        self._node.diagnostics_publisher.publish(message)
        if not self._unsaid:
            self.publish_map(self.lockstep.handled)

    def publish_map(self, step: int) -> None:
        """Publish the coordination map at a time step."""
        self._node.map_publisher.publish(self._map.pack(step, self.lockstep.agent.tables))

    def publish_tables(self, occasion: str) -> None:
        """Publish the tables; `occasion` says why."""
        self._node.tables_publisher.publish(
            tables_message(self._packed(), self.lockstep.handled, occasion)
        )

    def _drop(self, topic: interface.RosTopic, why: object) -> None:
        self._node.intake.drop(topic.of(self._node.name), why)
