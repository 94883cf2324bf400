# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot node: one agent of Algorithm 1, which acts on what its peers answer."""

from functools import partial
from pathlib import Path
from typing import Any, Unpack

from sparse_coord_ros.base.errors import (
    NameTakenError,
    RunError,
    TablesError,
    os_error_text,
)
from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.runs.saved_tables import TEAM_FILE, pack_tables, robot_file
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.lockstep.attempts import RobotAttempts
from sparse_coord_ros.protocol.lockstep.robot_side import NO_STEP, RobotSide
from sparse_coord_ros.protocol.wire import RECORDER, WORLD, SelfReport, services
from sparse_coord_ros.protocol.wire.status import NO_ATTEMPT, RunStatus
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.follower import Follower
from sparse_coord_ros.ros.nodes.outputs import Output, begin_with
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, NodePlace
from sparse_coord_ros.ros.nodes.peers import Peers
from sparse_coord_ros.ros.nodes.ros_messages import (
    messages_of,
    robot_number,
    status,
    tables_message,
)
from sparse_coord_ros.ros.nodes.spin import run_node, wait_for_readers

NAME = "robot"
"""The name of a node that nobody named."""

HOW_TO_NAME = (
    "name the node with --ros-args -r __node:={}, a robot of the world's scenario"
)

LAST_REWARD_SECONDS = 2.0
"""How long a robot waits for its last reward after the run's end."""

GHOST_SECONDS = 6.0
"""How long another node of the robot's name may stay: a killed one is in the graph for 5 s
(`config/fastdds.xml`)."""

PEER_PATIENCE_SECONDS = 2.0
"""How long a robot that is ready waits for its peers' services before it logs their names."""


