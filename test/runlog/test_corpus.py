# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The corpus of forged and of honest logs: `forgeries` has the cases, `verify` is asked.

`make check-long` asks about thousands; every test run about some, with a seed of their own.
"""

import random
from collections import Counter

import pytest
from forgeries import (
    Case,
    Outcome,
    cut_off,
    drawn,
    everywhere,
    lost,
    named,
    outcome,
    pairs,
    wrong,
)
from forging import forged, read, write
from recordings import OFTEN, recorded, rolled_back

from sparse_coord_ros.log.runlog import read_run
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team

HALF = {"perception": "probability:0.5"}
AT_ZERO = "title: door\nresolution: 1.0\norigin: [-0.5, -0.5]\n---\n1.D.2\n"
"""A map with cells at positions of 0.0, which equals -0.0."""

DOOR = {"penalty": -50, "epsilon": "constant:0.3", **HALF}
MARKED = {**DOOR, "epsilon": "constant:0.1", "starts": "fixed", "move_success": 1}
"""So that a robot soon marks cells, and learns there."""

RUNS = {
    "coop": ("env1", {"steps": 120, **HALF}, {}, {}),
    "factored": ("env1", {"steps": 120, **HALF}, {"learner": "factored"}, {}),
    "crowd": ("crowd-3r", {"steps": 100, "peers": "all", **HALF}, {}, {}),
    "referee": ("crowd-3r", {"steps": 100, **HALF}, {"learner": "factored"}, {}),
    "cq": ("door", {"steps": 500, **MARKED}, {"learner": "cq", "checkpoint": 170}, {}),
    "bodies": (
        *("env1", {"steps": 120, **HALF}, {"bodies": True, "slips": False}),
        {"failing": [(k, step) for k in (0, 1) for step in range(3, 130, 7)]},
    ),
    "stopped": ("env1", {"steps": 300, **HALF}, {}, {"stop": 110}),
    "unfinished": ("env1", {"steps": 120, **HALF}, {}, {"finish": False}),
    "resumed": ("env1", {"steps": 150, **HALF}, {}, {}),
    "live": ("env1", {"steps": 120, **OFTEN, **HALF}, {}, {}),
}
"""Recorded runs: scenario, settings, values of the run, and its events."""

HONEST = {name: {Outcome.IDENTICAL} for name in RUNS} | {
    "unfinished": {Outcome.UNDECIDED},
    "live": {
        Outcome.IDENTICAL,
        Outcome.NOTED,
    },  # what a busy machine loses is said again
}

FEW = 1
MANY = 100


@pytest.fixture(scope="session")
def bags(tmp_path_factory):
    """Return a function that records one of the runs and returns its bag."""
    known = {}

    def of(name):
        if name not in known:
            known[name] = read(recorded_bag(name, tmp_path_factory.mktemp(name)))
        return known[name]

    return of


def recorded_bag(name, folder):
    scenario, settings, values, options = RUNS[name]
    if name == "live":
        return live_bag(folder, scenario, settings, values)
    if scenario == "door":
        text = f"map: {{name: door, text: {AT_ZERO!r}}}\n".replace("'", '"')
        ends = "robots: {robot_1: {start: 1, goal: 2}, robot_2: {start: 2, goal: 1}}\n"
        (folder / "door.yaml").write_text(text + ends)
        scenario = str(folder / "door.yaml")
    values = {"checkpoint": 50, **values}
    run = recorded(
        folder, scenario, settings, values=values, identity="f00d", **options
    )
    if name != "resumed":
        return run.bag
    checkpoint = sorted(entry.step for entry in read_run(run.bag).all_tables)[2]
    return rolled_back(run, folder / "again", checkpoint, after=30)


def live_bag(folder, scenario, settings, values):
    """Record a live team; its bag contains all messages of the nodes."""
    changed = [f"{name}={value}" for name, value in settings.items()]
    team = {"scenario": scenario, "set": changed, "seed": 7, "checkpoint": 25, **values}
    team |= {"out": str(folder / "out"), "record": True, "claim_window": 0.0}
    with ros_context() as context:
        run_team(team, context=context)
    return folder / "out" / "bag"


def asked(name, bag, count, seed):
    """Return cases of a bag: so many of each way to forge one, four times as many drawn ones."""
    single = list(drawn(name, bag, seed, 4 * count))
    by_name = list(named(name, bag))
    return [
        *single,
        *random.Random(f"{name} {seed}").sample(by_name, min(count, len(by_name))),
        *everywhere(name, bag, seed, count),
        *pairs(single, seed, 1 + count // 2),
        *lost(name, bag, seed, 1 + count // 2),
        *cut_off(name, bag, seed, 1 + count // 2),
    ]


def in_words(found):
    return "\n".join(f"{said}: {case.run}, {case.forgeries}" for case, said in found)


def all_right(name, bag, cases, folder):
    """Check that `verify` is right about all cases of a bag; return their number."""
    real = [case for case in cases if forged(bag, case.forgeries) != bag]
    found = list(wrong(bag, real, folder))
    assert not found, f"{len(found)} of {len(real)}:\n{in_words(found)}"
    return len(real)


@pytest.mark.parametrize("name", RUNS)
def test_an_honest_log_is_identical(bags, tmp_path, name):
    assert outcome(write(bags(name), tmp_path / "bag")) in HONEST[name]


@pytest.mark.parametrize("name", RUNS)
def test_no_changed_claim_is_identical(bags, tmp_path, name):
    bag = bags(name)
    assert all_right(name, bag, asked(name, bag, FEW, 2), tmp_path) > 4 * FEW


@pytest.mark.long
@pytest.mark.parametrize("name", RUNS)
def test_no_changed_claim_of_any_kind_is_identical(bags, tmp_path, name):
    """In all more than 8,000: fields, messages, arrays, attachments and records of all kinds."""
    bag = bags(name)
    assert all_right(name, bag, asked(name, bag, MANY, 1), tmp_path) > MANY


def test_the_corpus_holds_each_operation(bags):
    """And expects that most cases are found."""
    cases = asked("crowd", bags("crowd"), 20, 1)
    operations = Counter(one.operation for case in cases for one in case.forgeries)
    assert set(operations) == {
        *("field", "message", "beside", "topic", "lost", "cut", "entry", "array"),
        *("attachment", "record", "setting", "text", "plan"),
    }
    strict = [case for case in cases if Outcome.IDENTICAL not in case.right]
    assert len(strict) > 0.8 * len(cases)


def test_a_case_that_is_wrong_is_told(bags, tmp_path):
    """The corpus itself can fail."""
    bag = bags("coop")
    [case] = drawn("coop", bag, 1, 1)
    false = Case("coop", (), frozenset({Outcome.DIFFERS}))
    [(told, said)] = wrong(
        bag, [case._replace(right=frozenset(Outcome)), false], tmp_path
    )
    assert (told, said) == (false, Outcome.IDENTICAL)
