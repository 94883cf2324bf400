# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the middleware is told before ROS starts."""

import os

from sparse_coord_ros.core.share import share_folder

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"


def repair_promptly() -> None:
    """Let Fast DDS offer a lost message again after 50 ms; its own period is 3 s.

    On a busy machine its shared memory drops messages. In a run of a few seconds they would come
    after the end, or after they were overwritten. Profiles that the user has chosen stay, and
    other middlewares take no notice.
    """
    os.environ.setdefault(PROFILES, str(share_folder("config") / "fastdds.xml"))
