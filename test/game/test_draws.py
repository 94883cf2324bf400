# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Random draws: SplitMix64's bits in every form, uniform and independent, each used once.

Seeds are fixed, so a test passes always or never. What its threshold means: a perfect generator
would fail at one test in a million (`CHI_SQUARED`, `DEVIATIONS`).
"""

import itertools
import sys

import numpy as np
import pytest
from teams import by_agents

from sparse_coord_ros.base import compiling
from sparse_coord_ros.core.game import draws
from sparse_coord_ros.core.game.draws import (
    BLIND_ACTION,
    BLIND_EXPLORE,
    COLUMNS,
    ENVIRONMENT,
    EVALUATION,
    EXPLORE,
    EXPLORED_ACTION,
    FREE,
    LEARNING,
    MOTION,
    MOVE_TIE,
    PEER,
    PERCEPT,
    REPLAY,
    ROBOT,
    START,
    START_CELL,
    TIE,
    draw,
    key_of,
    keys_of,
    mixed,
)
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team

GAMMA = 0x9E3779B97F4A7C15
N = 2**16
BINS = 16
CHI_SQUARED = 378.0
"""A chi-squared number of 255 degrees of freedom exceeds it once in a million."""

DEVIATIONS = 4.9
"""A normal number deviates by so many standard deviations once in a million."""

KEYS = [0, 1, 2**63 + 5, 2**64 - 1]
STEPS = [0, 1, 7, 10**9]


def in_numpy(keys, steps, columns):
    """Return draws by an implementation for arrays; arguments broadcast."""
    counter = np.atleast_1d(steps).astype(np.uint64) * np.uint64(64)
    counter = counter + np.atleast_1d(columns).astype(np.uint64) + np.uint64(1)
    z = np.atleast_1d(keys).astype(np.uint64) + counter * np.uint64(GAMMA)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((z ^ (z >> np.uint64(31))) >> np.uint64(11)) / 2.0**53


def draw_all(keys, steps, found):
    for i in range(len(keys)):
        for j in range(len(steps)):
            for column in range(COLUMNS):
                found[i, j, column] = draw(keys[i], steps[j], column)


# The bits.


def test_the_outputs_are_those_published_for_splitmix64():
    assert [mixed(1234567 + (n + 1) * GAMMA) for n in range(5)] == [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]


def test_a_draw_is_the_upper_bits_of_its_output():
    found = draw(1234567, 0, 4)
    assert found == (16408922859458223821 >> 11) / 2**53
    assert draw(5, 3, 2) == (mixed(5 + (3 * 64 + 3) * GAMMA) >> 11) / 2**53


@pytest.mark.parametrize("steps", [STEPS, np.array(STEPS)], ids=["int", "int64"])
@pytest.mark.parametrize("keys", [KEYS, np.array(KEYS, np.uint64)], ids=["int", "uint"])
def test_plain_python_gives_the_same_bits(keys, steps):
    found = np.zeros((4, 4, COLUMNS))
    draw_all(keys, steps, found)
    every = np.arange(COLUMNS)
    expected = [[in_numpy(key, step, every) for step in STEPS] for key in KEYS]
    assert found.tolist() == np.array(expected).tolist()


def test_compiled_loops_give_the_same_bits():
    [compiled] = compiling.jit([draw_all])
    found = np.zeros((2, 4, 4, COLUMNS))
    draw_all(KEYS, STEPS, found[0])
    compiled(np.array(KEYS, dtype=np.uint64), np.array(STEPS), found[1])
    assert found[0].tolist() == found[1].tolist()


def test_the_keys_of_a_team_are_those_of_its_robots():
    for phase in (LEARNING, EVALUATION):
        keys = keys_of(2**63 - 1, phase, 3)
        assert keys.dtype == np.uint64
        assert keys.tolist() == [
            [key_of(2**63 - 1, phase, k, role) for k in range(3)]
            for role in (ENVIRONMENT, ROBOT)
        ]


def test_numbers_that_key_the_draws_never_change():
    """Renumbering would silently change every result."""
    names = (
        *("LEARNING", "EVALUATION", "ENVIRONMENT", "ROBOT"),
        *("MOTION", "PERCEPT", "START", "START_CELL"),
        *("PEER", "EXPLORE", "EXPLORED_ACTION", "TIE", "MOVE_TIE"),
        *("BLIND_EXPLORE", "BLIND_ACTION", "REPLAY", "FREE", "COLUMNS"),
    )
    numbers = [0, 1, 0, 1, *range(4), *range(8), 16, 64]
    assert [getattr(draws, name) for name in names] == numbers
    assert REPLAY < FREE < COLUMNS
    assert key_of(7, EVALUATION, 3, ROBOT) == mixed(7 + 16 * GAMMA)


# Their distribution.


def check_uniform(u, v):
    """Check that pairs of draws are uniform in a square, and not more evenly than by chance."""
    counts = np.histogram2d(u, v, bins=BINS, range=((0, 1), (0, 1)))[0]
    expected = len(u) / BINS**2
    squared = ((counts - expected) ** 2 / expected).sum()
    assert 161.0 < squared < CHI_SQUARED


def check_uncorrelated(u, v):
    """Check that two series are not correlated."""
    assert abs(np.corrcoef(u, v)[0, 1]) * np.sqrt(len(u)) < DEVIATIONS


def sequence(seed=3, phase=LEARNING, robot=0, role=ROBOT, column=0, first=0):
    """Return a draw of each of N time steps."""
    steps = np.arange(first, first + N)
    return in_numpy(key_of(seed, phase, robot, role), steps, column)


@pytest.mark.parametrize(
    "other",
    [
        *({"robot": robot} for robot in (1, 2, 7)),
        {"role": ENVIRONMENT},
        {"phase": EVALUATION},
        *({"seed": seed} for seed in (2, 4, 3 + 2**32, 2**63 - 1)),
        *({"column": column} for column in (1, 2, 16, COLUMNS - 1)),
        *({"first": first} for first in (1, 2, 64)),
    ],
    ids=str,
)
def test_neighbours_are_independent(other):
    check_uniform(sequence(), sequence(**other))
    check_uncorrelated(sequence(), sequence(**other))


def test_draws_of_one_time_step_are_independent_over_seeds():
    """Runs differ by their seeds: a mean over runs needs the draws of one step independent."""
    keys = [
        np.array([key_of(seed, LEARNING, robot, ROBOT) for seed in range(N)], np.uint64)
        for robot in (0, 1)
    ]
    first = in_numpy(keys[0], 1, 0)
    for other in (
        in_numpy(keys[0], 1, 1),
        in_numpy(keys[0], 2, 0),
        in_numpy(keys[1], 1, 0),
    ):
        check_uniform(first, other)
        check_uncorrelated(first, other)
    check_uncorrelated(first[:-1], first[1:])


def test_no_lag_of_the_generator_is_correlated():
    """All columns of consecutive time steps, in the order of the generator."""
    steps, columns = np.divmod(np.arange(N), COLUMNS)
    found = in_numpy(key_of(0, LEARNING, 0, ENVIRONMENT), steps, columns)
    # 200 lags: 4.9 deviations in one of them are as rare as 1 in 5,000
    for lag in range(1, 201):
        check_uncorrelated(found[:-lag], found[lag:])


def test_every_bit_is_set_half_of_the_time():
    found = (sequence() * 2**53).astype(np.uint64)
    for bit in range(53):
        ones = int((found >> np.uint64(bit) & np.uint64(1)).sum())
        assert abs(ones - N / 2) < DEVIATIONS * np.sqrt(N) / 2


# No draw is made twice.


def place(key, counter):
    """Return the place of a draw in the one sequence that all keys share, of 2^64 outputs."""
    return (int(key) * pow(GAMMA, -1, 2**64) + counter) % 2**64


def test_no_two_keys_reach_the_same_outputs():
    """Of 1,000 seeds with 8 robots, in the first five million time steps."""
    ranges = (range(1000), (LEARNING, EVALUATION), range(8), (ENVIRONMENT, ROBOT))
    keys = {key_of(*one) for one in itertools.product(*ranges)}
    assert len(keys) == 1000 * 2 * 8 * 2
    places = sorted(place(key, 0) for key in keys)
    gaps = (after - before for before, after in itertools.pairwise(places))
    assert min(gaps) > 5 * 10**6 * COLUMNS


@pytest.fixture
def made(monkeypatch):
    """The draws that plain Python makes from here on: (key, step, column)."""
    found = []

    def noted(key, step, column):
        found.append((key, step, column))
        return draw(key, step, column)

    for name, module in list(sys.modules.items()):
        if name.startswith("sparse_coord_ros") and vars(module).get("draw") is draw:
            monkeypatch.setattr(module, "draw", noted)
    return found


def by_loop(scenario, learner):
    """Learn and play in the loops of plain Python."""
    run = LearningRun(Team(scenario, learner, compiled=False), 3)
    run.advance(scenario.steps)
    run.play(20)


def by_robots(scenario, learner):
    """Learn by agents in a world."""
    by_agents(scenario, learner, 3)


@pytest.mark.parametrize("way", [by_loop, by_robots])
@pytest.mark.parametrize(
    ("name", "learner", "columns"),
    [
        ("env2-4r", "coop", {PEER, EXPLORE, EXPLORED_ACTION, TIE, MOVE_TIE}),
        ("env1", "cq", {EXPLORE, BLIND_EXPLORE, BLIND_ACTION}),
        ("env1", "voi", {EXPLORE, EXPLORED_ACTION, REPLAY}),
    ],
)
def test_a_run_uses_no_output_twice(way, name, learner, columns, made):
    """And every column of the world, and those of a robot that the learner needs."""
    rule = learner_of(learner)
    settings = {
        "steps": 1000,
        "epsilon": "constant:0.4",
        "perception": "probability:0.7",
        "starts": "mixed:0.5",
    }
    scenario = rule.with_defaults(load_scenario(name).with_settings(settings))
    way(scenario, rule)
    assert len(made) > 3000
    keys = keys_of(3, LEARNING, len(scenario.robots)).tolist()
    used = [{column for key, _, column in made if key in own} for own in keys]
    assert used[ENVIRONMENT] == {MOTION, PERCEPT, START, START_CELL}
    assert columns <= used[ROBOT] <= set(range(FREE))
    places = {place(key, step * COLUMNS + column) for key, step, column in made}
    assert len(places) == len(made)
