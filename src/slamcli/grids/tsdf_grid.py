# SPDX-License-Identifier: MIT
"""The truncated signed distances of a 2D submap, Cartographer's second grid type."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class TsdfGrid:
    """Signed distances to the nearest surface, positive in front of it; ``[row, column]`` as in `OccupancyGrid`."""

    tsd: NDArray[np.uint16]
    """uint16 (H, W): 0 unknown; 1 to 32767 a distance from -truncation to +truncation, linear."""
    weights: NDArray[np.uint16]
    """uint16 (H, W): 0 unknown; 1 to 32767 a weight from 0 to `max_weight`, linear."""
    resolution_m: float
    origin: tuple[float, float]
    """x, y of the lower left corner of cell (0, 0), metres, in the trajectory's local frame."""
    truncation_distance_m: float
    max_weight: float
