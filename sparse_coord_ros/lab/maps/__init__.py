# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""DrivenTeam plans: maps of map_server made into grids that a team can learn on, and back."""
