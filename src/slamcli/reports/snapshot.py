# SPDX-License-Identifier: MIT
"""What a closed loop looks like at one moment, for drawing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CostPatch:
    """A costmap and where it lies in the map."""

    costs: NDArray[np.uint8]
    """uint8 (H, W), costmap_2d's costs; rows grow with y."""
    T_map_corner: Array
    """float64 (3,): pose in map of the lower left corner of cell (0, 0), its columns along x."""
    resolution_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """One moment; arrays are metres and radians in the map frame, N may be 0 everywhere."""

    time_s: float
    pose: Array
    """float64 (3,), where the robot truly is."""
    speed: Array
    """float64 (3,), its velocity in its own frame."""
    estimate: Array | None
    """float64 (3,), where its localiser thinks it is; None before its first word."""
    scan_m: Array
    """float64 (N, 2), where beams ended, seen from the estimate."""
    particles_m: Array
    """float64 (N, 2)."""
    patch: CostPatch | None
    """The local costmap."""
    plan_m: Array
    """float64 (N, 2)."""
    local_plan_m: Array
    """float64 (N, 2)."""
    people: Array
    """float64 (D, 5): x, y, radius, vx, vy."""
    goal: Array | None
    """float64 (3,)."""
    state: str
    """What move_base is doing."""
    map_number: int
    """Which of the maps was the newest."""
