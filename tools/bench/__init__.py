# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make bench`: how long compiling takes, and how fast teams learn, beside plain C."""
