# SPDX-License-Identifier: MIT
"""Where on the earth a receiver was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GeoFix:
    """One fix of a satellite receiver (WGS 84).

    A receiver without a fix sends messages as well: `has_fix` is False then, and latitude and longitude may be NaN.
    """

    stamp_ns: int
    frame_id: str
    """Frame of the antenna."""
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    """Above the ellipsoid; NaN where the receiver does not tell it."""
    has_fix: bool = True
    covariance_m2: NDArray[np.float64] | None = None
    """float64 (3, 3), of east, north and up, or None where it is unknown."""
    topic: str = ""

    def __post_init__(self) -> None:
        on_earth = abs(self.latitude_deg) <= 90 and abs(self.longitude_deg) <= 360 and not abs(self.altitude_m) > 1e8
        if self.has_fix and not on_earth:
            raise DataError(
                f"fix at {self.stamp_ns} ns: latitude {self.latitude_deg:g}°, longitude {self.longitude_deg:g}°, "
                f"altitude {self.altitude_m:g} m"
            )
