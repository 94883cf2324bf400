# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The game, the learners, and what computes with them in one process.

`game` has the rules, `learners` has one file for each algorithm, `runs` lets a team learn and
play, `solve` has exact values and `engine` trains many teams. Everything works without ROS and
without numba. This part imports only `base`.
"""
