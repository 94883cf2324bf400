# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Active-perception models: whether the percept of COORDINATE succeeds (paper, Section 3.2).

"Whether or not it actually succeeds is environment-dependent." A model is a matrix of success
probabilities over the asker's and the asked robot's cells; the percept succeeds when the draw of
(asker, step) lies below the entry. A new model is one function in `MODELS` and its numbers in
`PERCEPTION`.
"""

from collections.abc import Callable

import numpy as np

from sparse_coord_ros.core.grid import GridMap
from sparse_coord_ros.core.specs import Number, Spec, SpecFamily

PERCEPTION = SpecFamily(
    "perception",
    {
        "always": (),
        "never": (),
        "probability": (Number("p", 0.0, 1.0),),
        "line_of_sight": (),
        "range": (Number("cells", 0.0),),
    },
)
"""The perception models that a scenario can name."""


def percept_probabilities(model: Spec, grid: GridMap) -> np.ndarray:
    """Return the success probability of a percept.

    Args:
        model: one of the kinds of `PERCEPTION`.
        grid: the map.

    Returns:
        Shape (cells, cells), float64 in [0, 1]: first index the asker's cell, second the asked
        robot's cell.
    """
    return MODELS[model.kind](grid, *model.numbers)


def _constant(p: float) -> Callable[[GridMap], np.ndarray]:
    return lambda grid: np.full((len(grid.cells), len(grid.cells)), p)


def _probability(grid: GridMap, p: float) -> np.ndarray:
    return _constant(p)(grid)


def _range(grid: GridMap, reach: float) -> np.ndarray:
    """Succeed within `reach` cells, measured straight between the cells' centres."""
    centres = np.array(grid.cells, dtype=float)
    gap = centres[:, None, :] - centres[None, :, :]
    return (np.hypot(gap[..., 0], gap[..., 1]) <= reach).astype(float)


def _line_of_sight(grid: GridMap) -> np.ndarray:
    """Succeed where the straight line between the cells' centres crosses no wall."""
    cells = grid.cells
    seen = np.zeros((len(cells), len(cells)))
    for x, here in enumerate(cells):
        for y in range(x, len(cells)):
            seen[x, y] = seen[y, x] = _sees(grid, here, cells[y])
    return seen


def _sees(grid: GridMap, here: tuple[int, int], there: tuple[int, int]) -> bool:
    """Walk the line in exact integer steps through every cell whose inside it crosses.

    A line through a corner point of four cells passes when one of the two cells beside the
    corner is free.
    """
    (r, c), (end_r, end_c) = here, there
    rows, columns = abs(end_r - r), abs(end_c - c)
    step_r, step_c = (1 if end_r > r else -1), (1 if end_c > c else -1)
    # Twice the (signed) distance to the next row border against that to the next column border.
    error = columns - rows
    while (r, c) != (end_r, end_c):
        if error == 0:
            beside = ((r + step_r, c), (r, c + step_c))
            if not any(cell in grid.number for cell in beside):
                return False
            r, c = r + step_r, c + step_c
            error += 2 * (columns - rows)
        elif error > 0:
            c += step_c
            error -= 2 * rows
        else:
            r += step_r
            error += 2 * columns
        if (r, c) not in grid.number:
            return False
    return True


MODELS: dict[str, Callable[..., np.ndarray]] = {
    "always": _constant(1.0),
    "never": _constant(0.0),
    "probability": _probability,
    "line_of_sight": _line_of_sight,
    "range": _range,
}
