# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One run, whatever computes it: plain loops, compiled loops, agents, parts through files.

Each learner, in games that show all rules, gives the same bits of memories, history and trials.
The live ways are in test/nodes/test_bit_identity.py, the log in test/runlog.
"""

from dataclasses import fields

import numpy as np
import pytest
from teams import PROTOCOL, by_agents, in_parts

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners import mind
from sparse_coord_ros.core.learners.registry import LEARNERS, learner_of
from sparse_coord_ros.core.learners.tables import memories_equal
from sparse_coord_ros.core.runs import run as engine
from sparse_coord_ros.core.runs.run import LearningRun, Team

GIVEN = {
    **PROTOCOL,
    "steps": 800,
    "penalty": -100,
    "q_star_init": 0,
    "epsilon": "constant:0.4",
}
"""Whatever the defaults are: robots that learn enough in so few steps to meet and to ask."""

GAMES = {
    "plain": ("env1", {}),
    "no answers": ("env1", {"perception": "never"}),
    "few answers": (
        "env1",
        {"perception": "probability:0.7", "goal_value": 0, "starts": "fixed"},
    ),
    "links that fail": (
        "env1",
        {"link": "bursts:0.05:0.2", "common_reward": "each:1:0.5"},
    ),
    "schedules": (
        "env2-2r",
        {
            "starts": "exploring:1:0.1:0.8",
            "step_size": "floored:0.7:0.2:0.01",
            "horizon": 70,
        },
    ),
    "short": ("env2-2r", {"max_steps": 9, "conflict": "any_doorway", "ask_cost": 0}),
    "sight": ("isr", {"perception": "line_of_sight", "move_success": 1}),
}
"""Games of two robots, which each learner can learn."""

TEAMS = {
    "four, one asked": ("env2-4r", "coop", {"perception": "range:3", "max_steps": 30}),
    "four, unequal": ("env2-4r", "coop", {"common_reward": "each:0:1:0.5:3"}),
    "three, all asked": (
        "crowd-3r",
        "coop",
        {"peers": "all", "perception": "probability:0.7"},
    ),
    "four, alone": ("env2-4r", "indiv", {"starts": "mixed:0.5"}),
    "four, no questions": ("env2-4r", "noncoop", {"conflict": "any_doorway"}),
    "four, factored": (
        "env2-4r",
        "factored",
        {"perception": "range:4", "credit": "weight:2"},
    ),
    "four, no referee": ("env2-4r", "factored", {"referee": False, "starts": "fixed"}),
    "three, marked": ("crowd-3r", "cq", {"link": "lost:0.3"}),
}

SEEN_ALWAYS = [
    name
    for name in GAMES
    if name not in ("no answers", "few answers", "links that fail", "sight")
]
CASES = [
    pytest.param(*GAMES[name], learner, id=f"{learner}, {name}")
    for learner in LEARNERS.registered
    if learner in ("coop", "noncoop", "indiv", "factored", "cq", "joint")
    for name in (SEEN_ALWAYS if learner == "joint" else GAMES)
] + [
    pytest.param(name, settings, learner, id=f"{learner}, {what}")
    for what, (name, learner, settings) in TEAMS.items()
]
SEED = 7
TRIALS = 20


def problem(name, settings, learner):
    rule = learner_of(learner)
    return rule.with_defaults(
        load_scenario(name).with_settings({**GIVEN, **settings})
    ), rule


def learned(scenario, rule, *, compiled):
    run = LearningRun(Team(scenario, rule, compiled=compiled), SEED)
    run.advance(scenario.steps)
    return run


def assert_same_memories(one, other):
    for mine, theirs in zip(one, other, strict=True):
        assert memories_equal(mine, theirs)


def assert_same_trials(one, other):
    for field in fields(one):
        mine = getattr(one, field.name)
        theirs = getattr(other, field.name)
        assert mine.shape == theirs.shape and mine.dtype == theirs.dtype, field.name
        assert mine.tobytes() == theirs.tobytes(), field.name


@pytest.mark.parametrize(("name", "settings", "learner"), CASES)
def test_one_run(monkeypatch, tmp_path, name, settings, learner):
    scenario, rule = problem(name, settings, learner)
    plain = learned(scenario, rule, compiled=False)
    quick = learned(scenario, rule, compiled=True)
    assert_same_memories(plain.memories, quick.memories)
    assert plain.history.same_bits(quick.history)
    assert plain.visited.tolist() == quick.visited.tolist()
    assert_same_trials(plain.play(TRIALS), quick.play(TRIALS))
    for one, other in zip(plain.tables, quick.tables, strict=True):
        if not scenario.sparse:
            assert one.q_coord.tobytes() == other.q_coord.tobytes()
    if not rule.sees_all:
        memories, history = by_agents(scenario, rule, SEED)
        assert_same_memories(plain.memories, memories)
        assert plain.history.same_bits(history)
    monkeypatch.setattr(engine, "BLOCK_STEPS", 64)
    parts = in_parts(scenario, rule, SEED, (1, 63, 64, 301, scenario.steps), tmp_path)
    assert_same_memories(plain.memories, parts.memories)
    assert plain.history.same_bits(parts.history)


@pytest.mark.parametrize("learner", ["coop", "factored"])
def test_tables_of_all_rows_and_of_learned_rows_alone(monkeypatch, learner):
    """The compiled loops keep a row for each key, or search for it; and both can go on."""
    scenario, rule = problem("env1", {"perception": "probability:0.7"}, learner)
    dense = learned(scenario, rule, compiled=True)
    monkeypatch.setattr(mind, "DENSE_ROWS", 0)
    monkeypatch.setattr(mind, "DENSE_ZERO_ROWS", 0)
    hashed = learned(scenario, rule, compiled=True)
    assert_same_memories(dense.memories, hashed.memories)
    assert_same_trials(dense.play(TRIALS), hashed.play(TRIALS))


def test_the_games_show_what_they_are_for():
    """The cases above would say little if robots never met and never asked."""
    scenario, rule = problem("env2-4r", {"conflict": "any_doorway"}, "noncoop")
    assert learned(scenario, rule, compiled=True).play(50).miscoordinations.sum() > 0
    for name, (where, settings) in GAMES.items():
        for learner in ("coop", "factored", "cq"):
            run = learned(*problem(where, settings, learner), compiled=True)
            assert run.asked.sum() > 20 or learner == "cq", (name, learner)
            assert (run.visited.min() > 0) or name == "no answers" or learner == "cq", (
                name,
                learner,
            )


@pytest.mark.parametrize("learner", ["coop", "noncoop", "indiv", "factored"])
def test_other_seeds_learn_other_tables(learner):
    scenario, rule = problem("env1", {}, learner)
    runs = [LearningRun(Team(scenario, rule, compiled=True), seed) for seed in (1, 2)]
    for run in runs:
        run.advance(scenario.steps)
    assert not np.array_equal(
        runs[0].tables[0].q_star, runs[1].tables[0].q_star, equal_nan=True
    )
