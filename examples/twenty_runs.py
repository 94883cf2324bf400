# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Twenty learning runs of two learners as a pandas frame: python twenty_runs.py [STEPS [RUNS]]."""

import sys

import sparse_coord_ros as sc


def main() -> None:
    """Learn on all cores, then compare the learners."""
    steps, runs = [int(text) for text in sys.argv[1:]] + [20_000, 20][
        len(sys.argv) - 1 :
    ]
    scenario = sc.load_scenario("env1", steps=steps)
    swept = sc.sweep(scenario, {"learner": ["noncoop", "coop"]}, runs=runs, trials=200)
    frame = sc.to_pandas(swept, by_run=True)
    print(
        frame.groupby("learner")[["returns", "miscoordinations", "asks"]].agg(
            ["mean", "std"]
        )
    )
    frame.to_csv("twenty_runs.csv", index=False)


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    main()
