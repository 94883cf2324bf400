# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a run without ROS.

- Read: `columns` and `decode` decode a bag's messages; `run_messages` sorts them by topic and time
  step, with the service events (`dialogue`), the attached tables (`attached`), the time line of
  several files (`timeline`) and the run (`bag_run`). `log` has the run as arrays, `window` a part
  of a long one.
- Replayed: `replay` says which intervals between gaps can be computed again, and lets an agent
  follow a robot's actions in one. `relearned` has the tables of any time step.
- Verified: `verify`, by `game_check` (the world), `agents` and `percepts`. The results are in
  the words of `difference`.
- Explained: `explain`, each COORDINATE.
"""

from sparse_coord_ros.log.runlog.attached import RecordedTables
from sparse_coord_ros.log.runlog.difference import Difference, Unknown
from sparse_coord_ros.log.runlog.log import RunLog, read_run
from sparse_coord_ros.log.runlog.verify import Verification, verify

__all__ = [
    "Difference",
    "RecordedTables",
    "RunLog",
    "Unknown",
    "Verification",
    "read_run",
    "verify",
]
