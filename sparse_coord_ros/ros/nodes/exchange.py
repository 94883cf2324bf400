# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The service `learned`: after learning, a robot sends its memory to its peers once."""

import base64
from collections.abc import Callable
from functools import lru_cache, partial

from rclpy.task import Future
from std_srvs.srv import Trigger

from sparse_coord_ros.base.errors import TablesError, in_short
from sparse_coord_ros.core.engine.improve import Improvement, improve
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.runs.run_config import RunConfig, run_from_yaml
from sparse_coord_ros.core.runs.tables import unpack_saved
from sparse_coord_ros.protocol.wire.services import LEARNED
from sparse_coord_ros.ros.nodes.follower import TICK_SECONDS
from sparse_coord_ros.ros.nodes.parameters import ParameterNode

AGAIN_TICKS = 25
"""Ticks between two requests to a peer that has not answered, or is not ready yet."""


class Exchange:
    """A robot's part in the exchange.

    A robot stays until all peers have requested its memory, but no longer than `step_timeout`. The
    time is counted in the robot's own ticks: a busy process receives no messages.

    Args:
        node: the robot's node.
        run: the run.
        packed: returns its memory, as `core.runs.tables.pack_tables` does.
    """

    def __init__(
        self, node: ParameterNode, run: RunConfig, packed: Callable[[], bytes]
    ) -> None:
        self._node = node
        self._run = run
        self._packed = packed
        self._clients = node.shared_clients
        self._names = run.scenario.names
        self._number = self._names.index(node.get_name())
        self._learned: dict[int, bytes] = {}
        self._answered = self._ticks = 0
        node.create_service(Trigger, LEARNED.of("~"), self._answer)

    def over(self) -> bool:
        """Ask silent peers again; return whether the exchange is complete or timed out.

        Called with every tick after the robot's last learning step.
        """
        if not self._ticks:
            self._learned[self._number] = self._packed()
        missing = [k for k in range(len(self._names)) if k not in self._learned]
        for k in missing if self._ticks % AGAIN_TICKS == 0 else ():
            service = LEARNED.of(self._names[k])
            if service not in self._clients:
                self._clients[service] = self._node.create_client(Trigger, service)
            if self._clients[service].service_is_ready():
                future = self._clients[service].call_async(Trigger.Request())
                future.add_done_callback(self._node.guarded(partial(self._take, k)))
        self._ticks += 1
        all_know_all = not missing and self._answered >= len(self._names) - 1
        return all_know_all or self._ticks * TICK_SECONDS > self._run.step_timeout

    def plan(self) -> Improvement | None:
        """Return the plan from the knowledge of all robots; None: some have not answered."""
        silent = [name for k, name in enumerate(self._names) if k not in self._learned]
        if silent:
            self._node.get_logger().warning(
                f"{', '.join(silent)} did not share tables within step_timeout: this "
                "robot keeps its own tables"
            )
            return None
        packed = tuple(self._learned[k] for k in range(len(self._names)))
        found = planned(self._run.to_yaml(), packed)
        felt = (
            ", ".join(str(self._run.scenario.map.cells[x]) for x in found.doorways)
            or "nowhere"
        )
        self._node.get_logger().info(
            f"improved on what was learned: {found.before:.2f} -> {found.value:.2f}; r^C was "
            f"paid in {felt}, any other doorway is unknown"
        )
        return found

    def _answer(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        own = self._learned.get(self._number)
        response.success = own is not None
        response.message = (
            base64.b64encode(own).decode() if own else "it is still learning"
        )
        self._answered += response.success
        return response

    def _take(self, k: int, future: Future) -> None:
        """Read a peer's memory, if a robot of this run can have learned it."""
        answer = future.result()
        if answer is None or not answer.success or k in self._learned:
            return
        service = LEARNED.of(self._names[k])
        run = self._run
        try:
            data = base64.b64decode(answer.message, validate=True)
            [saved] = unpack_saved(data, [k + 1], where=service)
            check_memory(run.scenario, run.rule, k, saved.memory)
        except (TablesError, ValueError) as error:
            self._node.subscriber.drop(
                service, in_short(str(error)), "the answer is not used"
            )
        else:
            self._learned[k] = data


@lru_cache(maxsize=1)
def planned(run: str, packed: tuple[bytes, ...]) -> Improvement:
    """Return the plan of a team, computed once for the robots of one process.

    Args:
        run: the text of `run.yaml`.
        packed: each robot's memory.
    """
    config = run_from_yaml(run, where="run")
    memories = []
    for number, data in enumerate(packed, start=1):
        [saved] = unpack_saved(data, [number], where="learned")
        memories.append(saved.memory)
    return improve(config.scenario, config.rule, memories)
