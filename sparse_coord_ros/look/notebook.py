# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a notebook shows a run: what it is, its policy, and its learning curve."""

import html

from sparse_coord_ros.experiments.report.charts import embedded
from sparse_coord_ros.look.figures import runs_figure
from sparse_coord_ros.look.sources import Shown


def in_html(head: str, shown: Shown) -> str:
    """Return a line, and below it the pictures of a run, side by side: those that it has."""
    parts = [f"<p>{html.escape(head)}</p>", '<div style="display: flex; align-items: flex-start">']
    if shown.has("tables"):
        parts.append(embedded(runs_figure([shown], ["policy"]), "policy"))
    if shown.has("history") and shown.history.episodes:
        parts.append(embedded(runs_figure([shown], ["length"]), "learning curve"))
    return "\n".join([*parts, "</div>"])
