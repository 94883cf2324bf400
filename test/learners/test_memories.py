# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Memories of robots are checked wherever they enter: a run must have made them."""

import numpy as np
import pytest
from teams import plain_run

from sparse_coord_ros.base.errors import RunError, TablesError
from sparse_coord_ros.core.engine import training_checkpoint
from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.cq import COUNT, SQUARES
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.learners.registry import learner_of

LEARNERS = ("coop", "indiv", "noncoop", "hysteretic", "factored", "cq")
OFTEN = {"steps": 400, "q_star_init": 100, "ask_cost": 0, "penalty": -20}


def learned(learner, scenario="env1"):
    """Return (scenario, learner, a run of 300 steps)."""
    rule = learner_of(learner)
    settings = OFTEN if learner != "indiv" else {"steps": 400}
    scenario = rule.with_defaults(load_scenario(scenario).with_settings(settings))
    run = plain_run(scenario, rule, 0)
    run.advance(300)
    return scenario, rule, run


def with_array(memory, name, change):
    """Return a memory in which `change` has altered one array in place."""
    array = memory[name].copy()
    change(array)
    return {**memory, name: array}


def at_first(value):
    """Return what puts a value into the first element."""

    def change(array):
        array.reshape(-1)[0] = value

    return change


def refused(scenario, rule, memory, words="tables do not match"):
    with pytest.raises(TablesError, match=words):
        check_memory(scenario, rule, 0, memory)


@pytest.mark.parametrize("learner", LEARNERS)
def test_what_a_run_made_is_accepted(learner):
    scenario, rule, run = learned(learner)
    for k, memory in enumerate(run.memories):
        check_memory(scenario, rule, k, memory)


@pytest.mark.parametrize("learner", LEARNERS)
def test_no_array_has_numbers_that_none_learns(learner):
    """NaN, infinite, beyond every reward, negative counts, counts beyond 32 bits, no such cell."""
    scenario, rule, run = learned(learner)
    memory = run.memories[0]
    tried = 0
    for name, array in memory.items():
        false = (np.nan, np.inf, -np.inf, 9e174)
        if array.dtype.kind == "i":
            false = (-2, np.iinfo(array.dtype).max, np.iinfo(array.dtype).min)
        for value in false:
            if array.size and array.dtype.kind != "b":
                refused(scenario, rule, with_array(memory, name, at_first(value)))
                tried += 1
    assert tried >= 7


def put(place, value):
    """Return what puts a value into a place."""

    def change(array):
        array[place] = value

    return change


def test_a_model_that_contradicts_its_counts():
    scenario, rule, run = learned("factored")
    memory = run.memories[0]
    moved = memory["moved"]
    made = memory["updates"][:, :4]
    left = tuple(np.argwhere(moved > 0)[0])
    stayed = tuple(np.argwhere(moved == 0)[0])
    cases = {
        "moved counts": ("moved", put(left, made[left] + 1)),
        "commons counts": ("commons", put(left, made[left] + 1)),
        "successor is": ("successor", put(left, left[0])),
        "successor is not": ("successor", put(stayed, 1)),
        "tried are": ("tried", put(0, int(np.flatnonzero(made == 0)[0]))),
        "door has": ("door", put(0, -19.0)),
    }
    for words, (name, change) in cases.items():
        refused(scenario, rule, with_array(memory, name, change), words)


def test_who_never_asks_has_learned_nothing_from_asking():
    scenario, rule, run = learned("noncoop")
    memory = run.memories[0]
    refused(
        scenario,
        rule,
        with_array(memory, "updates", put((0, COORDINATE), 1)),
        "updates",
    )


def test_states_come_once():
    scenario, rule, run = learned("coop")
    memory = run.memories[0]
    keys = memory["q_coord_keys"]
    assert len(keys) > 1
    twice = with_array(memory, "q_coord_keys", put(0, keys[1]))
    refused(
        scenario,
        rule,
        twice,
        "q_coord_keys",
    )


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ((..., COUNT), 20.0, "samples has counts"),
        ((..., SQUARES), -1.0, "samples has sums"),
    ],
)
def test_samples_of_cq(place, value, words):
    scenario, rule, run = learned("cq")
    refused(
        scenario, rule, with_array(run.memories[0], "samples", put(place, value)), words
    )


def more_moves_than_made(memory):
    return {**memory, "moved": memory["moved"] * 0 + 2**30}


def test_a_checkpoint_with_such_a_memory_is_broken(tmp_path):
    scenario, rule, run = learned("factored")
    state = run.state()
    forged = state._replace(memories=tuple(map(more_moves_than_made, state.memories)))
    path = tmp_path / training_checkpoint.CHECKPOINT_FILE
    training_checkpoint.Checkpoint(forged, (), 0, 10).save(path, scenario, rule, 0)
    with pytest.raises(RunError, match="moved"):
        training_checkpoint.load_checkpoint(path, scenario, rule, 0)
