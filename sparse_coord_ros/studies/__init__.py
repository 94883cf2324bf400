# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Experiments: the paper's tables and figures, and the benchmark.

Conditions are data, results are files, and `report` makes tables and figures of them. This part
imports `show`, `core` and `base`.
"""
