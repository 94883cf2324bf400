# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compute the class bounds that the package ships: config/class_bounds.json.

python -m tools.class_bounds --keep SEARCHES [--restarts N] [SCENARIO ...]

Every search is kept in the folder SEARCHES and goes on from there. What the file has of other
scenarios stays.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.solve.class_search import class_bound
from sparse_coord_ros.solve.shipped import ClassBound

FILE = Path(__file__).resolve().parents[1] / "config" / "class_bounds.json"
SCENARIOS = ("env1", "env2-2r", "pentagon", "isr", "cit")
PENALTIES = ("0", "-0.1", "-1", "-10", "-20", "-100")
SEED = 1
ABOUT = (
    "The best teams of two robots of Algorithm 1's form that a search found: lower bounds "
    "(sparse_coord optimum --class; tools/class_bounds.py). moves: one letter a cell; asks: the "
    "cells to ask in, one letter for each cell of the peer."
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute, print, and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS, metavar="SCENARIO")
    parser.add_argument("--keep", type=Path, required=True, metavar="SEARCHES")
    parser.add_argument("--restarts", type=int, default=100)
    options = parser.parse_args(arguments)
    options.keep.mkdir(parents=True, exist_ok=True)
    for name in options.scenarios:
        for penalty in PENALTIES:
            scenario = load_scenario(name).with_settings({"penalty": penalty})
            search = options.keep / f"{name}_{penalty}.search.json"
            began = time.process_time()
            found = class_bound(scenario, restarts=options.restarts, seed=SEED, file=search)
            gains = ", ".join(f"{gain:.4f}" for gain in found.gains)
            print(
                f"{name} {penalty}: {found.value:.6f}, {found.agreed} of {found.restarts}, gains "
                f"{gains}, {time.process_time() - began:.1f} s",
                flush=True,
            )
            add_bound(f"{name}, penalty {penalty}", found)


def add_bound(title: str, found: ClassBound) -> None:
    """Write one bound into the file; one line each."""
    bounds = json.loads(FILE.read_text(encoding="utf-8"))["bounds"]
    bounds[title] = asdict(found)
    lines = ",\n".join(
        f"  {json.dumps(key)}: {json.dumps(bound)}" for key, bound in bounds.items()
    )
    text = f'{{"format": 1,\n "about": {json.dumps(ABOUT)},\n "bounds": {{\n{lines}\n }}}}\n'
    write_whole(FILE, text)


if __name__ == "__main__":
    main()
