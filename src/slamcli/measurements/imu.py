# SPDX-License-Identifier: MIT
"""One reading of an inertial measurement unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuSample:
    """Angular velocity and specific force in the IMU's frame (+9.8 m/s² up when at rest, REP 145)."""

    stamp_ns: int
    frame_id: str
    angular_rad_s: NDArray[np.float64]
    """float64 (3,)."""
    acceleration_m_s2: NDArray[np.float64]
    """float64 (3,)."""
    quat_xyzw: NDArray[np.float64] | None = None
    """float64 (4,), orientation where the device gives one (orientation_covariance[0] != -1), else None."""
    topic: str = ""
