# SPDX-License-Identifier: MIT
"""Landmarks that a detector recognised."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.measurements.motion import check_pose


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandmarkObservation:
    """Pose of one landmark seen from the sensor: ``T_sensor_landmark``, and how much it is worth."""

    id: str
    """The same for the same landmark at all times."""
    position_m: NDArray[np.float64]
    """float64 (3,), metres."""
    quat_xyzw: NDArray[np.float64]
    """float64 (4,)."""
    translation_weight: float = 1.0
    """Factor of the residual in metres; 0 where the position says nothing."""
    rotation_weight: float = 1.0
    """Factor of the residual in radians; 0 where the orientation says nothing."""

    def __post_init__(self) -> None:
        for weight in (self.translation_weight, self.rotation_weight):
            if not (math.isfinite(weight) and weight >= 0):
                raise DataError(f"landmark {self.id!r}: a weight of {weight:g}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Landmarks:
    """The landmarks that one sensor saw at one time; may be none."""

    stamp_ns: int
    frame_id: str
    """Frame of the sensor, in which the observations are."""
    observations: tuple[LandmarkObservation, ...]
    topic: str = ""

    def __post_init__(self) -> None:
        for seen in self.observations:
            check_pose(f"landmark {seen.id!r}", self.stamp_ns, seen.position_m, seen.quat_xyzw)
