# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learning and exact values, beside Algorithm 1 written a second time."""

from pathlib import Path

import numpy as np
import pytest

import sparse_coord_ros as sc

pytest.importorskip("numba")

import independent_algorithm1 as independent

MAPS = Path(__file__).parents[2] / "maps"

LIMIT = 4.5
"""Standard errors of a difference. Of two right programs with other seeds than these 48 means are
compared: they would fail in one of 3,000 tries."""

EVALUATED = ("returns", "asks", "miscoordinations", "arrived")
"""What `independent.evaluate` returns."""

CONDITIONS = [
    ("env1", "coop", -100, 20_000),
    ("env2-2r", "coop", -20, 10_000),
    ("pentagon", "coop", -100, 20_000),
    ("env1", "noncoop", -20, 10_000),
    ("env2-2r", "indiv", -20, 10_000),
    ("pentagon", "noncoop", -100, 20_000),
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "learner", "penalty", "steps"), CONDITIONS)
def test_as_a_second_implementation(name, learner, penalty, steps):
    """Both learn the same on average, and both compute the same values of a team."""
    runs = 100
    scenario = sc.load_scenario(name, penalty=penalty, steps=steps)
    problem = independent.read_problem(name, MAPS)
    learned = sc.train_many(
        scenario, learner, runs=runs, seed=1000, trials=0, history=False
    )
    ours = [measures(problem, penalty, *arrays_of(run)) for run in learned]
    theirs = [
        measures(
            problem,
            penalty,
            *independent.learn_team(problem, learner, penalty, steps, seed),
        )
        for seed in range(runs)
    ]
    for measure in ours[0]:
        mine = np.array([run[measure] for run in ours])
        other = np.array([run[measure] for run in theirs])
        error = np.sqrt((mine.var(ddof=1) + other.var(ddof=1)) / runs)
        difference = abs(mine.mean() - other.mean())
        means = (measure, mine.mean(), other.mean(), error)
        assert difference <= LIMIT * error + 1e-9, means
    for number in range(3):
        exact = sc.evaluate_exact(learned[number])
        found = {name: exact.mean(name) for name in EVALUATED}
        expected = {name: ours[number][name] for name in found}
        assert found == pytest.approx(expected, abs=1e-9)


def arrays_of(run):
    """Return Q* and Q^C of a run of the package; a baseline's column of COORDINATE is -inf."""
    q_star = np.array([robot.q_star for robot in run.tables])
    q_coord = np.array([robot.q_coord for robot in run.tables])
    return np.where(np.isnan(q_star), -np.inf, q_star), q_coord


def measures(problem, penalty, q_star, q_coord):
    """Return measures of a team: of its greedy policy, and of its tables."""
    found = independent.evaluate(problem, float(penalty), q_star, q_coord)
    learned = dict(zip(EVALUATED, found, strict=True))
    first_rows = [q_star[k, start] for k, start in enumerate(problem.starts)]
    learned["Q* of moves at the start"] = np.mean([row[:4].max() for row in first_rows])
    learned["Q* of moves"] = q_star[:, :, :4].mean()
    if np.isfinite(q_star).all():
        updated = q_coord != independent.FIRST_Q_COORD
        knowing = q_coord - q_star[:, :, None, :4]
        learned["Q* of asking at the start"] = np.mean([row[4] for row in first_rows])
        learned["Q* of asking"] = q_star[:, :, 4].mean()
        learned["Q^C"] = q_coord[updated].mean()
        learned["Q^C - Q*"] = knowing[updated].mean()
    return learned
