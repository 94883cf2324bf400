# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""coop with the constants of a textbook, which nobody searched for. README.md.

python studies/textbook.py --out docs/tables/textbook.csv

Values begin at 0, step size and epsilon are 0.1, episodes begin at the scenario's starts. Penalty
and steps are those of the experiment penalty100, which has the same learner with its defaults.
"""

import argparse

import pandas as pd

import sparse_coord_ros as sc

TEXTBOOK = {
    "step_size": "constant:0.1",
    "epsilon": "constant:0.1",
    "q_star_init": 0,
    "q_coord_init": 0,
    "starts": "fixed",
}


def main() -> None:
    """Let teams learn, and write a row for each scenario."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--out", default="textbook.csv")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--steps", type=int, default=100_000)
    options = parser.parse_args()
    frames = []
    for name in ("env1", "env2-2r", "pentagon"):
        scenario = sc.load_scenario(
            name, penalty=-100, steps=options.steps, **TEXTBOOK
        )
        teams = sc.sweep(scenario, {"learner": ["coop"]}, runs=options.runs)
        frames.append(sc.to_pandas(teams))
    pd.concat(frames).to_csv(options.out, index=False)


if __name__ == "__main__":
    main()
