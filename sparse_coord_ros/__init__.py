# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots that learn when and how to coordinate (Melo & Veloso, AAMAS 2009) on ROS 2."""

__version__ = "0.2.0"

__all__ = ["__version__"]
