# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Data frames, with one clear line if pandas is missing, and their display in notebooks."""

import html
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeAlias

from sparse_coord_ros.base.errors import RunError, needed

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd


Columns: TypeAlias = "Mapping[str, Sequence[object] | np.ndarray]"

MOST_ROWS = 12
"""Most shown rows of a table; of longer tables the middle is left out."""


def data_frame(columns: Columns) -> "pd.DataFrame":
    """Return a pandas data frame of columns of equal length.

    Raises:
        RunError: pandas is not installed.
    """
    with needed("a data frame needs pandas", "pip install pandas, or use the arrays"):
        import pandas
    return pandas.DataFrame(dict(columns))


def shown_as(head: str, columns: Columns, *, markup: bool = False) -> str:
    """Return a line and a short table below it; only the line if pandas is missing.

    Args:
        head: the line.
        columns: of equal length.
        markup: whether to return HTML, for notebooks.
    """
    how: dict[str, Any] = {
        "index": False,
        "max_rows": MOST_ROWS,
        "float_format": "{:.2f}".format,
    }
    parts = [f"<p>{html.escape(head)}</p>" if markup else head]
    with suppress(RunError):
        frame = data_frame(columns)
        parts.append(frame.to_html(**how) if markup else frame.to_string(**how))
    return "\n".join(parts)
