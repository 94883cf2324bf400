# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a notebook shows a run: what it is, its policy, and its learning curve."""

import base64
import html

from sparse_coord_ros.experiments.report.charts import rendered
from sparse_coord_ros.look.figures import runs_figure
from sparse_coord_ros.look.sources import Shown

WIDTH = 46
"""Per cent of the page that a picture may take."""


def in_html(head: str, shown: Shown) -> str:
    """Return a line, and below it the pictures of a run, side by side: those that it has."""
    parts = [f"<p>{html.escape(head)}</p>"]
    if shown.has("tables"):
        parts.append(_picture(shown, "policy"))
    if shown.has("history") and shown.history.episodes:
        parts.append(_picture(shown, "length"))
    return "\n".join(parts)


def _picture(shown: Shown, what: str) -> str:
    data = base64.b64encode(rendered(runs_figure([shown], [what]), "png", few=True)).decode()
    style = f"display: inline-block; max-width: {WIDTH}%; vertical-align: top"
    return f'<img alt="{what}" style="{style}" src="data:image/png;base64,{data}">'
