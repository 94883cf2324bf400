# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Timeouts of tests."""

PATIENCE_SECONDS = 300.0
"""Far more than anything takes on a busy machine; it is waited for so long where a test fails."""
