# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord verify`: compute a recorded run again and compare."""

import argparse
from collections.abc import Iterator

from sparse_coord_ros.cli.options import ALLOW, BAG, JSON, Option, tell

SHOWN = 10
UNDECIDED = 3
"""Exit code."""
NOT_COMPARED = (
    "diagnostics, /rosout, /parameter_events and other topics; wall-clock stamps; "
    "the order of messages of different writers; how often status, markers and coordination maps "
    "come within an episode; the markers of a run with clock: none; fields that the team does not "
    "use (all: docs/log.md)"
)

EXAMPLE = "sparse_coord verify runs/demo/bag"


OPTIONS = (
    BAG,
    Option("--all", bool, f"print all differences, not the first {SHOWN}"),
    ALLOW,
    JSON,
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb; 0: identical, 1: differs, 3: undecided."""
    from sparse_coord_ros.log.runlog import verify

    found = verify(options.bag)
    log = found.log
    facts = {name: value for name, value in vars(found).items() if name != "log"}
    facts["bag"] = log.bag.path
    facts["identical"] = found.same
    facts["undecided"] = found.undecided
    facts["rollbacks"] = log.messages.rollbacks
    facts["gaps"] = log.gaps
    facts["losses"] = log.losses
    shown = None if options.all else SHOWN
    tell(options, facts, *_account(found), *_answer(found, shown))
    if found.undecided:
        return UNDECIDED
    return 0 if found.same else 1


def _account(found) -> Iterator[str]:
    """Yield the lines on the run, the amount of computation, and the notes."""
    log = found.log
    yield str(log.bag.path)
    if log.bag.damage is not None and not log.bag.gaps:
        yield f"damaged, but all is read: {log.bag.damage}"
    for loss in log.losses:
        yield f"lost: {loss}"
    learner = f"{log.run.learner}, greedy" if log.run.greedy else log.run.learner
    yield (
        f"{log.run.scenario.name}, {learner}, seed {log.run.seed}, "
        f"{len(log.names)} robots"
    )
    yield (
        f"computed again: {found.steps} steps of the world, {found.choices} actions, "
        f"{found.updates} updates, {found.tables} recorded tables"
    )
    for name, count in found.notes.items():
        yield f"{name}: {count}"
    if log.run.bodies:
        yield "the robots have bodies: the result of each move is taken from the log"
    for stall in log.messages.stalls:
        yield (
            f"the recorder stood still for {stall.seconds} s: messages from time step "
            f"{stall.step} on may be lost"
        )
    for back in log.messages.rollbacks:
        yield (
            f"at time step {back.until} the run went back to the checkpoint of time step "
            f"{back.step}; the time steps between are not compared"
        )


def _answer(found, shown: int | None) -> Iterator[str]:
    """Yield the lines of the result: identical, differs, or undecided."""
    if found.same:
        yield "identical: every state, reward, percept, action and table agrees"
        yield f"not compared: {NOT_COMPARED}"
        return
    for difference in found.differences[:shown]:
        yield f"differs: {difference}"
    if shown is not None and shown < len(found.differences):
        yield f"and {len(found.differences) - shown} more (--all)"
    if found.differences:
        for message in found.log.messages.foreign[:shown]:
            yield f"foreign: {message}"
    for unknown in found.unknown[:shown]:
        yield f"undecided {unknown}"
    if shown is not None and shown < len(found.unknown):
        yield f"and {len(found.unknown) - shown} more (--all)"
    if found.undecided and found.steps:
        yield "all else is identical"
