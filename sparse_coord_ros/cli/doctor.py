# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord doctor`: is everything here that a run needs, and what to do where it is not."""

import argparse
import textwrap
from collections.abc import Iterator

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.doctor.findings import WRONG, Finding

UNWELL = 1
WIDTH = 100

EXAMPLE = "sparse_coord doctor"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        "--clean",
        action="store_true",
        help="first remove what killed processes with ROS left in shared memory",
    )
    shared.add_json(parser)


def execute(options: argparse.Namespace) -> int:
    """Run the verb; 1 where something is wrong."""
    found = []
    removed = _clean() if options.clean else None
    if removed is not None and not options.json:
        print(f"removed {removed} files from shared memory")
    for finding in findings():
        found.append(finding)
        if not options.json:
            _print(finding)
    wrong = sum(one.level == WRONG for one in found)
    if options.json:
        said = {"fine": not wrong, "findings": [one._asdict() for one in found]}
        shared.print_json(said if removed is None else {**said, "removed": removed})
    elif wrong:
        print(f"\n{wrong} thing{'s are' if wrong > 1 else ' is'} wrong")
    else:
        print("\nnothing is wrong")
    return UNWELL if wrong else 0


def findings() -> Iterator[Finding]:
    """Look at everything, one thing after the other."""
    from sparse_coord_ros.doctor import environment, installation, round_trip

    yield from installation.installation()
    yield from installation.compiler()
    yield from environment.discovery()
    yield from environment.shared_memory()
    yield from round_trip.findings()


def _clean() -> int:
    from sparse_coord_ros.nodes.shared_memory import remove_orphans

    return len(remove_orphans())


def _print(finding: Finding) -> None:
    start = f"{finding.level:<6} {finding.part}: "
    print(textwrap.fill(start + finding.text, WIDTH, subsequent_indent=" " * 7), flush=True)
    if finding.remedy:
        print(
            textwrap.fill(f"{'':<7}to do: {finding.remedy}", WIDTH, subsequent_indent=" " * 14),
            flush=True,
        )
