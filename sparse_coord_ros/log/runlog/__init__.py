# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a run without ROS.

- As arrays: `log` (all of it) and `window` (any stretch of a long one), from the messages topic by
  topic (`tracks`, by `columns` and `decode`), the service events (`dialogue`), the attached tables
  (`attached`), over all files of a bag (`timeline`), of one run (`bag_run`).
- Verified: `verify`, of the world (`game_check`), each robot (`agents`), `percepts`. What differs
  is a `difference`.
- Explained: `explain`, each COORDINATE.

`replay` says which stretches between gaps can be computed again and what one robot did in one, and
lets its agent do it again.
"""

from sparse_coord_ros.log.runlog.attached import RecordedTables
from sparse_coord_ros.log.runlog.difference import Difference
from sparse_coord_ros.log.runlog.log import RunLog, read_run
from sparse_coord_ros.log.runlog.verify import Verification, verify

__all__ = [
    "Difference",
    "RecordedTables",
    "RunLog",
    "Verification",
    "read_run",
    "verify",
]
