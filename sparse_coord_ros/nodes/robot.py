# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot node: one agent of Algorithm 1, which knows of its peers only what they answer."""

import functools
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Path as PathMessage
from nav_msgs.srv import GetPlan
from rclpy.context import Context
from std_msgs.msg import String
from std_srvs.srv import Trigger

from sparse_coord_ros.core import wire
from sparse_coord_ros.core.agent import Tables
from sparse_coord_ros.core.frame import Account
from sparse_coord_ros.core.run_config import RunConfig, run_from_yaml
from sparse_coord_ros.core.tables import TEAM_FILE, pack_tables, robot_file, write_tables
from sparse_coord_ros.core.wire import RECORDER, WORLD
from sparse_coord_ros.core.world import Action
from sparse_coord_ros.errors import RunError, TablesError, did_you_mean, os_error_text
from sparse_coord_ros.lockstep.robot import Answer, RobotSide
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.claim import Claim
from sparse_coord_ros.nodes.episode_messages import CoordinationMapLayout
from sparse_coord_ros.nodes.messages import Converter, status, status_values, tables_message
from sparse_coord_ros.nodes.outputs import begin_with, open_output
from sparse_coord_ros.nodes.parameters import ROBOT_PARAMETERS, ParameterNode, stops_on_bad_input
from sparse_coord_ros.nodes.peers import Peer
from sparse_coord_ros.nodes.spin import run_node, wait_for_readers
from sparse_coord_ros.nodes.tap import Tap

TICK_SECONDS = 0.02
REPORT_SECONDS = 1.0
PEER_PATIENCE_SECONDS = 2.0
"""How long a robot that is ready itself waits for its peers' services before it says so."""
LAST_WORDS_SECONDS = 2.0
"""How long a robot waits for its last reward after the run's end."""


