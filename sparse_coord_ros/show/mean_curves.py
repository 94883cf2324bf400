# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mean learning curves of several runs, with their standard errors as a band."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from sparse_coord_ros.base.palette import LINE_COLOURS
from sparse_coord_ros.show.charts import CURVE_LABELS, panel_grid


def curves_figure(curves: pd.DataFrame, names: Sequence[str], title: str) -> Figure:
    """Draw mean learning curves.

    Args:
        curves: as of `Runs.history`.
        names: the curves, a panel each.
        title: of the figure.
    """
    figure, panels = panel_grid(len(names), len(names))
    colour = LINE_COLOURS[0]
    figure.suptitle(title, fontsize=11)
    for axes, name in zip(panels, names, strict=True):
        mean = curves[name]
        error = curves[f"{name}_error"].fillna(0.0)
        axes.fill_between(
            curves["steps"], mean - error, mean + error, color=colour, alpha=0.25, lw=0
        )
        axes.plot(curves["steps"], mean, color=colour)
        axes.set_xlabel("learning steps")
        axes.set_ylabel(CURVE_LABELS[name])
        axes.grid(alpha=0.3)
    return figure
