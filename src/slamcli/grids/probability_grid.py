# SPDX-License-Identifier: MIT
"""The occupancy probabilities of a 2D submap, updated by odds (Hess et al., ICRA 2016, IV-B)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class ProbabilityGrid:
    """Correspondence costs (1 - probability) of square cells; ``cells[row, column]`` as in `OccupancyGrid`."""

    cells: NDArray[np.uint16]
    """uint16 (H, W): 0 unknown; 1 to 32767 a cost from 0.1 to 0.9, linear (as Cartographer stores it)."""
    resolution_m: float
    origin: tuple[float, float]
    """x, y of the lower left corner of cell (0, 0), metres, in the trajectory's local frame."""

    MIN_COST: ClassVar[float] = 0.1
    MAX_COST: ClassVar[float] = 0.9

    def probabilities(self) -> NDArray[np.float32]:
        """Return float32 (H, W), the probability that a cell is occupied; NaN where unknown."""
        scale = (self.MAX_COST - self.MIN_COST) / 32766.0
        cost = (self.cells.astype(np.float32) - 1.0) * np.float32(scale) + np.float32(self.MIN_COST)
        return np.where(self.cells == 0, np.float32(np.nan), np.float32(1.0) - cost)
