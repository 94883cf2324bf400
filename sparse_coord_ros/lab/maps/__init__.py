# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Floor plans: maps of map_server made into grids that a team can learn on."""
