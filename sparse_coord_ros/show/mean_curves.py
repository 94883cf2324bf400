# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mean learning curves of several runs, with their standard errors as a band."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from sparse_coord_ros.show.charts import panel_grid

LABELS = {
    "returns": "return of a robot",
    "length": "steps of an episode",
    "miscoordinations": "miscoordinations\nof an episode",
    "asks": "questions of a robot\nin an episode",
    "arrived": "share of the robots\nthat arrive",
}
"""The labels of the vertical axes."""

COLOUR = "#0072B2"


def curves_figure(curves: pd.DataFrame, names: Sequence[str], title: str) -> Figure:
    """Draw mean learning curves.

    Args:
        curves: as of `Runs.history`.
        names: the curves, a panel each.
        title: of the figure.
    """
    figure, panels = panel_grid(len(names), len(names))
    figure.suptitle(title, fontsize=11)
    for axes, name in zip(panels, names, strict=True):
        mean = curves[name]
        error = curves[f"{name}_error"].fillna(0.0)
        axes.fill_between(
            curves["steps"], mean - error, mean + error, color=COLOUR, alpha=0.25, lw=0
        )
        axes.plot(curves["steps"], mean, color=COLOUR)
        axes.set_xlabel("learning steps")
        axes.set_ylabel(LABELS[name])
        axes.grid(alpha=0.3)
    return figure
