# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of maps and teams: memory, processor time and arrivals of one learning run.

    python -m tools.study.scale halls:24 --robots 8 --steps 20000 --set prior=map
    python -m tools.study.scale building-3x2x4-32r-4 --steps 100000 --seed 2

`halls:N` is N x N halls of 13 x 13 cells, with a doorway between neighbours. Any other scenario is
named as everywhere. It prints one line, for the tables of docs/maps.md.
"""

import argparse
import resource
import time

import numpy as np

from sparse_coord_ros.core.game.grid import DOORWAY, FREE, WALL, GridMap
from sparse_coord_ros.core.game.scenario import (
    Scenario,
    load_scenario,
    scenario_from_dict,
)
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team
from sparse_coord_ros.lab.maps.plan import suggested_settings

SIDE = 13
"""Cells along the side of a hall."""

NO_MEANING = ("q_star_init", "q_coord_init")
"""Settings without a meaning where robots know their map."""


def halls(count: int) -> GridMap:
    """Return a map of `count` x `count` halls."""
    size = count * (SIDE + 1) - 1
    signs = np.full((size, size), FREE)
    walls = np.arange(SIDE, size, SIDE + 1)
    middles = np.arange(SIDE // 2, size, SIDE + 1)
    signs[walls] = WALL
    signs[:, walls] = WALL
    signs[np.ix_(walls, middles)] = DOORWAY
    signs[np.ix_(middles, walls)] = DOORWAY
    return GridMap("halls", tuple("".join(row) for row in signs))


def in_halls(count: int, robots: int, given: dict[str, str]) -> Scenario:
    """Return a scenario in halls, in which robots change places across the map in pairs."""
    grid = halls(count)
    draw = np.random.default_rng(count)
    places = draw.choice(len(grid.cells), 2 * robots, replace=False)
    pairs = list(zip(places[::2].tolist(), places[1::2].tolist(), strict=True))
    cells = grid.cells
    team = {
        f"robot_{k}": {"start": list(cells[start]), "goal": list(cells[goal])}
        for k, (start, goal) in enumerate(pairs, start=1)
    }
    said = {"name": grid.name, "map": {"name": grid.name, "text": grid.to_text()}}
    plain = scenario_from_dict({**said, "robots": team}, where="halls", name="halls")
    settings = suggested_settings(grid, pairs, given)
    if given.get("prior") == "map":
        for name in NO_MEANING:
            settings.pop(name, None)
    return plain.with_settings({**settings, **given})


def main() -> None:
    """Learn once, play trials, and print time and memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--robots", type=int, default=8, help="of halls")
    parser.add_argument("--learner", default="factored")
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args()
    given = dict(one.split("=", 1) for one in options.set)
    given = {"penalty": "-100", "steps": str(options.steps), **given}
    began = time.process_time()
    if options.scenario.startswith("halls:"):
        count = int(options.scenario.partition(":")[2])
        scenario = in_halls(count, options.robots, given)
    else:
        scenario = load_scenario(options.scenario).with_settings(given)
    learner = learner_of(options.learner)
    scenario = learner.with_defaults(scenario)
    team = Team(scenario, learner, compiled=True)
    run = LearningRun(team, options.seed, gathering=False)
    ready = time.process_time()
    run.advance(scenario.steps)
    learned = time.process_time()
    trials = team.play(run.minds, options.seed, options.trials)
    everyone = trials.arrived.all(axis=1).mean()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"{options.scenario} seed {options.seed}: {len(scenario.map.cells):,} cells, "
        f"{len(scenario.robots)} robots, {scenario.steps:,} steps; "
        f"{ready - began:.1f} s to begin, {learned - ready:.1f} s to learn, {memory:.2f} GB; "
        f"return {trials.returns.mean():.2f}, arrived {trials.arrived.mean():.4f}, "
        f"all arrived {everyone:.2f}, asks {trials.asks.mean():.2f}, "
        f"miscoordinations {trials.miscoordinations.mean():.3f}"
    )


if __name__ == "__main__":
    main()
