# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Halting a team from outside: its world and its drivers are asked until all have done so.

The world alone would do: it tells its drivers, also drivers that start later. The drivers are
asked as well, because the world itself may have failed.
"""

from dataclasses import dataclass

from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool

from sparse_coord_ros.protocol.wire import RUN, services

DISCOVERY_SECONDS = 0.25
"""Between two looks at who offers the service."""

REPEAT_HALT_SECONDS = 0.4
"""Until a node that has not done it is asked again."""

FIND_SECONDS = 2.0
"""How long nodes are looked for in any case: discovery takes its time."""

ASK_SECONDS = 20.0
"""How long nodes are asked at most; another user may want the opposite later. A node that was
killed is in the graph for so long."""


@dataclass
class Asked:
    """A node that is asked.

    Attributes:
        client: of its service `halt`.
        answer: of the newest request; None: none is under way.
        since: when that request was made.
        said: the node's last answer; empty: no answer yet.
        done: whether it has complied.
    """

    client: Client
    answer: Future | None = None
    since: float = 0.0
    said: str = ""
    done: bool = False

    def ask(self, hold: bool, now: float) -> None:
        """Make a request in place of the one that is under way."""
        self.forget()
        self.since = now
        self.answer = self.client.call_async(SetBool.Request(data=hold))

    def forget(self) -> None:
        """Do not wait for the answer that is under way."""
        if self.answer is not None:
            self.client.remove_pending_request(self.answer)
            self.answer = None

    def take_answer(self) -> None:
        """Take in the answer, where it has come."""
        if self.answer is None or not self.answer.done():
            return
        response = self.answer.result()
        self.answer = None
        self.done = response.success
        self.said = response.message


class Halting:
    """Asks the world and the drivers of a namespace to halt, or to go on.

    Args:
        node: calls the services.
        namespace: of the team; nodes in namespaces below it belong to other teams.

    Attributes:
        hold: whether they are asked to halt, else to go on.
        asking: whether the world or a driver is still to be asked. A world that has done it tells
            the drivers that start later.
        asked: the nodes that offer the service, by name.
    """

    def __init__(self, node: Node, namespace: str) -> None:
        self._node = node
        space = namespace.strip("/")
        self._prefix = f"/{space}/" if space else "/"
        self._looked = self._since = 0.0
        self.hold = self.asking = False
        self.asked: dict[str, Asked] = {}

    def ask(self, hold: bool, now: float) -> None:
        """Ask all to halt, or to go on, also those that are found later.

        Args:
            hold: which of them.
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
        """The nodes that were asked, and have not done it."""
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
        """True if the team's world has done it: then drivers that start later do it, too."""
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
            self.asked[name] = Asked(client, done=not self.asking)
        for name in self.asked.keys() - found:
            self._node.destroy_client(self.asked.pop(name).client)
