# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Your own perception model: python own_perception.py [STEPS].

On the command line: sparse_coord run env1 --set perception=own_perception:fog:4
"""

import sys

import numpy as np

import sparse_coord_ros as sc


@sc.perception_model
def fog(grid, reach):
    """Return how likely one robot sees another: less the further apart they are, in cells."""
    here = np.array(grid.cells)  # row and column of each cell
    apart = np.abs(here[:, None] - here[None, :]).sum(axis=2)
    return np.exp(-apart / reach)  # the asker's cell first, then the asked robot's


sc.register_perception("fog", fog)

if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    for perception in ("always", "fog:4", "fog:1"):
        scenario = sc.load_scenario("env1", steps=steps, perception=perception)
        team = sc.evaluate(sc.train(scenario, seed=2))
        measured = [f"{name} {team.in_words(name)}" for name in ("returns", "asks")]
        print(f"{perception}: {', '.join(measured)}")
