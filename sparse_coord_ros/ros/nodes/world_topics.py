# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world's topics: its publishers, its subscriptions, and their counterparts in the graph."""

import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from rclpy.publisher import Publisher
from std_msgs.msg import String

from sparse_coord_ros.core.game.world import Reward, World
from sparse_coord_ros.core.runs.run_config import OWN_CLOCK, RunConfig
from sparse_coord_ros.protocol.lockstep.timeouts import Silence
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.wire import RECORDER
from sparse_coord_ros.protocol.wire.status import Order, RunStatus
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.parameters import ParameterNode
from sparse_coord_ros.ros.nodes.ros_messages import messages_of, status
from sparse_coord_ros.ros.nodes.scene import ScenePublisher


class WorldTopics:
    """The world's publishers, and its subscriptions to actions; the port of its lock step.

    Args:
        node: the world's node.
        run: the run.
        game: the game.
        save: the port's `checkpoint`.

    Attributes:
        messages: the run's messages.
        silence: the robots' silence since the time step began.
        report: publishes diagnostics.
        newest: the newest action of each robot, whose question is shown.
        states, rewards: the publishers for each robot.
        actions: the subscription to each robot's actions.
    """

    def __init__(
        self,
        node: ParameterNode,
        run: RunConfig,
        game: World,
        save: Callable[[int], None],
    ) -> None:
        self._node = node
        self._run = run
        self._game = game
        self.silence = Silence(time.monotonic())
        self.checkpoint = save
        self.messages = messages_of(run)
        self._names = self.messages.names
        self._clock_step = -1
        self._run_publisher = node.announce(ros_topics.RUN)
        self._status_publisher = node.announce(ros_topics.STATUS)
        self._clock: Publisher | None = None
        if run.clock == OWN_CLOCK:
            self._clock = node.announce(ros_topics.CLOCK)
        self._map_publisher = node.announce(ros_topics.MAP)
        # Bodies have transforms of their own.
        self._scene = ScenePublisher(
            node, run.scenario, self.messages, frames=not run.bodies
        )
        self.newest = self._scene.actions
        self.report = node.reporter("run")
        self.states = [
            node.announce(ros_topics.LOCAL_STATE, name) for name in self._names
        ]
        self.rewards = [node.announce(ros_topics.REWARD, name) for name in self._names]
        self.actions: list[Any] = []

    def hear_actions(self, then: Callable[..., None]) -> None:
        """Call `then` with a robot's number and the content of its actions."""
        listen = self._node.subscriber.listen_packed
        unpack = self.messages.unpack_action
        self.actions = [
            listen(ros_topics.ACTION, unpack, partial(then, k), name)
            for k, name in enumerate(self._names)
        ]

    # The port of the lock step.

    def state(self, robot: int, step: int, cell: int) -> None:
        """Publish a robot's local state, and the clock when a step begins."""
        if step != self._clock_step:
            self._clock_step = step
            self.silence.begin(time.monotonic())
            if self._clock is not None:
                self._clock.publish(self.messages.pack_clock(step))
        self.states[robot].publish(self.messages.pack_state(step, cell))

    def reward(self, robot: int, step: int, reward: Reward) -> None:
        """Publish the reward of a robot's action at a time step."""
        self.rewards[robot].publish(self.messages.pack_reward(step, reward))

    # Subscribers of the world, and publishers to it.

    def missing(self) -> list[str]:
        """Return the robots, and the recorder if it is expected, that have not subscribed yet.

        A robot that lacks only one endpoint is returned with that endpoint.
        """
        heard_by = self._node.heard_by
        missing = []
        for k, (name, action) in enumerate(zip(self._names, self.actions, strict=True)):
            heard = [self.rewards[k], self.states[k]]
            ends = [
                publisher.topic_name
                for publisher in heard
                if not heard_by(publisher, name)
            ]
            lacks = [f"a subscription to {topic}" for topic in ends]
            if action.get_publisher_count() == 0:
                lacks.append(f"a publisher of {action.topic_name}")
            if lacks:  # more than one: it has not started, or not begun the run
                missing.append(
                    f"{name} (it lacks {lacks[0]})" if len(lacks) == 1 else name
                )
        recorded = [*self.states, *self.rewards]
        if self._run.recorded and not all(
            heard_by(publisher, RECORDER) for publisher in recorded
        ):
            missing.append(RECORDER)
        return missing

    def gone(self, robots: Iterable[int]) -> bool:
        """Return whether no node publishes the actions of any of these robots."""
        return not any(self.actions[k].get_publisher_count() for k in robots)

    # Other messages.

    def start_anew(self) -> None:
        """Publish the clock with the next state, even if the clock already has this time.

        Actions of the time that is taken back are not shown any more.
        """
        self._clock_step = -1
        self.newest.clear()

    def open(self, *, resumed: bool) -> None:
        """Publish the run, its map and markers; of a new run also the robots' first places."""
        self.show_floor()
        if not resumed:
            self.show()
        self._run_publisher.publish(String(data=self._run.to_yaml()))

    def say(self, state: str, side: WorldSide, order: Order, oldest: int) -> None:
        """Publish the status: the world's state, its progress, and the order to begin."""
        game = self._game
        run_status = RunStatus(
            run=self._run.id,
            state=state,
            step=game.step,
            transitions=game.transitions,
            left_out=side.left_out,
            began=side.began,
            order=order,
            oldest=oldest,
            save_at=side.save_at,
        )
        message = status(self._run.scenario.name, state, run_status.values())
        self._status_publisher.publish(message)

    def show_floor(self) -> None:
        """Publish map and markers: when the world opens, and when a recorder has begun."""
        step = self._game.step
        self._map_publisher.publish(self.messages.pack_map(step))
        self._scene.show_floor(self._ros_time())

    def show(self, *, always: bool = False) -> None:
        """Publish the robots' places for people; limited in rate unless `always`."""
        game = self._game
        self._scene.publish(game.step, game.cells, self._ros_time(), always=always)

    def _ros_time(self) -> tuple[int, int]:
        """Return the ROS time of the viewers, as (sec, nanosec).

        If the world owns the clock of its namespace, this is the run's time. Else the viewers use
        another clock, the system's or a simulator's, and the run's times would be long past by it.
        """
        if self._run.clock == OWN_CLOCK:
            return self.messages.stamp(self._game.step)
        sec, nanosec = self._node.get_clock().now().seconds_nanoseconds()
        return sec, nanosec
