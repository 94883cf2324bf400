# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 and other learners: tables, agents, runs, histories, evaluation."""
