# SPDX-License-Identifier: MIT
"""Few key points out of many, evenly spread: suppression via square covering.

O. Bailo et al., "Efficient adaptive non-maximal suppression algorithms for homogeneous spatial keypoint distribution", Pattern
Recognition Letters 106, 2018, doi:10.1016/j.patrec.2018.02.020.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_TOLERANCE = 0.1


def spread_evenly(pixels: NDArray[np.float64], number: int, width: int, height: int) -> NDArray[np.int64]:
    """Return the rows, increasing, of about `number` of the pixels (N, 2), given strongest first; all where there are no more.

    The side of the squares that each chosen point keeps free is found by bisection, so that the number is met to a tenth, or as well as
    whole pixels allow.
    """
    if len(pixels) <= number:
        return np.arange(len(pixels))
    low, high = 1, max(width, height)
    best = np.arange(number)
    while low <= high:
        side = (low + high) // 2
        kept = _covered(pixels, side, width, height)
        if len(kept) >= number:
            best, low = kept, side + 1
            if len(kept) <= number * (1.0 + _TOLERANCE):
                break
        else:
            high = side - 1
    return best[:number]


def _covered(pixels: NDArray[np.float64], side: int, width: int, height: int) -> NDArray[np.int64]:
    """The points that no stronger one's square covers; cells are half as wide as a square."""
    cell = side / 2.0
    columns = np.clip((pixels[:, 0] / cell).astype(np.int64), 0, int(width / cell))
    rows = np.clip((pixels[:, 1] / cell).astype(np.int64), 0, int(height / cell))
    taken = np.zeros((int(height / cell) + 3, int(width / cell) + 3), dtype=np.bool_)
    kept = []
    for index, (column, row) in enumerate(zip(columns.tolist(), rows.tolist(), strict=True)):
        if not taken[row + 1, column + 1]:
            kept.append(index)
            taken[row : row + 3, column : column + 3] = True
    return np.array(kept, dtype=np.int64)
