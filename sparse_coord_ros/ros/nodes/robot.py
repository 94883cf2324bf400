# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot node: one agent of Algorithm 1, which acts on what its peers answer.

`Member` is the robot's part in a run, and exists once the run is known.
"""

from functools import partial
from pathlib import Path
from typing import Any, Unpack

from sparse_coord_ros.base.errors import NameTakenError, TablesError, os_error_text
from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.runs.tables import TEAM_FILE, pack_tables, robot_file
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.lockstep.attempts import RobotAttempts
from sparse_coord_ros.protocol.lockstep.robot_side import NO_STEP, RobotSide
from sparse_coord_ros.protocol.wire import RECORDER, WORLD, SelfReport, services
from sparse_coord_ros.protocol.wire.status import NO_ATTEMPT, RunStatus
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.follower import Follower
from sparse_coord_ros.ros.nodes.messages import (
    Converter,
    robot_number,
    status,
    tables_message,
)
from sparse_coord_ros.ros.nodes.outputs import Output, begin_with
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, NodePlace
from sparse_coord_ros.ros.nodes.peers import Peers
from sparse_coord_ros.ros.nodes.spin import run_node, wait_for_readers

LAST_REWARD_SECONDS = 2.0
"""How long a robot waits for its last reward after the run's end."""

GHOST_SECONDS = 6.0
"""How long another node of the robot's name may stay: a killed one is in the graph for 5 s
(`config/fastdds.xml`)."""

PEER_PATIENCE_SECONDS = 2.0
"""How long a robot that is ready waits for its peers' services before it logs their names."""


