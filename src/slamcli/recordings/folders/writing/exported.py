# SPDX-License-Identifier: MIT
"""What is written to a data-set folder, once its images lie in it: stamps, calibration, readings, true poses."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import CameraModel, ImuNoise
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory


def _identity() -> NDArray[np.float64]:
    return np.eye(4)


@dataclass(slots=True, kw_only=True, eq=False)
class ExportedCamera:
    """One camera and its images."""

    folder: str
    """Where its images lie, from the target's root."""
    is_colour: bool
    model: CameraModel | None
    T_body_camera: NDArray[np.float64] = field(default_factory=_identity)
    """float64 (4, 4), in the frame that the true poses are of."""
    frames: list[tuple[int, str]] = field(default_factory=list)
    """Stamp in nanoseconds and name of each file, in the order of the recording."""


@dataclass(slots=True, kw_only=True, eq=False)
class ExportedImu:
    """Readings of an IMU."""

    T_body_imu: NDArray[np.float64] = field(default_factory=_identity)
    noise: ImuNoise | None = None
    stamps_ns: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    """Six for each stamp: angular velocity, then specific force."""


@dataclass(slots=True, kw_only=True, eq=False)
class Exported:
    """Everything that a layout's files of text are made of."""

    root: Path
    cameras: list[ExportedCamera]
    """Left ones before their right ones."""
    depth: ExportedCamera | None = None
    imu: ExportedImu | None = None
    truth: Trajectory | None = None
    """Of the body."""
    log: RunLog = field(default_factory=RunLog)

    def truth_of(self, camera: ExportedCamera) -> Trajectory | None:
        """Return the true poses of a camera."""
        truth = self.truth
        if truth is None or np.array_equal(camera.T_body_camera, np.eye(4)):
            return truth
        from slamcli.geometry import se3

        positions, quats = se3.to_position_quaternion(truth.transforms @ camera.T_body_camera)
        return Trajectory(truth.stamps_ns, positions, quats, source=truth.source)
