# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Do teams stand for ever? Learner voi with its patience and without. docs/learners.md.

python studies/stand_offs.py [--robots N...] [--teams N] > docs/tables/stand_offs.md

Trials last `HORIZON` steps, ten times as long as others: a team that has not arrived by then
stands. A team fails where a robot is missing in more than one of 1,000 trials. The table, in
Markdown, has failed teams, the least arrival of a team and the mean return with a standard error
over buildings. Nothing was chosen by these buildings. Of sixteen robots one team learns in each.
"""

import argparse

import numpy as np
from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import MOVE_TIE
from sparse_coord_ros.core.learners.rules import greedy
from sparse_coord_ros.core.learners.voi import Voi, by_policy
from sparse_coord_ros.core.runs.measures import fails, standard_error

HORIZON = 1000
KINDS = ["corridor", "crossing", "rooms"]
"""Two rooms and a passage of doorways; four arms that meet in a doorway; rooms and doorways."""

SIXTEEN = {"corridor": "building-4x1x4-16r"}
"""Where sixteen robots have room: a row of four rooms."""


class Impatient(Voi):
    """The same rule without patience."""

    name = "impatient"

    @staticmethod
    def move_after_asking(mind, task, k, step, cell, seen, cells, values):
        """As of `Voi`, but the greedy move is that of Q^C, however long nobody moved."""
        action = by_policy(mind.q_star[k, cell], task, k, step)
        if action != COORDINATE:
            return action
        return greedy(values, PRIMITIVES, task.keys[k], step, MOVE_TIE)


def names_of(kind: str, robots: int, buildings: int, first: int) -> list[str]:
    """Return the names of fresh buildings; none where a kind has no room for the robots."""
    family = f"unseen2-{kind}-{robots}r"
    if robots > 8:
        family = SIXTEEN.get(kind, "")
    return [f"{family}-{first + i}" for i in range(buildings) if family]


def judged(
    names: list[str], teams: int, learner: type[Voi], options: argparse.Namespace
) -> list[str]:
    """Return the cells of a learner: failed teams, least arrival, mean return."""
    arrived: list[float] = []
    returns = []
    for name in names:
        scenario = sc.load_scenario(
            name,
            penalty=-100,
            steps=options.steps,
            horizon=HORIZON,
            peers_seen="while_learning",
        )
        learned = sc.train_many(
            scenario,
            learner,
            runs=teams,
            seed=options.seed,
            trials=options.trials,
            history=False,
        )
        arrived += [team.measures.mean("arrived") for team in learned]
        returns.append(np.mean([team.measures.mean("returns") for team in learned]))
    return [
        f"{sum(map(fails, arrived))} of {len(arrived)}",
        percent(min(arrived)),
        f"{np.mean(returns):.1f} ({standard_error(np.array(returns)):.1f})",
    ]


def main() -> None:
    """Let teams learn, and print a line for each kind of building and number of robots."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--robots", nargs="+", type=int, default=[4, 8, 16])
    parser.add_argument("--buildings", type=int, default=4, help="of each kind")
    parser.add_argument("--teams", type=int, default=4, help="in each building")
    parser.add_argument("--trials", type=int, default=500, help="greedy, of a team")
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=7_300_000)
    options = parser.parse_args()
    measures = ["failed teams", "least arrival", "return"]
    heads = ["place", "robots", *measures, "failed without patience", *measures[1:]]
    print("| " + " | ".join(heads) + " |\n| :-- |" + " --: |" * (len(heads) - 1))
    for robots in options.robots:
        for kind in options.kinds:
            names = names_of(kind, robots, options.buildings, options.seed)
            if not names:
                continue
            teams = options.teams if robots <= 8 else 1
            cells = [kind, str(robots)]
            for learner in (Voi, Impatient):
                cells += judged(names, teams, learner, options)
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    run_script(main)
