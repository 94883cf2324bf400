# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a run without ROS.

- Read: `reading` makes a bag a `RunLog` (`log`) in three steps: read, sort, arrange. It uses
  `decode` for single messages. `growing` reads on in a bag that grows.
- Replayed: `replay` lets an agent follow a robot's actions. `relearned` has the tables of any time
  step.
- Verified: `verify`, a loop over the time steps, by `world_check`, `agent_check` and
  `percept_check`. The results are in the words of `difference`.
- Explained: `explain`, each COORDINATE.
"""

from sparse_coord_ros.log.runlog.difference import Difference, Undecided
from sparse_coord_ros.log.runlog.log import RecordedTables, RunLog
from sparse_coord_ros.log.runlog.reading import read_run
from sparse_coord_ros.log.runlog.verify import Verification, verify

__all__ = [
    "Difference",
    "RecordedTables",
    "RunLog",
    "Undecided",
    "Verification",
    "read_run",
    "verify",
]
