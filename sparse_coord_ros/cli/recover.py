# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord recover`: a whole bag from one that a crash or a bad disk has damaged."""

import argparse
from collections.abc import Iterator

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.log.bags.gaps import gap_lines
from sparse_coord_ros.log.bags.recover import Recovery, recover

EXIT_LOST = 1
"""Exit code if a part of the original could not be restored."""

EXAMPLE = (
    "sparse_coord recover runs/demo/bag\n\n"
    "exit codes: 0 the bag was whole, or everything is restored; 1 restored, but a part is lost;\n"
    "2 nothing can be read, or the result cannot be written"
)


OPTIONS = (shared.BAG, shared.JSON)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    recovery = recover(options.bag)
    shared.tell(options, _facts(recovery), *_lines(recovery))
    return 0 if recovery.bag.whole and not recovery.bag.gaps else EXIT_LOST


def _lines(recovery: Recovery) -> Iterator[str]:
    bag = recovery.bag
    content = (
        f"{bag.message_count} messages of {len(bag.topics)} topics, "
        f"{len(bag.attachments)} attachments, {(bag.end_ns - bag.start_ns) / 1e9:.1f} s"
    )
    again = " again" if recovery.changed else ""
    now = f"is whole{again}" if bag.whole else "holds what could be read"
    yield f"{recovery.path} {now}: {content}"
    if bag.recovered is not None:
        yield f"{'before, it was ' * recovery.changed}recovered from a broken bag"
    yield from gap_lines(bag.gaps)
    if bag.damage is not None and (bag.whole or not bag.lost_bytes):
        yield f"damage at {bag.damage}"
    if not bag.whole and not bag.gaps:
        yield "every message is there, but metadata may be wrong"
    if recovery.kept is not None:
        yield f"the original is {recovery.kept}"


def _facts(recovery: Recovery) -> dict:
    bag = recovery.bag
    return {
        **{
            name: getattr(bag, name)
            for name in ("damage", "lost_bytes", "gaps", "recovered")
        },
        "bag": recovery.path,
        "changed": recovery.changed,
        "complete": bag.whole,
        "messages": bag.message_count,
        "topics": len(bag.topics),
        "attachments": len(bag.attachments),
        "original": recovery.kept,
    }
