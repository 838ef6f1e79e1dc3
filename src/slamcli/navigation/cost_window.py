# SPDX-License-Identifier: MIT
"""What planners see of a live costmap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CostWindow:
    """Costs around the robot at one moment, and the robot's outline; rows grow with y, columns with x, no rotation.

    `costs` is a view of what the costmap holds: it changes with the next update, so do not keep it.
    """

    costs: NDArray[np.uint8]
    """uint8 (H, W), C-contiguous: 0 free, 1 to 252 near obstacles, 253 within the inscribed radius, 254 obstacle, 255 unknown."""
    origin_m: tuple[float, float]
    """x, y of the lower left corner of cell (0, 0), metres, in `frame`."""
    resolution_m: float
    frame: str
    """odom for the local costmap, map for the global one."""
    footprint: NDArray[np.float64]
    """float64 (N, 2), N >= 3, metres, base frame: the padded outline of the robot."""
    inscribed_radius_m: float
    circumscribed_radius_m: float
