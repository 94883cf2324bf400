# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Data frames, with one clear line if pandas is missing."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

from sparse_coord_ros.base.errors import packages_needed

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd


Columns: TypeAlias = "Mapping[str, Sequence[object] | np.ndarray]"


def data_frame(columns: Columns) -> "pd.DataFrame":
    """Return a pandas data frame of columns of equal length.

    Raises:
        RunError: pandas is not installed.
    """
    with packages_needed():
        import pandas
    return pandas.DataFrame(dict(columns))
