# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Q^C over many joint states: rows for visited joint states only.

"Our matrix Q^C_k will be sparse" (paper, Section 3.2): with n agents on m cells a dense table has
m^n rows, a sparse one as many as COORDINATE has met.
"""

from typing import Any

import numpy as np

from sparse_coord_ros.game.actions import PRIMITIVES


class SparseTable:
    """A table that reads like an array of shape `shape`, float64, with few rows.

    `table[cell, *peer_cells]` is the row of a joint state, `table[cell, *peer_cells, action]` an
    entry of it; a joint state without a row reads as `unseen`. Only entries are set.

    Args:
        cells: free cells of the map.
        agents: how many local states a joint state has.
        unseen: value of every entry that was never set.
        keys: joint states that have rows, integers, shape (rows, agents), each once.
        rows: their entries, shape (rows, 4), float64; the table keeps a copy.
    """

    def __init__(
        self,
        cells: int,
        agents: int,
        unseen: float,
        keys: np.ndarray | None = None,
        rows: np.ndarray | None = None,
    ) -> None:
        self.shape = (cells,) * agents + (PRIMITIVES,)
        self.unseen = float(unseen)
        self._agents = agents
        self._nothing = np.full(PRIMITIVES, self.unseen)
        self._nothing.flags.writeable = False
        self._rows: dict[tuple[int, ...], np.ndarray] = {}
        if keys is not None and rows is not None:
            self._rows = dict(zip(map(tuple, keys.tolist()), rows.copy(), strict=True))

    def __len__(self) -> int:
        """Return the number of joint states that have a row."""
        return len(self._rows)

    def __getitem__(self, index: tuple[int, ...]) -> Any:
        """Return the row of a joint state (not to be written to), or one entry of it."""
        row = self._rows.get(index[: self._agents], self._nothing)
        return row if len(index) == self._agents else row[index[self._agents]]

    def __setitem__(self, entry: tuple[int, ...], value: float) -> None:
        """Set one entry; the others of a new row are `unseen`."""
        *joint_state, action = entry
        self._rows.setdefault(tuple(joint_state), self._nothing.copy())[action] = value

    @property
    def keys(self) -> np.ndarray:
        """The joint states that have rows, in ascending order: shape (rows, agents), int32."""
        return np.array(sorted(self._rows), dtype=np.int32).reshape(len(self), self._agents)

    @property
    def rows(self) -> np.ndarray:
        """The entries of `keys`, in the same order: shape (rows, 4), float64; a copy."""
        return np.array([self._rows[key] for key in sorted(self._rows)]).reshape(-1, PRIMITIVES)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return the table as an array of its shape; of few agents, or memory will not do."""
        array = np.full(self.shape, self.unseen)
        array[tuple(self.keys.T)] = self.rows
        return array

    @property
    def nbytes(self) -> int:
        """Bytes of `keys` and `rows`; what finds a row in memory comes on top."""
        return self.keys.nbytes + self.rows.nbytes
