# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The service `active_perception` from both sides: a robot asks its peers, and answers them.

ROS 2 delivers the answer of a service to all its clients, and each client wakes up to see whether
it is its own. With a client for each pair of robots the cost of a question would grow with the
team, and the cost of starting and ending with its square. So the robots of one process share
clients.
"""

import time
from collections.abc import Callable
from functools import partial

from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol.lockstep.robot_side import Answer, RobotSide
from sparse_coord_ros.protocol.lockstep.timeouts import Deadline
from sparse_coord_ros.protocol.wire.messages import Messages
from sparse_coord_ros.protocol.wire.services import ACTIVE_PERCEPTION
from sparse_coord_ros.ros.nodes.parameters import ParameterNode
from sparse_coord_ros.ros.nodes.ros_messages import cell_path, set_cell
from sparse_coord_ros.ros.nodes.ros_topics import ACTIVE_PERCEPTION_TYPE

IMMEDIATE_REPEATS = 10
"""Number of immediate repeats to a peer that is a step behind; later repeats come with each
tick."""


REPEAT_ASK_SECONDS = 0.5
"""An unanswered request is sent again after so long."""


class Peer:
    """Client of one peer's `active_perception`.

    Args:
        node: the asking robot; its name goes into the requests.
        client: the client of the peer's service.
        messages: the run's messages.
        answered: called with the request's step and the answer's path.

    Attributes:
        heard: the time of the peer's last answer.
        repeats: number of repeated requests for the same step.
    """

    def __init__(
        self,
        node: Node,
        client: Client,
        messages: Messages,
        answered: Callable[[int, Path], None],
    ) -> None:
        self._client = client
        self._messages = messages
        self._answered = answered
        self._request = GetPlan.Request()
        self._request.goal.header.frame_id = node.get_name()
        self._seen = self._silent = False
        self._step = self.repeats = 0
        self._unsent: int | None = None
        self._open: Future | None = None
        self.heard = self._sent = 0.0

    def ready(self) -> bool:
        """Return whether the peer's service has been there."""
        self._seen = self._seen or self._client.service_is_ready()
        return self._seen

    def request(self, step: int, cell: int) -> bool:
        """Ask for the peer's local state of a time step; `cell` is the asker's own.

        Returns:
            True to wait for the answer; False for a peer that let the last deadline pass and has
            not answered since. The request is still sent, to notice the peer's return.
        """
        set_cell(self._request.start, self._messages, step, cell)
        self.repeats = self.repeats + 1 if step == self._step else 0
        self._step = self._unsent = step
        if self.repeats < IMMEDIATE_REPEATS:
            self.send_what_waits()
        return not self._silent

    def send_what_waits(self) -> None:
        """Send the request once the peer's service is there; the node's timer calls this too.

        An unanswered request is sent again: a peer that has just come back may have missed it. An
        answer that has arrived counts even if this process was too busy to read it yet: rclpy
        reads it in a callback of its own.
        """
        now = time.monotonic()
        missing = self._open is not None and not self._open.done()
        if missing and now - self._sent >= REPEAT_ASK_SECONDS and not self._silent:
            self._unsent = self._step
        if self._unsent is None or not self.ready():
            return
        step = self._unsent
        self._unsent = None
        self._sent = now
        self._forget()
        self._open = self._client.call_async(self._request)
        self._open.add_done_callback(partial(self._on_done, step))

    def start_anew(self) -> None:
        """Drop pending requests: the run goes back to an earlier time step, with all robots."""
        self._silent = False
        self._unsent = None
        self._forget()

    def gave_up(self) -> None:
        """Note that the deadline passed without an answer."""
        self._silent = True
        self._unsent = None

    @property
    def waits(self) -> bool:
        """True if a request is not answered yet, or could not be sent."""
        return self._open is not None or self._unsent is not None

    def _on_done(self, step: int, future: Future) -> None:
        if future.cancelled() or future.result() is None:
            return
        if future is self._open:
            self._open = self._unsent = None
        self._silent = False
        self.heard = time.monotonic()
        self._answered(step, future.result().plan)

    def _forget(self) -> None:
        """Drop an unanswered last request: rclpy would keep it for ever."""
        if self._open is not None:
            self._client.remove_pending_request(self._open)
            self._open.cancel()
            self._open = None


