# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compute the tables of docs/coordination.md, and write them into it.

`python -m tools.coordination --out coordination [STUDY ...]`, in a checkout. What the folder has
already is not computed again.
"""

import re
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from sparse_coord_ros.cli.computing import COMPUTING
from sparse_coord_ros.cli.options import add_options
from sparse_coord_ros.cli.verbs import Parser
from sparse_coord_ros.engine.cluster import cluster_at
from sparse_coord_ros.errors import EXIT_BAD_INPUT, SparseCoordError
from sparse_coord_ros.experiments.conditions import Condition
from sparse_coord_ros.experiments.runner import Computing, compute
from sparse_coord_ros.experiments.store import ConditionResult, Plan, open_results
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.plugins import allow_modules
from sparse_coord_ros.learn.learners import learner_of
from tools.coordination.studies import SEED, STUDIES, Found, Study

PAGE = Path(__file__).resolve().parents[2] / "docs" / "coordination.md"
NAMES = [study.name for study in STUDIES]


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, compute, write, and return the exit code."""
    parser = Parser(prog="python -m tools.coordination", description=__doc__)
    parser.add_argument("studies", nargs="*", metavar="STUDY", help=f"of {', '.join(NAMES)}")
    parser.add_argument("--out", type=Path, default=Path("coordination"), help="results directory")
    parser.add_argument("--page", type=Path, default=PAGE, help="the document with the tables")
    add_options(parser, COMPUTING)
    options = parser.parse_args(arguments)
    allow_modules("tools.coordination.rules")
    try:
        chosen = _chosen(options.studies)
        with cluster_at(options.scheduler) as cluster:
            for study in chosen:
                by = Computing(options.engine, options.jobs, cluster)
                table = study.table(finder(study, options.out, by))
                page = with_table(options.page.read_text("utf-8"), study, table)
                write_whole(options.page, page)
                print(table, flush=True)
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return 0


def _chosen(names: Sequence[str]) -> list[Study]:
    for name in names:
        if name not in NAMES:
            raise SparseCoordError(f"study {name!r}: allowed: {', '.join(NAMES)}")
    return [study for study in STUDIES if not names or study.name in names]


def finder(study: Study, out: Path, by: Computing) -> Found:
    """Return what computes a study's conditions, where they are not there yet.

    Args:
        study: the study.
        out: the results directory.
        by: engine, threads or cluster.
    """

    @cache
    def found(condition: Condition) -> ConditionResult:
        two = len(condition.scenario.robots) == 2
        exact = two and learner_of(condition.learner).compiled  # its trials are of no interest
        plan = Plan(SEED, study.runs[0], 2) if exact else Plan(SEED, study.runs[1], study.trials)
        with open_results(out / f"{plan.runs}-runs-{plan.trials}-trials", plan) as results:
            return compute([condition], plan, by, results=results, progress=_say)[condition.id]

    return found


def _say(name: str, done: int, total: int) -> None:
    print(f"\r{name} {done / max(total, 1):.0%}", end="\x1b[K", file=sys.stderr, flush=True)


def with_table(page: str, study: Study, table: str) -> str:
    """Return the document with a study's table between its marks.

    Raises:
        SparseCoordError: it has no such marks.
    """
    begin, end = f"<!-- table: {study.name} -->\n", "<!-- end of table -->"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if not pattern.search(page):
        raise SparseCoordError(f"document: no {begin.strip()} ... {end}; add them")
    return pattern.sub(lambda _: f"{begin}{table}{end}", page, count=1)


if __name__ == "__main__":
    sys.exit(main())
