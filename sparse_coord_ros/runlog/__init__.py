# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a run without ROS: arrays, verification, the dialogue explained."""

from sparse_coord_ros.runlog.attached import RecordedTables
from sparse_coord_ros.runlog.difference import Difference
from sparse_coord_ros.runlog.log import RunLog, read_run
from sparse_coord_ros.runlog.verify import Verification, verify

__all__ = ["Difference", "RecordedTables", "RunLog", "Verification", "read_run", "verify"]