class RobotNode(ParameterNode):
    """Holds Q*_k and Q^C_k, acts and learns; the node's name is the robot's name.

    Args:
        context: the ROS context.
        name: the robot's name unless the command line remaps it.
        namespace: the team's namespace.
        values: parameters given by the program; None: by the command line.
        tap: the way to a recorder in the same process.

    Raises:
        SparseCoordError: a bad parameter, a name that is taken or that the scenario does not have,
            no world simulator.
    """

    def __init__(
        self,
        *,
        context: Context,
        name: str = "robot",
        namespace: str = "",
        values: Mapping[str, Any] | None = None,
        tap: Tap | None = None,
    ) -> None:
        super().__init__(
            name, ROBOT_PARAMETERS, context=context, namespace=namespace, values=values, tap=tap
        )
        self.name = self.get_name()
        self.done = False
        self.lockstep: RobotSide | None = None
        self._convert: Converter | None = None
        self._map: CoordinationMapLayout | None = None
        self._out: Path | None = None
        self._run_text: str | None = None
        self._run: RunConfig | None = None
        self._last_step: int | None = None
        self._ended: float | None = None
        self._joined = False
        self._waiting: tuple | None = None
        self._waiting_since = 0.0
        self._reported = time.monotonic()
        self._ready_since: float | None = None
        self._peers: dict[int, Peer] = {}
        self._claim = Claim(self)
        self._action_publisher = self.announce(interface.ACTION, self.name)
        self._percept_publisher = self.announce(interface.PERCEPT, self.name)
        self._map_publisher = self.announce(interface.COORDINATION_MAP, self.name)
        self._tables_publisher = self.announce(interface.TABLES, self.name)
        self._diagnostics_publisher = self.announce(interface.DIAGNOSTICS)
        self._listen(interface.RUN, self._on_run)
        self._listen(interface.STATUS, self._on_status)
        self.create_timer(TICK_SECONDS, self._tick)

    # Outgoing: the port of the protocol.

    def act(self, step: int, action: Action, account: Account) -> None:
        """Publish the action that answers the local state of a time step."""
        self._action_publisher.publish(self._convert.pack_action(step, action, account))

    def percept(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> None:
        """Publish what came of COORDINATE."""
        self._percept_publisher.publish(self._convert.path(step, (cell, *(perceived or ()))))

    def ask(self, peer: int, step: int, cell: int) -> None:
        """Request the peer's local state; a peer that fell silent is not waited for."""
        if not self._peers[peer].request(self._convert.pose(step, cell), step):
            self.lockstep.expire()

    def episode(self, step: int) -> None:
        """Publish the coordination map as it is when an episode begins."""
        self._publish_map(step)

    def checkpoint(self, step: int) -> None:
        """Publish the tables on the way."""
        self._publish_tables(wire.CHECKPOINT)

    # Incoming.

    @stops_on_bad_input
    def _on_run(self, message: String) -> None:
        if self._run is not None:  # a world announces its run once
            self.get_logger().warning(
                "another world simulator has started; this robot stays with the run that it is "
                "in, restart it to join the other"
            )
            return
        self._run = run_from_yaml(message.data, where="topic run")
        self._run_text = message.data

    def _on_status(self, message: DiagnosticStatus) -> None:
        if message.message not in (wire.FINISHED, wire.STOPPED):
            return
        try:
            self._last_step = int(status_values(message)["step"])
        except (KeyError, ValueError) as error:
            self.get_logger().warning(f"{interface.STATUS.name}: no step ({error}); ignored")
            return
        self._ended = self._ended or time.monotonic()

    def _on_state(self, data: bytes) -> None:
        try:
            step, cell = self._convert.unpack_state(data)
        except ValueError as error:
            self._ignore(interface.LOCAL_STATE, error)
            return
        self.lockstep.state(step, cell)

    def _on_reward(self, data: bytes) -> None:
        try:
            step, reward = self._convert.unpack_reward(data)
        except ValueError as error:
            self._ignore(interface.REWARD, error)
            return
        self.lockstep.reward(step, reward)

    def _on_asked(self, request: GetPlan.Request, response: GetPlan.Response):
        """Answer a peer (or a person, who gives no stamp and no name)."""
        stamp, position = request.start.header.stamp, request.start.pose.position
        step = self._convert.step(stamp.sec, stamp.nanosec)
        names = [robot.name for robot in self._run.scenario.robots]
        asker = request.goal.header.frame_id
        if step and asker not in names:
            self.get_logger().warning(
                f"{wire.ACTIVE_PERCEPTION}: asker {asker!r} is no robot of the scenario; refused",
                throttle_duration_sec=5.0,
            )
            answer = Answer(self.lockstep.newest[0], None)
        else:
            number = names.index(asker) if asker in names else 0
            answer = self.lockstep.asked(number, step, self._convert.cell(position.x, position.y))
        response.plan = self._convert.path(answer.step, (answer.cell,))
        return response

    def _on_answer(self, peer: int, request_step: int, plan: PathMessage) -> None:
        step = self._convert.step(plan.header.stamp.sec, plan.header.stamp.nanosec)
        cell = None
        if plan.poses:
            position = plan.poses[0].pose.position
            cell = self._convert.cell(position.x, position.y)
        self.lockstep.answer(peer, request_step, Answer(step, cell))

    def _on_save(self, request: Trigger.Request, response: Trigger.Response):
        response.success = self._out is not None and self.lockstep is not None
        response.message = "no parameter 'out' was given: nowhere to save"
        if response.success:
            try:
                response.message = f"saved {self._save()}"
            except OSError as error:
                response.success = False
                response.message = os_error_text(error)
        return response

    # The course of the run.

    @stops_on_bad_input
    def _tick(self) -> None:
        now = time.monotonic()
        if now - self.born < self.values["claim_window"]:
            return
        if self._run is None:
            self.check_startup_time()
            return
        if self.lockstep is None:
            self._prepare()
        if not self._joined:
            self._join_when_ready(now)
        elif self._ended is not None:
            self._end_when_learned(now)
        else:
            self._watch_the_deadline(now)
        if now - self._reported >= REPORT_SECONDS:
            self._report(now)
            if self.world_is_gone():
                self.get_logger().warning("the world simulator is gone: this robot ends too")
                self.done = True

    def _prepare(self) -> None:
        """Become an agent of the run: tables, service, clients."""
        names = [robot.name for robot in self._run.scenario.robots]
        if self.name not in names:
            raise RunError(
                f"robot {self.name!r}: scenario {self._run.scenario.name} has no such robot"
                f"{did_you_mean(self.name, names)}; its robots are {', '.join(names)}; name the "
                f"node with --ros-args -r __node:={names[0]}"
            )
        number = names.index(self.name)
        tables = self._initial_tables(number)
        self._convert = Converter(self._run)
        self._map = CoordinationMapLayout(self._convert)
        own = [robot_file(Path(), self.name).name, TEAM_FILE]
        self._out = open_output(self.values["out"], self._run_text, own)
        agent = self._run.rule.agent(
            self._run.scenario,
            number,
            self._run.seed,
            tables=tables,
            learning=not self._run.greedy,
        )
        self.lockstep = RobotSide(self._run, agent, self)
        service = f"{self.name}/{wire.ACTIVE_PERCEPTION}"
        Peer.introspect(
            self, self.create_service(interface.ACTIVE_PERCEPTION_TYPE, service, self._on_asked)
        )
        self.create_service(Trigger, "~/save", self._on_save)
        self._peers = {
            k: Peer(self, name, functools.partial(self._on_answer, k))
            for k, name in enumerate(names)
            if k != number
        }

    def _initial_tables(self, number: int) -> Tables | None:
        source = self.values["tables"] or self._run.tables
        if source:
            return begin_with(Path(source), self._run)[number]
        if self._run.greedy:
            raise TablesError(
                f"robot {self.name}: the run is greedy but parameter 'tables' names no learned "
                "tables; give the output directory of a run"
            )
        return None

    def _join_when_ready(self, now: float) -> None:
        """Listen to the world once everybody who should hear this robot does.

        The world waits for these subscriptions: with them the robot says that it is ready.
        """
        if not self.heard_by(self._action_publisher, [WORLD]):
            return
        if self._run.recorded and not self._recorder_hears():
            return
        self._ready_since = self._ready_since or now
        if now - self._ready_since < PEER_PATIENCE_SECONDS and not all(
            peer.ready() for peer in self._peers.values()
        ):
            return
        self._joined = True
        self._listen(interface.REWARD, self._on_reward, self.name, raw=True)
        self._listen(interface.LOCAL_STATE, self._on_state, self.name, raw=True)
        self._publish_map(self.lockstep.handled)
        self._publish_tables(wire.INITIAL)

    def _recorder_hears(self) -> bool:
        """Whether a recorder listens to what this robot does, asks and answers."""
        own = (self._action_publisher, self._percept_publisher)
        return all(self.heard_by(publisher, [RECORDER]) for publisher in own) and all(
            self.is_recorded(interface.SERVICE_EVENTS.of(robot.name))
            for robot in self._run.scenario.robots
        )

    def _watch_the_deadline(self, now: float) -> None:
        waiting = self.lockstep.waiting
        if waiting is None or waiting != self._waiting:
            self._waiting, self._waiting_since = waiting, now
        elif now - self._waiting_since >= self._run.percept_timeout:
            self._waiting = None
            if waiting[0] == "percept":
                self._peers[self.lockstep.asking].gave_up()
            self.lockstep.expire()
        for peer in self._peers.values():
            peer.send_what_waits()

    def _end_when_learned(self, now: float) -> None:
        learned = self.lockstep.waiting is None and self.lockstep.newest[0] >= self._last_step
        if learned or now - self._ended > LAST_WORDS_SECONDS:
            self.done = True

    def finish(self, *, interrupted: bool) -> None:
        """Publish the last coordination map and the tables, save them and let all arrive."""
        if self.lockstep is None:
            return
        self._report(time.monotonic())
        self._publish_tables(wire.FINAL)
        if self._out is not None:
            self.get_logger().info(f"saved {self._save()}")
        wait_for_readers(
            (
                self._action_publisher,
                self._percept_publisher,
                self._map_publisher,
                self._tables_publisher,
            )
        )

    def _save(self) -> Path:
        path = robot_file(self._out, self.name)
        write_tables(path, self._packed())
        return path

    def _packed(self) -> bytes:
        """Return the tables as they are, with what they are of."""
        agent = self.lockstep.agent
        return pack_tables({agent.number + 1: agent.tables}, counts=self.lockstep.counts)

    # Reports.

    def _report(self, now: float) -> None:
        self._reported = now
        step = self.lockstep.newest[0]
        values = {
            **{f"asks_{how}": count for how, count in self.lockstep.asks.items()},
            "epsilon": f"{self.lockstep.agent.epsilon(step):.4f}",
            "transitions_dropped": self.lockstep.dropped,
        }
        message = DiagnosticArray(header=self._convert.header(step))
        message.status = [
            status(self.name, "learning" if self.lockstep.agent.learning else "greedy", values)
        ]
        self._diagnostics_publisher.publish(message)
        self._publish_map(self.lockstep.handled)

    def _publish_map(self, step: int) -> None:
        self._map_publisher.publish(self._map.pack(step, self.lockstep.agent.tables))

    def _publish_tables(self, occasion: str) -> None:
        self._tables_publisher.publish(
            tables_message(self._packed(), self.lockstep.handled, occasion)
        )

    def _ignore(self, topic: interface.RosTopic, error: ValueError) -> None:
        self.get_logger().warning(
            f"{topic.of(self.name)}: {error}; message ignored", throttle_duration_sec=5.0
        )

    def _listen(self, topic: interface.RosTopic, callback, robot: str = "", *, raw: bool = False):
        name = topic.of(robot) if robot else topic.name
        self.create_subscription(topic.type, name, callback, topic.qos, raw=raw)


def main(args: list[str] | None = None) -> int:
    """Run the node `robot`."""
    return run_node(lambda context: RobotNode(context=context), args)


if __name__ == "__main__":
    sys.exit(main())
