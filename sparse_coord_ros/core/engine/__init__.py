# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learning runs, one or many at once, compiled where numba is installed."""
