# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord verify`: compute a recorded run again and compare."""

import argparse
from collections.abc import Iterator

from sparse_coord_ros.cli.computing import Bar, read_bag
from sparse_coord_ros.cli.options import ALLOW, BAG, JSON, tell

UNDECIDED = 3
"""Exit code."""
NOT_COMPARED = (
    "map, markers, coordination maps, clock, status, diagnostics and other "
    "topics; wall-clock stamps; the order of messages of different topics "
    "(all: docs/recordings.md)"
)

EXAMPLE = "sparse_coord verify runs/demo/bag"


OPTIONS = (BAG, ALLOW, JSON)


def execute(options: argparse.Namespace) -> int:
    """Run the verb; 0: identical, 1: differs, 3: undecided."""
    from sparse_coord_ros.log.runlog.verify import verify_log

    log = read_bag(options.bag, quiet=options.json)
    with Bar("steps", "computing the run again", quiet=options.json) as bar:
        verification = verify_log(log, bar.show)
    facts = {name: value for name, value in vars(verification).items() if name != "log"}
    facts["bag"] = log.path
    facts["step"] = verification.first and log.made_before(verification.first.step)
    facts["identical"] = verification.same
    facts["segments"] = log.segments
    facts["damage"] = log.damage
    tell(options, facts, *_account(verification), *_answer(verification))
    if verification.undecided is not None:
        return UNDECIDED
    return 0 if verification.same else 1


def _account(verification) -> Iterator[str]:
    """Yield the lines on the run, the amount of computation, and the notes."""
    log = verification.log
    yield str(log.path)
    if log.damage is not None:
        yield log.damage
    learner = f"{log.run.learner}, greedy" if log.run.greedy else log.run.learner
    yield (
        f"{log.run.scenario.name}, {learner}, seed {log.run.seed}, "
        f"{len(log.names)} robots"
    )
    yield (
        f"computed again: {verification.steps} steps of the world, "
        f"{verification.choices} actions, {verification.updates} updates, "
        f"{verification.tables} recorded tables"
    )
    for name, count in verification.notes.items():
        yield f"{name}: {count}"
    if log.run.bodies:
        yield "the robots have bodies: the result of each move is taken from the log"
    for number, (file, step) in enumerate(zip(log.files, log.segments, strict=True)):
        if number and step:
            yield f"{file}: goes on from the checkpoint of step {log.made_before(step)}"


def _answer(verification) -> Iterator[str]:
    """Yield the lines of the result: identical, differs, or undecided."""
    if verification.same:
        yield "identical: every state, reward, percept, action and table agrees"
        yield f"not compared: {NOT_COMPARED}"
        return
    step = verification.log.made_before(verification.first.step)
    if verification.difference is not None:
        yield f"differs at step {step}: {verification.difference}"
    else:
        yield f"undecided from step {step} on: {verification.undecided.why}"
