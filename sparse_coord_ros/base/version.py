# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The version of this software, which is in all its files."""

__version__ = "2.0.0"
