# SPDX-License-Identifier: MIT
"""What a range sensor tells a costmap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Observation:
    """End points of beams in the frame of a costmap; costmap_2d's ``Observation``.

    `points` mark obstacles, `clear_points` end beams that saw nothing (inf, taken as range_max where ``inf_is_valid``): these only clear.
    """

    source: str
    """Name of the observation source (``laser_scan``)."""
    time_s: float
    origin: NDArray[np.float64]
    """float64 (3,): x, y, z of the sensor, metres."""
    points: NDArray[np.float64]
    """float64 (N, 3), metres."""
    clear_points: NDArray[np.float64]
    """float64 (M, 3), metres."""