class Peers:
    """Asks a robot's peers for the robot, and answers them.

    Args:
        node: the robot's node.
        run: the run.
        messages: the run's messages.
        side: the robot's side of the lock step.
    """

    def __init__(
        self, node: ParameterNode, run: RunConfig, messages: Messages, side: RobotSide
    ) -> None:
        self._subscriber = node.subscriber
        self._messages = messages
        self._side = side
        self._names = messages.names
        self._service = ACTIVE_PERCEPTION.of(node.get_name())
        self._deadline = Deadline(run.percept_timeout, run.step_timeout)
        node.create_service(ACTIVE_PERCEPTION_TYPE, self._service, self._answer)
        self._peers: dict[int, Peer] = {}
        self._requested: set[int] = set()
        for k, name in enumerate(self._names):
            if name == node.get_name():
                continue
            service = ACTIVE_PERCEPTION.of(name)
            # the first robot of this process creates it
            if service not in node.shared_clients:
                node.shared_clients[service] = node.create_client(
                    ACTIVE_PERCEPTION_TYPE, service
                )
            answered = node.guarded(partial(self._on_answer, k))
            client = node.shared_clients[service]
            self._peers[k] = Peer(node, client, messages, answered)

    def ready(self) -> bool:
        """Return whether every peer's service has been there."""
        return all(peer.ready() for peer in self._peers.values())

    def ask(self, peer: int, step: int, cell: int) -> bool:
        """Ask a peer for its local state; return whether to wait, as `Peer.request` does."""
        self._requested.add(peer)
        return self._peers[peer].request(step, cell)

    def start_anew(self) -> None:
        """Drop pending requests: the run goes back to an earlier time step."""
        self._deadline.over()
        for peer in self._peers.values():
            peer.start_anew()

    def keep_the_deadline(self, now: float) -> None:
        """Give up overdue questions; send requests that could not be sent before."""
        asked = self._peers.get(self._side.asking)
        heard = 0.0
        if asked is not None:
            heard = max(peer.heard for peer in self._peers.values())
        if self._deadline.passed(self._side.waiting, heard, now):
            if asked is not None:
                asked.gave_up()
            self._side.expire()
        for k in tuple(self._requested):
            peer = self._peers[k]
            peer.send_what_waits()
            if not peer.waits:
                self._requested.remove(k)

    def _answer(
        self, request: GetPlan.Request, response: GetPlan.Response
    ) -> GetPlan.Response:
        """Answer a peer (or a person, who gives no stamp and no name)."""
        stamp = request.start.header.stamp
        position = request.start.pose.position
        asker = request.goal.header.frame_id
        try:
            step = self._messages.step(stamp.sec, stamp.nanosec)
            if step and asker not in self._names:
                raise ValueError(f"asker {asker!r} is no robot of the scenario")
        except ValueError as error:
            self._subscriber.drop(self._service, error, "request refused")
            answer = Answer(self._side.newest[0], None)
        else:
            number = self._names.index(asker) if asker in self._names else 0
            answer = self._side.asked(
                number, step, self._messages.cell(position.x, position.y)
            )
        response.plan = cell_path(self._messages, answer.step, (answer.cell,))
        return response

    def _on_answer(self, peer: int, request_step: int, plan: Path) -> None:
        """Read a peer's answer to the request of a time step."""
        cell = None
        try:
            step = self._messages.step(plan.header.stamp.sec, plan.header.stamp.nanosec)
            if plan.poses:
                position = plan.poses[0].pose.position
                cell = self._messages.cell(position.x, position.y)
                if cell is None:
                    raise ValueError(
                        f"position ({position.x:g}, {position.y:g}) is no free cell"
                    )
        except ValueError as error:
            self._subscriber.drop(ACTIVE_PERCEPTION.of(self._names[peer]), error)
        else:
            self._side.answer(peer, request_step, Answer(step, cell))
