# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The version of this software, and the number of the format of all files that it writes."""

__version__ = "3.0.0"

FORMAT = 7
"""Number of the format of run directories, checkpoints, bags, results and searches. It changes if
what one of these files contains changes: a file with another number is refused."""
