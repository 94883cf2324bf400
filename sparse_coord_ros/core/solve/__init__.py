# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exact values and bounds: what the best teams of a scenario are worth."""
