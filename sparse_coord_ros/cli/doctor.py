# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord doctor`: check the requirements of a run, and suggest fixes."""

import argparse
import textwrap
from collections.abc import Iterator

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.ros.doctor import checks
from sparse_coord_ros.ros.doctor.checks import WRONG, Finding

UNWELL = 1
WIDTH = 100

EXAMPLE = "sparse_coord doctor"


OPTIONS = (shared.JSON,)


def execute(options: argparse.Namespace) -> int:
    """Run the verb; 1 if a check fails."""
    results = []
    for finding in findings():
        results.append(finding)
        if not options.json:
            _print(finding)
    fine = all(finding.level != WRONG for finding in results)
    line = f"\n{'nothing' if fine else 'something'} is wrong"
    shared.tell(options, {"fine": fine, "findings": results}, line)
    return 0 if fine else UNWELL


def findings() -> Iterator[Finding]:
    """Yield the results of all checks, one after the other."""
    from sparse_coord_ros.ros.doctor import round_trip

    yield checks.installation()
    yield checks.compiler()
    yield from checks.discovery()
    yield from round_trip.findings()


def _print(finding: Finding) -> None:
    lines = [f"{finding.level:<6} {finding.part}: {finding.text}"]
    lines += [f"       to do: {finding.remedy}"] if finding.remedy else []
    for line in lines:
        print(textwrap.fill(line, WIDTH, subsequent_indent=" " * 7), flush=True)
