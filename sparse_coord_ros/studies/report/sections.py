# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The sections of the report: for each experiment the function of its data.

The function returns the experiment's table, the claims that it bears on, and the values for its
template in `templates`.
"""

from collections.abc import Callable, Mapping
from functools import partial

from sparse_coord_ros.studies.report.asking_sections import unseen, when, where
from sparse_coord_ros.studies.report.claims import Results, Section
from sparse_coord_ros.studies.report.paper_sections import figure4, returns, table2
from sparse_coord_ros.studies.report.setting_sections import (
    ask_cost,
    crowd,
    penalty100,
    perception,
    uneven,
)

SECTIONS: Mapping[str, Callable[[Results], Section]] = {
    "table1": partial(returns, "Table 1"),
    "table2": table2,
    "table3": partial(returns, "Table 3"),
    "figure4": figure4,
    "penalty100": penalty100,
    "ask_cost": ask_cost,
    "perception": perception,
    "uneven": uneven,
    "crowd": crowd,
    "where": where,
    "unseen": unseen,
    "when": when,
}
"""The data function of each experiment."""
