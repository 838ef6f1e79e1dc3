# SPDX-License-Identifier: MIT
"""One sweep of a planar laser scanner."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaserScan:
    """One sweep of a planar laser scanner in polar coordinates of its own frame.

    Beam i points to ``angle_min_rad + i * angle_increment_rad`` (counter-clockwise about z; a negative increment is a
    clockwise scanner) and was measured at ``stamp_ns + i * time_increment_s``. Readings follow REP 117: +inf is
    "nothing within range", NaN is "no answer", -inf is "too close to measure".
    """

    stamp_ns: int
    frame_id: str
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    ranges_m: NDArray[np.float32]
    """float32 (N,), metres along each beam."""
    time_increment_s: float = 0.0
    scan_time_s: float = 0.0
    intensities: NDArray[np.float32] | None = None
    """float32 (N,) or None."""
    topic: str = ""

    def __post_init__(self) -> None:
        if self.ranges_m.ndim != 1:
            raise DataError(f"laser scan at {self.stamp_ns} ns: ranges have shape {self.ranges_m.shape}, not (N,)")
        if not (math.isfinite(self.angle_min_rad) and math.isfinite(self.angle_increment_rad)):
            raise DataError(f"laser scan at {self.stamp_ns} ns: angle_min or angle_increment is not a finite number")
        if self.angle_increment_rad == 0.0 and self.ranges_m.size > 1:
            raise DataError(f"laser scan at {self.stamp_ns} ns: angle_increment is 0 for {self.ranges_m.size} beams")

    @property
    def num_beams(self) -> int:
        """Number of beams N."""
        return int(self.ranges_m.size)

    @property
    def angles_rad(self) -> NDArray[np.float64]:
        """float64 (N,), direction of each beam in the scanner's frame."""
        return self.angle_min_rad + np.arange(self.ranges_m.size, dtype=np.float64) * self.angle_increment_rad
