# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exact values of teams, and bounds on the best teams of a scenario."""