class Member:
    """One agent of a run and its topics; the port of its side of the lock step.

    Args:
        node: the robot's node, which follows the run.
        run: the run.

    Attributes:
        output: saves its files.
        lockstep: the robot's side of the lock step, with its agent.
        joined: whether the robot listens to the world.
        peers: asks its peers, and answers them.

    Raises:
        SparseCoordError: the scenario has no such robot, or the tables to begin with do not fit.
    """

    def __init__(self, node: "RobotNode", run: RunConfig) -> None:
        assert node.presence is not None
        self._node = node
        self._presence = node.presence
        self._name = node.get_name()
        self.run = run
        remedy = (
            f"name the node with --ros-args -r __node:={run.scenario.robots[0].name}"
        )
        self._number = robot_number(run, self._name, remedy)
        self._convert = Converter(run)
        own = [robot_file(Path(), self._name).name, TEAM_FILE]
        self.output = Output(node, self._name, run, own)
        self._action = node.announce(ros_topics.ACTION, self._name)
        self._percept = node.announce(ros_topics.PERCEPT, self._name)
        self._map_publisher = node.announce(ros_topics.COORDINATION_MAP, self._name)
        self._tables = node.announce(ros_topics.TABLES, self._name)
        self._progress = node.announce(ros_topics.PROGRESS, self._name)
        self._report = node.reporter("agent")
        self.lockstep = RobotSide(run, self._fresh_agent(), self)
        self._attempts = RobotAttempts(
            self.lockstep, self.output.store, self._fresh_agent, node.found.attempt
        )
        self.joined = False
        self._ears: list[Any] = []
        self._ready_since = 0.0
        self.peers = Peers(node, run, self._convert, self.lockstep)
        node.offer(services.SAVE, self._on_save)
        self._say_progress()

    def _fresh_agent(self) -> Agent:
        """Return an agent in its initial state."""
        run = self.run
        number = self._number
        learning = not self.run.greedy
        if run.greedy and not run.tables:
            raise TablesError(
                "the run is greedy but parameter 'tables' names no learned tables; give the "
                "output directory of a run"
            )
        memory = begin_with(Path(run.tables), run, number) if run.tables else None
        return Agent(
            run.rule, run.scenario, number, run.seed, memory=memory, learning=learning
        )

    # Beginning at a checkpoint.

    def _say_progress(self) -> None:
        """Tell the world the robot's checkpoints, and the attempt that it has begun."""
        self._progress.publish(
            status(self._name, "progress", self._attempts.progress().values())
        )

    @property
    def _begun(self) -> bool:
        """True if the robot has had an order to begin."""
        return self._attempts.attempt != NO_ATTEMPT

    def world_said(self, said: RunStatus) -> None:
        """Read the world's status: its order to begin."""
        if self._attempts.obey(said.order):
            self._begin(said.order.checkpoint)
        self.output.store.forget_before(said.oldest)

    def _begin(self, step: int) -> None:
        """Begin at a checkpoint; the world waits until all listen again."""
        self.peers.start_anew()
        self.joined = False
        self._publish_tables(wire.Occasion.BEGIN)
        if step:
            self._node.get_logger().info(
                f"{self._name} continues from its checkpoint of step {step}"
            )

    # Outgoing: the port of the lock step.

    def act(self, step: int, action: Action, report: SelfReport) -> None:
        """Publish the action that answers the local state of a time step."""
        self._action.publish(self._convert.pack_action(step, action, report))

    def percept(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> None:
        """Publish the result of COORDINATE."""
        self._percept.publish(self._convert.path(step, (cell, *(perceived or ()))))

    def ask(self, peer: int, step: int, cell: int) -> None:
        """Request the peer's local state; return False for a peer that fell silent."""
        if not self.peers.ask(peer, step, cell):
            self.lockstep.expire()

    def episode(self, step: int) -> None:
        """Publish the current coordination map, when an episode begins and now and then."""
        q_star = self.lockstep.agent.q_star
        self._map_publisher.publish(self._convert.pack_coordination_map(step, q_star))

    def checkpoint(self, step: int) -> None:
        """Publish the current tables, and save a checkpoint."""
        self._publish_tables(wire.Occasion.CHECKPOINT)
        self._save_checkpoint()

    # Incoming.

    def _on_state(self, said: tuple[int, int]) -> None:
        if not self.joined:  # it went back, and does not listen again yet
            return
        step, cell = said
        self.lockstep.state(step, cell)

    def _on_peer_state(self, peer: int, said: tuple[int, int]) -> None:
        if self.joined:
            self.lockstep.peer_state(peer, *said)

    def _on_save(self) -> tuple[bool, str]:
        if not self._begun:
            return False, "the run has not begun: nothing can be saved"
        try:
            path = self._save()
        except OSError as error:
            return False, os_error_text(error)
        if path is None:
            return False, "parameter 'out' is empty: nothing can be saved"
        return True, f"saved {path}"

    # The course of the run.

    def go_on(self, now: float) -> None:
        """Join the run when the world orders it; then keep its deadlines until it is over."""
        if not self.joined:
            if self._begun:
                self._join_when_ready(now)
        elif self._presence.end is None:
            self.peers.keep_the_deadline(now)

    def _join_when_ready(self, now: float) -> None:
        """Subscribe to the world once all required subscribers of this robot are there.

        The world waits for these subscriptions: they tell it that the robot is ready.
        """
        missing = self._not_heard_by()
        if missing:
            self._node.remind(self._node.reminder, missing)
            return
        self._ready_since = self._ready_since or now
        if now - self._ready_since < PEER_PATIENCE_SECONDS and not self.peers.ready():
            return
        self._listen()
        self._say_progress()

    def _listen(self) -> None:
        """Subscribe to the world: only messages that it publishes from now on arrive."""
        for ear in self._ears:
            self._node.destroy_subscription(ear)
        if not self._ears:
            run = self.run
            self._node.get_logger().info(
                f"joined run {run.scenario.name}, seed {run.seed}"
            )
        listen = self._node.subscriber.listen
        convert = self._convert

        def on_reward(said: tuple[int, Reward]) -> None:
            self.lockstep.reward(*said)

        self._ears = [
            listen(
                ros_topics.REWARD, on_reward, self._name, unpack=convert.unpack_reward
            ),
            listen(
                ros_topics.LOCAL_STATE,
                self._on_state,
                self._name,
                unpack=convert.unpack_state,
            ),
        ]
        if self.run.sees_all:
            for peer in self.lockstep.agent.peers:
                self._ears.append(
                    listen(
                        ros_topics.LOCAL_STATE,
                        partial(self._on_peer_state, peer),
                        convert.names[peer],
                        unpack=convert.unpack_state,
                    )
                )
        self.joined = True

    def _not_heard_by(self) -> str:
        """Return the required subscribers of this robot that are missing, or an empty text."""
        if not self._node.heard_by(self._action, WORLD):
            return "the world simulator to listen to this robot"
        if self.run.recorded and not self._is_recorded():
            return "a recorder to listen to this robot"
        return ""

    def _is_recorded(self) -> bool:
        """Return whether a recorder listens to this robot's topics and to all services."""
        for publisher in (self._action, self._percept):
            if not self._node.heard_by(publisher, RECORDER):
                return False
        services_of = ros_topics.SERVICE_EVENTS.of
        names = self.run.scenario.names
        return all(self._node.is_heard(services_of(name), RECORDER) for name in names)

    def all_done(self, now: float) -> bool:
        """Return whether all transitions are learned, or missing messages are overdue."""
        side = self.lockstep
        end = self._presence.end
        heard_all = self.joined and end is not None and side.newest[0] >= end
        learned_all = heard_all and side.waiting is None
        overdue = now - self._presence.ended > LAST_REWARD_SECONDS
        return learned_all or overdue

    # Saving.

    def _save_checkpoint(self) -> None:
        self.output.checkpoint(self.lockstep.snapshot())
        self._say_progress()

    def _save(self) -> Path | None:
        """Write the tables and return their path; None: the parameter `out` is not set."""
        packed = self._packed()
        name = self._name
        place = self.output.save(lambda out: write_whole(robot_file(out, name), packed))
        return None if place is None else robot_file(place, name)

    def _packed(self) -> bytes:
        """Return the current memory and counts as bytes."""
        agent = self.lockstep.agent
        number = agent.number + 1
        counts = self.lockstep.counts
        return pack_tables({number: agent.memory()}, counts=counts)

    def finish(self, *, interrupted: bool) -> None:
        """Publish the last coordination map and the tables, save, and wait for readers."""
        if not self._begun:
            return
        if self.lockstep.handled:
            self._save_checkpoint()
        path = self._save()
        if path is not None:
            self._node.get_logger().info(f"saved its tables in {path.parent}")
        self.report()
        self._publish_tables(wire.Occasion.FINAL)
        wait_for_readers(
            (self._action, self._percept, self._map_publisher, self._tables)
        )

    # Reports.

    def report(self) -> None:
        """Publish the progress of learning, and the cells in which the robot would ask."""
        step = self.lockstep.newest[0]
        if self.joined and step == NO_STEP:
            self._node.remind(self._node.reminder, "the world to begin")
        elif self.joined:
            self._node.reminder.over()
        values = {
            **{f"asks_{how}": count for how, count in self.lockstep.asks.items()},
            "epsilon": f"{self.lockstep.agent.epsilon(step):.4f}",
            "transitions_dropped": self.lockstep.dropped,
            "messages_dropped": self._node.subscriber.total,
        }
        doing = wire.RunState.GREEDY
        if self.lockstep.agent.learning:
            doing = wire.RunState.LEARNING
        self._report(doing, values)
        if self.joined:
            self.episode(self.lockstep.handled)

    def _publish_tables(self, occasion: str) -> None:
        """Publish the tables; `occasion`: the reason, a `wire.Occasion`."""
        attempt = self._attempts.attempt
        self._tables.publish(
            tables_message(self._packed(), self.lockstep.handled, occasion, attempt)
        )


class RobotNode(Follower):
    """Gets a name, becomes a member of the announced team, and leaves it at the end.

    Args:
        name: the robot's name unless the command line remaps it.
        place: where the node is made, and with what: see `NodePlace`.

    Attributes:
        member: its part in the run, with Q*_k and Q^C_k; None: the run is not known yet.

    Raises:
        SparseCoordError: a bad parameter, a name that is taken or that the scenario does not have,
            no world simulator.
    """

    member: Member | None = None

    def __init__(self, *, name: str = "robot", **place: Unpack[NodePlace]) -> None:
        super().__init__(name, PARAMETERS["robot"], **place)
        self._named = False

    def may_begin(self, now: float) -> bool:
        """Return whether the robot has its name, and the world has said how it stands."""
        return self._has_name(now) and self.knows_the_world

    def _has_name(self, now: float) -> bool:
        """Return whether no other node of the graph has the robot's name.

        Raises:
            NameTakenError: another node has it, and is no ghost.
        """
        if self._named or not self.looked_around(now):
            return self._named
        names = self.get_fully_qualified_node_names()
        name = self.get_fully_qualified_name()
        self._named = names.count(name) < 2
        if not self._named and now - self.born >= GHOST_SECONDS:
            raise NameTakenError(
                f"node {name}: another node has this name; stop that one, or start this one under "
                "another name or namespace"
            )
        return self._named

    def check(self, run: RunConfig) -> None:
        """Raise `NotAllowedError` where the run names code that may not be imported."""
        run.check_code()

    def begin(self, run: RunConfig) -> None:
        """Become a member of the team."""
        self.part = self.member = Member(self, run)

    def finish(self, *, interrupted: bool) -> None:
        """Send the last messages, and save the tables."""
        if self.member is not None:
            self.member.finish(interrupted=interrupted)


def main() -> int:
    """Run the node `robot`."""
    return run_node(lambda context: RobotNode(context=context))
