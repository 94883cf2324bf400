# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make bench`: how fast teams learn and environments step, beside bare nodes and plain Python."""
