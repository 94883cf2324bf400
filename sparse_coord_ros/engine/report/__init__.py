# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Documents on results: the report on the experiments, and that on the protocol study."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from sparse_coord_ros.engine.experiments import Experiment
from sparse_coord_ros.engine.results import ConditionResult, Plan

__all__ = ["write_report"]


def write_report(
    directory: Path,
    plan: Plan,
    chosen: Sequence[Experiment],
    found: Mapping[str, ConditionResult],
) -> None:
    """Write tables, figures and `reproduction.md`; the same results give the same bytes.

    Args:
        directory: gets `reproduction.md` and the folders `tables` (NAME.md and NAME.csv of each
            experiment) and `figures` (PNG and SVG).
        plan: seed, runs and trials of every cell.
        chosen: the experiments, in the order in which they are to appear.
        found: result of every cell of these experiments, by the cell's id.
    """
    from sparse_coord_ros.engine.report.document import write_document  # needs Matplotlib

    write_document(directory, plan, chosen, found)
