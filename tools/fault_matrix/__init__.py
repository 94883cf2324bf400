# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What becomes of a live team when one of its processes gets a signal, tried for real."""
