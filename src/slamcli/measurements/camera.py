# SPDX-License-Identifier: MIT
"""A camera's calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraModel:
    """Intrinsics, distortion and rectification as sensor_msgs/CameraInfo holds them."""

    stamp_ns: int
    frame_id: str
    width: int
    height: int
    distortion_model: str
    """plumb_bob, rational_polynomial, equidistant or empty."""
    distortion: NDArray[np.float64]
    """float64 (K,), in the order of the model."""
    intrinsics: NDArray[np.float64]
    """float64 (3, 3), K of the raw image, pixels."""
    rectification: NDArray[np.float64]
    """float64 (3, 3), R."""
    projection: NDArray[np.float64]
    """float64 (3, 4), P of the rectified image, pixels; ``P[0, 3] = -fx * baseline`` for a right camera."""
    topic: str = ""
