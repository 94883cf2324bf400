# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot node: one agent of Algorithm 1, which knows of its peers only what they answer."""

from typing import Unpack

from rclpy.client import Client

from sparse_coord_ros.errors import TablesError, in_short
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.nodes.follower import Follower
from sparse_coord_ros.nodes.guard import Guard
from sparse_coord_ros.nodes.member import Member
from sparse_coord_ros.nodes.parameters import PARAMETERS, Place
from sparse_coord_ros.nodes.spin import run_node


class RobotNode(Follower):
    """Gets a name, becomes a member of the team that is announced, and leaves it at the end.

    Args:
        name: the robot's name unless the command line remaps it.
        clients: those of the robots of the same process; None: it is alone.
        place: where the node is made, and with what: see `Place`.

    Attributes:
        guard: guards its name.
        member: its part in the run, with Q*_k and Q^C_k; None: the run is not known yet.

    Raises:
        SparseCoordError: a bad parameter, a name that is taken or that the scenario does not have,
            no world simulator.
    """

    member: Member | None = None

    def __init__(
        self,
        *,
        name: str = "robot",
        clients: dict[str, Client] | None = None,
        **place: Unpack[Place],
    ) -> None:
        super().__init__(name, PARAMETERS["robot"], **place)
        self._peer_clients = {} if clients is None else clients
        self.guard = Guard(self)

    def may_begin(self, now: float) -> bool:
        """Whether nobody who had the name before has been heard in time."""
        return self.guard.holds(now)

    def check(self, run: RunConfig) -> None:
        """Refuse code that may not be imported here, and paths that this node was not given.

        Raises:
            NotAllowedError: the run names such code.
            TablesError: it begins with tables, and this node has no parameter `tables`.
        """
        run.check_code()
        if run.tables and not self.values["tables"]:
            raise TablesError(
                f"the run begins with the tables of {in_short(run.tables)}, which this robot does "
                "not read as its parameter 'tables' is empty; give it that directory"
            )

    def begin(self, run: RunConfig) -> None:
        """Become a member of the team."""
        self.part = self.member = Member(self, self.guard, run, self._peer_clients)

    def finish(self, *, interrupted: bool) -> None:
        """Say the last words, and save what was learned."""
        if self.member is not None:
            self.member.finish(interrupted=interrupted)


def main(args: list[str] | None = None) -> int:
    """Run the node `robot`."""
    return run_node(lambda context: RobotNode(context=context), args)
