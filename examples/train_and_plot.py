# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Train a team and plot its learning curve: python train_and_plot.py [STEPS]."""

import sys

import matplotlib.pyplot as plt

import sparse_coord_ros as sc

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
scenario = sc.load_scenario("env1", steps=steps)

for learner in ("noncoop", "coop"):
    training = sc.train(scenario, learner, seed=0)
    plt.plot(*training.history.curve("miscoordinations", window=50), label=learner)
    team = sc.evaluate(training, trials=1000)
    print(f"{learner}: return {team.in_words('returns')}, asks {team.in_words('asks')}")
    # every verb reads it: sparse_coord evaluate runs/coop
    training.save(f"runs/{learner}")

print(f"exact joint optimum: {sc.optimum(scenario).value:.1f}")
plt.xlabel("time step")
plt.ylabel("miscoordinations an episode, mean of 50")
plt.legend()
plt.savefig("learning_curve.png")
