# SPDX-License-Identifier: MIT
"""What a calibration file says of a rig of cameras and an IMU."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements.camera import CameraModel
from slamcli.measurements.frames import ImuNoise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigCalibration:
    """Cameras and IMU as far as a file knows them; None: it does not say."""

    source: str
    """Where it is from, for messages."""
    main: CameraModel | None = None
    """The left or only camera; width and height 0 where the file does not say them."""
    right: CameraModel | None = None
    T_main_right: NDArray[np.float64] | None = None
    """float64 (4, 4), pose of the right camera in the main camera's frame; None: `right` holds the baseline in its P."""
    baseline_m: float | None = None
    """Of rectified stereo, or the virtual one of RGB-D."""
    bf: float | None = None
    """Baseline times the focal length of the images, pixels metres, where the file says only that."""
    T_main_imu: NDArray[np.float64] | None = None
    """float64 (4, 4), pose of the IMU in the main camera's frame."""
    imu_noise: ImuNoise | None = None
    notes: tuple[str, ...] = ()
    """What the file says that is not followed, and how to say it otherwise."""
