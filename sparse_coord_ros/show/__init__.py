# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Display of runs: policies, episodes and curves as data, and as pictures, films and pages.

`page` has the page in the browser. `steps`, `episodes`, `policy` and `sources` need no Matplotlib.
This part imports `studies`, `log`, `lab` and the parts below them; it needs no ROS.
"""
