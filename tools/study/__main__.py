# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compute tables of pages in docs, and write them there: `python -m tools.study --out DIR STUDY`.

In a checkout. What the folder has already is not computed again.
"""

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from sparse_coord_ros.base.errors import EXIT_BAD_INPUT, SparseCoordError
from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.cli.computing import COMPUTING
from sparse_coord_ros.cli.options import add_options, note
from sparse_coord_ros.cli.verbs import Parser
from sparse_coord_ros.core.engine.cluster import cluster_at
from sparse_coord_ros.core.game.plugins import allow_modules
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.conditions import Condition
from sparse_coord_ros.studies.runner import Computing, compute
from sparse_coord_ros.studies.store import Plan, open_results
from tools.study import (
    advised,
    central,
    coordination,
    kinds,
    known_map,
    outsiders,
    related,
    rules,
)
from tools.study.coordination import Study

DOCS = Path(__file__).resolve().parents[2] / "docs"
STUDIES: dict[str, Study] = {
    one.name: one
    for one in (
        *coordination.STUDIES,
        *related.STUDIES,
        *known_map.STUDIES,
        *outsiders.STUDIES,
        *kinds.STUDIES,
        *advised.STUDIES,
        *central.STUDIES,
    )
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, compute, write, and return the exit code."""
    parser = Parser(prog="python -m tools.study", description=__doc__)
    parser.add_argument(
        "studies", nargs="*", metavar="STUDY", help=f"of {', '.join(STUDIES)}"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("study"), help="results directory"
    )
    add_options(parser, COMPUTING)
    options = parser.parse_args(arguments)
    allow_modules(rules.__name__)
    try:
        for name in options.studies:
            if name not in STUDIES:
                raise SparseCoordError(f"study {name!r}: allowed: {', '.join(STUDIES)}")
        with cluster_at(options.scheduler) as cluster:
            by = Computing(options.engine, options.jobs, cluster)
            for name in options.studies or STUDIES:
                text = STUDIES[name].text(computing(options.out, by), options.out)
                page = DOCS / STUDIES[name].page
                write_whole(page, with_text(page.read_text("utf-8"), name, text))
                print(text, flush=True)
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return 0


def computing(out: Path, by: Computing) -> Callable[[Condition, Plan], ConditionResult]:
    """Return a function that computes the missing conditions.

    Args:
        out: the results directory.
        by: engine, threads or cluster.
    """

    def computed(condition: Condition, plan: Plan) -> ConditionResult:
        folder = f"{plan.runs}-runs-{plan.trials}-trials-from-{plan.seed}"
        with open_results(out / folder, plan, note) as results:
            return compute([condition], plan, by, results=results, progress=_say)[
                condition.id
            ]

    return computed


def _say(name: str, done: int, total: int) -> None:
    print(
        f"\r{name} {percent(done / max(total, 1), whole=True)}",
        end="\x1b[K",
        file=sys.stderr,
        flush=True,
    )


def with_text(page: str, mark: str, text: str) -> str:
    """Return a document with a text between its marks.

    Raises:
        SparseCoordError: it has no such marks.
    """
    begin = f"<!-- table: {mark} -->\n"
    end = "<!-- end of table -->"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if not pattern.search(page):
        raise SparseCoordError(f"document: no {begin.strip()} ... {end}; add them")
    return pattern.sub(lambda _: f"{begin}{text}{end}", page)


if __name__ == "__main__":
    sys.exit(main())
