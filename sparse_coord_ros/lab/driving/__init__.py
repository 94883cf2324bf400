# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies that make the moves, their drivers and their simulator, without ROS.

Begin with `driver`: the interface of both drivers, "go to this cell; tell when you are there".
"""
