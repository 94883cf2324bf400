# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The services of a team, without ROS. Each lies below its node's name; `~` is the node's own."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Service:
    """One service.

    Attributes:
        name: relative to the node's name.
        type_name: such as `std_srvs/srv/Trigger`.
    """

    name: str
    type_name: str

    def of(self, owner: str) -> str:
        """Return the service's name below a node's name; `~` is the node's own."""
        return f"{owner}/{self.name}"


ACTIVE_PERCEPTION = Service("active_perception", "nav_msgs/srv/GetPlan")
"""Of a robot: return its cell."""

SAVE = Service("save", "std_srvs/srv/Trigger")
"""Of a robot: write the tables."""

PAUSE = Service("pause", "std_srvs/srv/SetBool")
STEP = Service("step", "std_srvs/srv/Trigger")
"""Of the world and the player: pause or resume; make one time step."""

RESET = Service("reset", "std_srvs/srv/Trigger")
"""Of the world: begin a new episode."""
