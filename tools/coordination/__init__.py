# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The studies behind docs/coordination.md: what the factored learner is worth, and why."""
