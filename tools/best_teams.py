# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Find the best known teams of more than two robots: config/best_teams.json.

python -m tools.best_teams --out coordination

The folder is that of `python -m tools.coordination`: the teams are those of its study `many`. The
best few are learned again and judged by fresh trials.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from sparse_coord_ros.engine.batch import CompiledTeam, prepare
from sparse_coord_ros.experiments.catalogue import LONG
from sparse_coord_ros.experiments.conditions import make_condition
from sparse_coord_ros.experiments.runner import Computing
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.solve.shipped import BestTeam, game_digest
from sparse_coord_ros.version import __version__
from tools.coordination.__main__ import finder
from tools.coordination.studies import MANY, SEED, STUDIES

FILE = Path(__file__).resolve().parents[1] / "config" / "best_teams.json"
FEW = 5
TRIALS = 20_000
FRESH = 10**9
"""Added to a seed for the trials."""

ABOUT = (
    "The best of many learned teams of more than two robots, each found again by its seed "
    "(tools/best_teams.py). No bound: better teams may exist."
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute, print, and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("coordination"))
    options = parser.parse_args(arguments)
    [study] = [one for one in STUDIES if one.name == "many"]
    found = finder(study, options.out, Computing(jobs=1))
    teams = {}
    for name in MANY:
        condition = make_condition(name, "factored", LONG)
        scenario = condition.scenario
        rewards = found(condition).run_means("reward")
        prepare(scenario, "factored")
        team = CompiledTeam(scenario, "factored")
        judged = []
        for run in np.argsort(rewards)[-FEW:].tolist():
            seed = SEED + run
            means = team.play(team.learn(seed), seed + FRESH, TRIALS).reward.mean(axis=1)
            judged.append((float(means.mean()), float(means.std(ddof=1) / TRIALS**0.5), seed))
        value, error, seed = max(judged)
        best = BestTeam(
            value=value,
            standard_error=error,
            trials=TRIALS,
            teams=len(rewards),
            learner="factored",
            steps=scenario.steps,
            seed=seed,
            game=game_digest(scenario),
            version=__version__,
            date=f"{datetime.now(UTC):%Y-%m-%d}",
        )
        print(f"{name}: {best}", flush=True)
        teams[f"{name}, penalty {scenario.penalty:g}"] = asdict(best)
    text = json.dumps({"format": 1, "about": ABOUT, "teams": teams}, indent=1) + "\n"
    write_whole(FILE, text)


if __name__ == "__main__":
    main()
