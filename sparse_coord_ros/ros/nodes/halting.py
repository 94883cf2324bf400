# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Halting a team from outside: requests go to its world and its drivers until all have halted.

The world alone would suffice: it tells its drivers, also drivers that start later. The drivers get
requests as well, because the world itself may have failed.
"""

from dataclasses import dataclass

from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool

from sparse_coord_ros.protocol.wire import RUN, services

DISCOVERY_SECONDS = 0.25
"""Between two searches for nodes that offer the service."""

REPEAT_HALT_SECONDS = 0.4
"""After so long a node that has not halted gets the request again."""

FIND_SECONDS = 2.0
"""How long nodes are searched in any case: discovery takes time."""

ASK_SECONDS = 20.0
"""How long requests are repeated at most; another user may want the opposite later. A node that
was killed stays in the graph for so long."""


@dataclass
class HaltRequest:
    """A node that gets requests to halt.

    Attributes:
        client: the client of its service `halt`.
        answer: the answer to the newest request; None: no request is pending.
        since: the time of that request.
        said: the node's last answer; empty: no answer yet.
        done: whether it has complied.
    """

    client: Client
    answer: Future | None = None
    since: float = 0.0
    said: str = ""
    done: bool = False

    def ask(self, hold: bool, now: float) -> None:
        """Send a request in place of the pending one."""
        self.forget()
        self.since = now
        self.answer = self.client.call_async(SetBool.Request(data=hold))

    def forget(self) -> None:
        """Drop the pending request."""
        if self.answer is not None:
            self.client.remove_pending_request(self.answer)
            self.answer = None

    def take_answer(self) -> None:
        """Read the answer, if it has come."""
        if self.answer is None or not self.answer.done():
            return
        response = self.answer.result()
        self.answer = None
        self.done = response.success
        self.said = response.message


class Halting:
    """Asks the world and the drivers of a namespace to halt, or to continue.

    Args:
        node: calls the services.
        namespace: of the team; nodes in namespaces below it belong to other teams.

    Attributes:
        hold: whether they are asked to halt, else to continue.
        asking: whether the world or a driver has not done it yet. A world that has done it tells
            the drivers that start later.
        asked: the nodes that offer the service, by name.
    """

    def __init__(self, node: Node, namespace: str) -> None:
        self._node = node
        space = namespace.strip("/")
        self._prefix = f"/{space}/" if space else "/"
        self._looked = self._since = 0.0
        self.hold = self.asking = False
        self.asked: dict[str, HaltRequest] = {}

    def ask(self, hold: bool, now: float) -> None:
        """Ask all nodes to halt, or to continue, also nodes that are found later.

        Args:
            hold: True: halt.
            now: the time, by `time.monotonic`.
        """
        self.hold = hold
        self.asking = True
        self._since = now
        for one in self.asked.values():
            one.forget()
            one.said = ""
            one.done = False

    def tick(self, now: float) -> None:
        """Do the work that is due; to be called several times a second."""
        if now - self._looked >= DISCOVERY_SECONDS:
            self._looked = now
            self._look()
        if not self.asking:
            return
        for one in self.asked.values():
            one.take_answer()
            due = not one.done and now - one.since >= REPEAT_HALT_SECONDS
            if due and one.client.service_is_ready():
                one.ask(self.hold, now)
        asked_for = now - self._since
        all_done = asked_for > FIND_SECONDS and self.world_told and not self.left
        if all_done or asked_for > ASK_SECONDS:
            self.asking = False

    @property
    def left(self) -> list[str]:
        """The nodes that have not done it yet."""
        return sorted(name for name, one in self.asked.items() if not one.done)

    def in_words(self, name: str) -> str:
        """Return a node's answer in words."""
        silent = (
            "does not answer; its body may be moving"
            if self.hold
            else "does not answer"
        )
        return f"{name}: {self.asked[name].said or silent}"

    @property
    def world_told(self) -> bool:
        """True if the team's world has done it: drivers that start later then do it, too."""
        worlds = self._node.get_publishers_info_by_topic(f"{self._prefix}{RUN.name}")
        names = {info.node_name for info in worlds}
        return any(one.done for name, one in self.asked.items() if name in names)

    def _look(self) -> None:
        """Find the nodes of the namespace itself that offer the service; forget those gone."""
        ending = f"/{services.HALT.name}"
        found = set()
        for service, types in self._node.get_service_names_and_types():
            if not (service.startswith(self._prefix) and service.endswith(ending)):
                continue
            name = service.removeprefix(self._prefix).removesuffix(ending)
            if services.HALT.type_name in types and "/" not in name:
                found.add(name)
        for name in found - self.asked.keys():
            client = self._node.create_client(SetBool, f"{self._prefix}{name}{ending}")
            self.asked[name] = HaltRequest(client, done=not self.asking)
        for name in self.asked.keys() - found:
            self._node.destroy_client(self.asked.pop(name).client)
