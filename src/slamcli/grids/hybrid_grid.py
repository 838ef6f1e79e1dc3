# SPDX-License-Identifier: MIT
"""The occupancy probabilities of a 3D submap: a sparse grid of cubic cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class HybridGrid:
    """Probabilities of the known cells; cell (x, y, z) is centred on that multiple of the resolution (Cartographer's rule)."""

    indices: NDArray[np.int32]
    """int32 (N, 3), x, y, z of known cells, sorted lexicographically."""
    values: NDArray[np.uint16]
    """uint16 (N,): 1 to 32767, a probability from 0.1 to 0.9, linear."""
    resolution_m: float
