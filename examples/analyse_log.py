# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Analyse a recorded run: python analyse_log.py BAG.

A bag comes from e.g.: sparse_coord run env1 --steps 20000 --out runs/demo
"""

import sys

import numpy as np

import sparse_coord_ros as sc

if len(sys.argv) != 2:
    sys.exit("give one bag: python analyse_log.py runs/demo")
bag = sys.argv[1]
log = sc.read_log(bag)
print(f"{log.run.scenario.name}, {log.run.learner}: {len(log.step)} time steps")

verification = sc.verify(bag)
print("identical" if verification.same else f"differs: {verification.first}")

for k, name in enumerate(log.names):
    asked = log.asked[:, k]
    print(
        f"{name} asked {asked.sum()} times, {log.perceived[:, k].sum()} answered; most often in"
    )
    cells, counts = np.unique(log.cells[asked, k], return_counts=True)
    for place in np.argsort(-counts)[:3]:
        row, column = log.run.scenario.map.cells[cells[place]]
        print(f"  row {row}, column {column}: {counts[place]} times")
