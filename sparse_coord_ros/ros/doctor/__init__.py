# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `sparse_coord doctor` looks at: installation, places to write, network, and ROS 2."""
