# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Choose the unseen buildings of the benchmark and compute what they are measured against.

python -m tools.unseen [--restarts N]

Of each kind and team, seeds are looked at from 0 on. The first `COUNTS` even ones with a real
conflict are for tuning, the first odd ones for the test: what a planner with full sight is worth
is above shortest paths by more than `CONFLICT`. Writes config/unseen.json, and the class bounds
into config/class_bounds.json.
"""

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import count
from pathlib import Path

from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.scenario import Scenario, load_scenario
from sparse_coord_ros.game.unseen import KINDS, TEAMS, VERSION
from sparse_coord_ros.solve.class_search import class_bound
from sparse_coord_ros.solve.optimum import joint_optimum
from sparse_coord_ros.solve.reference import shortest_path_reference
from sparse_coord_ros.solve.routes import route_plan
from sparse_coord_ros.solve.shipped import game_digest
from tools.class_bounds import add_bound

FILE = Path(__file__).resolve().parents[1] / "config" / "unseen.json"
COUNTS = {2: 4, 4: 2, 8: 1}
CONFLICT = 1.0
ABOUT = (
    "Generated buildings with a real conflict (tools/unseen.py; game/unseen.py makes them). Even "
    "seeds are for tuning. Odd ones are opened once, for the closing figures: no rule and no "
    "number may be chosen by them. optimum: exact joint optimum; routes: what a planner that sees "
    "everything for nothing reaches with more than two robots. Class bounds: class_bounds.json."
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute, print, and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--restarts", type=int, default=40)
    options = parser.parse_args(arguments)
    buildings = {}
    for robots in TEAMS:
        for kind in KINDS:
            for scenario, facts in _chosen(kind, robots):
                began = time.process_time()
                if robots == 2:
                    found = class_bound(scenario, restarts=options.restarts, seed=1)
                    add_bound(f"{scenario.name}, penalty {scenario.penalty:g}", found)
                    facts["class bound"] = found.value
                    facts["agreed"] = found.agreed
                print(scenario.name, facts, f"{time.process_time() - began:.1f} s", flush=True)
                buildings[scenario.name] = {
                    "game": game_digest(scenario),
                    **{k: v for k, v in facts.items() if k not in ("class bound", "agreed")},
                }
    lines = ",\n".join(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in buildings.items())
    text = f'{{"format": 1,\n "about": {json.dumps(ABOUT)},\n "buildings": {{\n{lines}\n }}}}\n'
    write_whole(FILE, text)


def _chosen(kind: str, robots: int) -> Iterator[tuple[Scenario, dict[str, object]]]:
    """Yield the buildings of a kind, and what is known of them, in the order of their seeds."""
    wanted = [COUNTS[robots]] * 2
    for seed in count():
        if not any(wanted):
            return
        if not wanted[seed % 2]:
            continue
        scenario = load_scenario(f"{VERSION}-{kind}-{robots}r-{seed}")
        facts: dict[str, object] = {"shortest_paths": shortest_path_reference(scenario).reward}
        optimum = joint_optimum(scenario)
        best = optimum.value
        if optimum.exact:
            facts["optimum"] = best
        if robots > 2:
            plan = route_plan(scenario)
            facts["routes"], best = asdict(plan), plan.value
        if best > float(facts["shortest_paths"]) + CONFLICT:  # type: ignore[arg-type]
            wanted[seed % 2] -= 1
            yield scenario, facts


if __name__ == "__main__":
    main()
