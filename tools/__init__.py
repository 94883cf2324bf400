# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What only maintainers run, in a checkout; it is not installed."""