class RobotNode(Follower):
    """One agent of the announced team, and its topics; the port of its side of the lock step.

    It gets its name, begins with a run, joins the lock step as the world orders it, and leaves it
    at the end.

    Args:
        name: the robot's name unless the command line remaps it.
        place: where the node is made, and with what: see `NodePlace`.

    Attributes:
        lockstep: the robot's side of the lock step, with its agent; from `begin` on.
        output: saves its files; from `begin` on.
        peers: asks its peers, and answers them; from `begin` on.
        joined: whether the robot listens to the world.

    Raises:
        SparseCoordError: a bad parameter, a name that is taken or that the scenario does not have,
            no world simulator, tables to begin with that do not fit.
    """

    lockstep: RobotSide
    output: Output
    peers: Peers
    joined = False

    def __init__(self, *, name: str = NAME, **place: Unpack[NodePlace]) -> None:
        super().__init__(name, PARAMETERS["robot"], **place)
        if self.get_name() == NAME:
            self.destroy_node()
            raise RunError(f"this robot has no name; {HOW_TO_NAME.format('robot_1')}")
        self._named = False
        self._ears: list[Any] = []
        self._ready_since = 0.0

    # Beginning with a run.

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
        """Become a robot of the team: publish, answer peers, and report to the world."""
        name = self._name = self.get_name()
        names = run.scenario.names
        self._number = robot_number(run, name, HOW_TO_NAME.format(names[0]))
        self._messages = messages_of(run)
        files = [robot_file(Path(), name).name, TEAM_FILE]
        self.output = Output(self, name, run, files)
        self._action = self.announce(ros_topics.ACTION, name)
        self._percept = self.announce(ros_topics.PERCEPT, name)
        self._map_publisher = self.announce(ros_topics.COORDINATION_MAP, name)
        self._tables = self.announce(ros_topics.TABLES, name)
        self._progress = self.announce(ros_topics.PROGRESS, name)
        self._diagnose = self.reporter("agent")
        fresh = partial(self._fresh_agent, run)
        self.lockstep = RobotSide(run, fresh(), self)
        self._attempts = RobotAttempts(
            self.lockstep, self.output.store, fresh, self.order_before.attempt
        )
        self._shown_map = b""
        self.peers = Peers(self, run, self._messages, self.lockstep)
        self.offer(services.SAVE, self._on_save)
        self._say_progress()

    def _fresh_agent(self, run: RunConfig) -> Agent:
        """Return an agent in its initial state."""
        if run.greedy and not run.tables:
            raise TablesError(
                "the run is greedy but parameter 'tables' names no learned tables; give the "
                "output directory of a run"
            )
        number = self._number
        memory = begin_with(Path(run.tables), run, number) if run.tables else None
        return Agent(
            *(run.rule, run.scenario, number, run.seed),
            memory=memory,
            learning=not run.greedy,
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
        return self.presence is not None and self._attempts.attempt != NO_ATTEMPT

    def world_said(self, status: RunStatus) -> None:
        """Read the world's status: its order to begin, and the next checkpoint by time."""
        self.lockstep.save_at = status.save_at
        if self._attempts.obey(status.order):
            self._begin_attempt(status.order.checkpoint)
        self.output.store.forget_before(status.oldest)

    def _begin_attempt(self, step: int) -> None:
        """Begin at a checkpoint; the world waits until all listen again."""
        for ear in self._ears:  # what they would still hear is of the attempt before
            self.subscriber.leave(ear)
        self._ears.clear()
        for heard in self.shared_states.values():
            heard.pop(self._name, None)
        self.peers.start_anew()
        self.joined = False
        self._shown_map = b""
        self._publish_tables(wire.Occasion.BEGIN)
        if step:
            step = self.lockstep.transitions
            self.get_logger().info(
                f"{self._name} continues from its checkpoint of step {step}"
            )

    def _join_when_ready(self, now: float) -> None:
        """Subscribe to the world once all required subscribers of this robot are there.

        The world waits for these subscriptions: they tell it that the robot is ready.
        """
        missing = self._not_heard_by()
        if missing:
            self.remind(self.reminder, missing)
            return
        if not self._ready_since:
            self._ready_since = now
            run = self.lockstep.run
            self.get_logger().info(f"joined run {run.scenario.name}, seed {run.seed}")
        if now - self._ready_since < PEER_PATIENCE_SECONDS and not self.peers.ready():
            return
        self._listen()
        self._say_progress()

    def _not_heard_by(self) -> str:
        """Return the required subscribers of this robot that are missing, or an empty text."""
        if not self.heard_by(self._action, WORLD):
            return "the world simulator to listen to this robot"
        if self.lockstep.run.recorded:
            for publisher in (self._action, self._percept):
                if not self.heard_by(publisher, RECORDER):
                    return "a recorder to listen to this robot"
        return ""

    def _listen(self) -> None:
        """Subscribe to the world: only messages that it publishes from now on arrive."""
        messages = self._messages
        side = self.lockstep
        listen = self.subscriber.listen_packed
        reward = listen(
            ros_topics.REWARD, messages.unpack_reward, side.reward, self._name
        )
        on_state = self._share_state if side.run.sees_all else side.state
        state = listen(
            ros_topics.LOCAL_STATE, messages.unpack_state, on_state, self._name
        )
        self._ears = [reward, state]
        if side.run.sees_all:
            self._listen_to_peers()
        self.joined = True

    def _listen_to_peers(self) -> None:
        """Hear the peers' states: from robots of this process directly, else by subscriptions."""
        side = self.lockstep
        for peer in side.agent.peers:
            then = partial(side.peer_state, peer)
            name = self._messages.names[peer]
            if name in self.shared_states:
                self.shared_states[name][self._name] = then
            else:
                unpack = self._messages.unpack_state
                topic = ros_topics.LOCAL_STATE
                ear = self.subscriber.listen_packed(topic, unpack, then, name)
                self._ears.append(ear)

    def _share_state(self, step: int, cell: int) -> None:
        """Process the own state, and hand it to the robots of this process that see it."""
        self.lockstep.state(step, cell)
        for then in tuple(self.shared_states.get(self._name, {}).values()):
            then(step, cell)

    # Outgoing: the port of the lock step.

    def act(self, step: int, action: Action, report: SelfReport) -> None:
        """Publish the action that answers the local state of a time step."""
        self._action.publish(self._messages.pack_action(step, action, report))

    def percept(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> None:
        """Publish the result of COORDINATE."""
        cells = (cell, *(perceived or ()))
        self._percept.publish(self._messages.pack_percept(step, cells))

    def ask(self, peer: int, step: int, cell: int) -> None:
        """Request the peer's local state; give up at once on a peer that fell silent."""
        if not self.peers.ask(peer, step, cell):
            self.lockstep.expire()

    def episode(self, step: int) -> None:
        """Publish where the robot asks, if that has changed since the episode before."""
        asking = self._messages.asking_cells(self.lockstep.agent.q_star)
        if asking != self._shown_map:
            self._shown_map = asking
            data = self._messages.pack_coordination_map(step, asking)
            self._map_publisher.publish(data)

    def checkpoint(self, step: int) -> None:
        """Publish the current tables, and save a checkpoint."""
        self._publish_tables(wire.Occasion.CHECKPOINT)
        self._save_checkpoint()

    # The course of the run.

    def go_on(self, now: float) -> None:
        """Join the run when the world orders it; then keep its deadlines until it is over."""
        assert self.presence is not None
        if not self.joined:
            if self._begun:
                self._join_when_ready(now)
        elif self.presence.end is None:
            self.peers.keep_the_deadline(now)

    def all_done(self, now: float) -> bool:
        """Return whether all transitions are learned, or missing messages are overdue."""
        assert self.presence is not None
        side = self.lockstep
        end = self.presence.end
        heard_all = self.joined and end is not None and side.newest[0] >= end
        learned_all = heard_all and side.waiting is None
        overdue = now - self.presence.ended > LAST_REWARD_SECONDS
        return learned_all or overdue

    # Saving.

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

    def _save_checkpoint(self) -> None:
        self.output.checkpoint(self.lockstep.snapshot())
        self._say_progress()

    def _save(self) -> Path | None:
        """Write the tables and return their path; None: the parameter `out` is not set."""
        packed = self._packed()
        name = self._name
        folder = self.output.save(
            lambda out: write_whole(robot_file(out, name), packed)
        )
        return None if folder is None else robot_file(folder, name)

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
            self.get_logger().info(f"saved its tables in {path.parent}")
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
            self.remind(self.reminder, "the world to begin")
        elif self.joined:
            self.reminder.over()
        values = {
            **{f"asks_{how}": count for how, count in self.lockstep.asks.items()},
            "epsilon": f"{self.lockstep.agent.epsilon(step):.4f}",
            "transitions_dropped": self.lockstep.dropped,
            "messages_dropped": self.subscriber.total,
        }
        doing = wire.RunState.GREEDY
        if self.lockstep.agent.learning:
            doing = wire.RunState.LEARNING
        self._diagnose(doing, values)
        if self.joined:
            self.episode(self.lockstep.handled)

    def _publish_tables(self, occasion: str) -> None:
        """Publish the tables; `occasion`: the reason, a `wire.Occasion`."""
        attempt = self._attempts.attempt
        self._tables.publish(
            tables_message(self._packed(), self.lockstep.handled, occasion, attempt)
        )


def main() -> int:
    """Run the node `robot`."""
    return run_node(lambda context: RobotNode(context=context))
