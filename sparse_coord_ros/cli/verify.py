# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord verify`: compute a recorded run again and compare."""

import argparse
from collections.abc import Iterator

from sparse_coord_ros.cli.options import BAG, JSON, Option, tell

SHOWN = 10
CANNOT_TELL = 3
"""Exit code."""
NOT_COMPARED = (
    "diagnostics, /rosout, /parameter_events, claims, what else the bag holds; wall-clock stamps; "
    "the order of messages of different writers; how often status, markers and coordination maps "
    "come within an episode; the markers of a run with clock: none; fields that the team does not "
    "use (all: docs/log.md)"
)

COUNTS = {
    "left_out": "robots' steps without their action (left out by the world)",
    "unlearned": "transitions that robots say they have not learned from",
    "resets": "episodes begun early (reset, or nobody left to wait for)",
    "kept": "robots that kept what they had learned in place of a plan",
    "repeats": "messages said again after a silence",
}
"""What may come and is no fault; by the name in `Verification`."""

EXAMPLE = "sparse_coord verify runs/demo/bag"


OPTIONS = (
    BAG,
    Option("--all", bool, f"print all differences, not the first {SHOWN}"),
    JSON,
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb; 0: identical, 1: differs, 3: the log leaves it open."""
    from sparse_coord_ros.log.runlog import verify

    found = verify(options.bag)
    log = found.log
    facts = {name: one for name, one in vars(found).items() if name != "log"}
    facts |= {
        "bag": log.bag.path,
        "identical": found.same,
        "cannot_tell": found.cannot_tell,
    }
    facts |= {"rollbacks": log.tracks.rollbacks, "gaps": log.gaps, "losses": log.losses}
    shown = None if options.all else SHOWN
    tell(options, facts, *_account(found), *_outcome(found, shown))
    if found.cannot_tell:
        return CANNOT_TELL
    return 0 if found.same else 1


def _account(found) -> Iterator[str]:
    """Yield the lines that say which run it is, what was compared and what was out of the way."""
    log = found.log
    yield str(log.bag.path)
    if log.bag.damage is not None and not log.bag.gaps:
        yield f"damaged, but all is read: {log.bag.damage}"
    yield from (f"lost: {loss}" for loss in log.losses)
    yield (
        f"{log.run.scenario.name}, {log.run.learner}{', greedy' * log.run.greedy}, "
        f"seed {log.run.seed}, {len(log.names)} robots"
    )
    yield (
        f"computed again: {found.steps} steps of the world, {found.choices} actions, "
        f"{found.updates} updates, {found.tables} recorded tables"
    )
    counts = [(getattr(found, name), what) for name, what in COUNTS.items()]
    yield from (f"{count} {what}" for count, what in counts if count)
    if log.run.bodies:
        yield "the robots have bodies: where a move led is taken as the log says it"
    for stall in log.tracks.stalls:
        yield (
            f"the recorder stood still for {stall.seconds} s: messages from step {stall.step} on "
            "may be lost"
        )
    for back in log.tracks.rollbacks:
        yield (
            f"at step {back.until} the run went back to the checkpoint of step {back.step}; what "
            "it had done since is not compared"
        )
    if found.lost:
        copies = ", ".join(f"{count} of {topic}" for topic, count in found.lost.items())
        yield f"lost copies (of these topics only the last messages are kept): {copies}"
    if found.foreign:
        yield f"foreign messages: {found.foreign}, computation identical"


def _outcome(found, shown: int | None) -> Iterator[str]:
    """Yield the lines that say whether the run is identical, and what is not."""
    if found.same:
        yield "identical: every state, reward, percept, action and table is what it has to be"
        yield f"not compared: {NOT_COMPARED}"
        return
    yield from (f"broke off: {sentence}" for sentence in found.broke_off)
    word = "differs"
    odd = found.differences
    if found.cannot_tell:
        yield _verdict(found)
        word = "open"
        odd = found.open
    yield from found.not_computed
    yield from (f"{word}: {difference}" for difference in odd[:shown])
    if shown is not None and shown < len(odd):
        yield f"and {len(odd) - shown} more (--all)"


def _verdict(found) -> str:
    """Return what is said of a log that leaves a part open."""
    holes = [(first, last) for first, last in found.not_compared if last is not None]
    ends = [first for first, last in found.not_compared if last is None]
    if found.not_computed or not found.not_compared:
        text = "cannot tell all of the run; what the log does say of the rest is as it has to be"
    elif holes:
        text = "identical"
    elif ends[0] > 1:
        text = f"identical up to step {ends[0] - 1}"
    else:
        text = "no time step can be computed again"
    if holes:
        steps = ", ".join(f"{first} to {last}" for first, last in holes)
        text += f" but for steps {steps}, which are lost"
    return text + "".join(f"; cannot tell from step {end}" for end in ends)
