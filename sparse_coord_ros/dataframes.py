# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Data frames, with one clear line where pandas is missing."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sparse_coord_ros.errors import RunError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd


def data_frame(columns: "Mapping[str, Sequence[object] | np.ndarray]") -> "pd.DataFrame":
    """Return a pandas data frame of columns of equal length.

    Raises:
        RunError: pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise RunError(
            f"a data frame needs the Python package pandas ({error}): pip install pandas, or use "
            "the arrays"
        ) from None
    return pandas.DataFrame(dict(columns))
