# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord verify`: compute a recorded run again and compare."""

import argparse

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.cli.options import Option

SHOWN = 10
CANNOT_TELL = 3
"""Exit code."""
NOT_COMPARED = (
    "diagnostics, /rosout, /parameter_events, claims, what else the bag holds; wall-clock stamps; "
    "the order of messages of different writers; how often status, markers and coordination maps "
    "come within an episode; fields that the team does not use (all: docs/log.md)"
)

EXAMPLE = "sparse_coord verify runs/demo/bag"


OPTIONS = (
    shared.BAG,
    Option("--all", bool, f"print all differences, not the first {SHOWN}"),
    shared.JSON,
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb; 0: identical, 1: differs, 3: the log leaves it open."""
    from sparse_coord_ros.runlog import verify

    found = verify(options.bag)
    if options.json:
        shared.print_json(
            {
                "bag": found.log.bag.path,
                "identical": found.same,
                "cannot_tell": found.cannot_tell,
                **{name: value for name, value in vars(found).items() if name != "log"},
                "rollbacks": found.log.tracks.rollbacks,
                "gaps": found.log.gaps,
                "losses": found.log.losses,
            }
        )
    else:
        _print(found, None if options.all else SHOWN)
    if found.cannot_tell:
        return CANNOT_TELL
    return 0 if found.same else 1


def _print(found, shown: int | None) -> None:
    run = found.log.run
    print(found.log.bag.path)
    if found.log.bag.damage is not None and not found.log.bag.gaps:
        print(f"damaged, but all is read: {found.log.bag.damage}")
    for loss in found.log.losses:
        print(f"lost: {loss}")
    print(
        f"{run.scenario.name}, {run.learner}{', greedy' * run.greedy}, "
        f"seed {run.seed}, {len(found.log.names)} robots"
    )
    print(
        f"computed again: {found.steps} steps of the world, {found.choices} actions, "
        f"{found.updates} updates, {found.tables} recorded tables"
    )
    for count, what in (
        (found.left_out, "robots' steps without their action (left out by the world)"),
        (found.unlearned, "transitions that robots say they have not learned from"),
        (found.resets, "episodes begun early (reset, or nobody left to wait for)"),
        (found.repeats, "messages said again after a silence"),
    ):
        if count:
            print(f"{count} {what}")
    for back in found.log.tracks.rollbacks:
        print(
            f"at step {back.until} the run went back to the checkpoint of step {back.step}; what "
            "it had done since is not compared"
        )
    if found.lost:
        copies = ", ".join(f"{count} of {topic}" for topic, count in found.lost.items())
        print(f"lost copies (of these topics only the last messages are kept): {copies}")
    if found.foreign:
        print(f"foreign messages: {found.foreign}, computation identical")
    if found.same:
        print("identical: every state, reward, percept, action and table is what it has to be")
        print(f"not compared: {NOT_COMPARED}")
        return
    for sentence in found.broke_off:
        print(f"broke off: {sentence}")
    if found.cannot_tell:
        print(_verdict(found))
    for sentence in found.not_computed:
        print(sentence)
    if found.cannot_tell:
        for difference in found.open[:shown]:
            print(f"open: {difference}")
        return
    for difference in found.differences[:shown]:
        print(f"differs: {difference}")
    more = len(found.differences[shown:]) if shown else 0
    if more:
        print(f"and {more} more (--all)")


def _verdict(found) -> str:
    """Return what is said of a log that leaves a part open."""
    holes = [(first, last) for first, last in found.not_compared if last is not None]
    ends = [first for first, last in found.not_compared if last is None]
    if found.not_computed or not found.not_compared:
        text = "cannot tell all of the run; what the log does say of the rest is as it has to be"
    elif holes:
        text = "identical"
    else:
        text = f"identical up to step {ends[0] - 1}"
    if holes:
        steps = ", ".join(f"{first} to {last}" for first, last in holes)
        text += f" but for steps {steps}, which are lost"
    return text + "".join(f"; cannot tell from step {end}" for end in ends)
