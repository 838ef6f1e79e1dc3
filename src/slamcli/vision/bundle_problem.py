# SPDX-License-Identifier: MIT
"""What bundle adjustment takes and gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
MONO_BOUND = 5.991
"""95 % of chi2 with two degrees of freedom."""
STEREO_BOUND = 7.815
"""With three."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BundleProblem:
    """C cameras that see P points in M observations, in any order."""

    T_camera_map: Floats
    """float64 (C, 4, 4), where the cameras begin."""
    fixed: NDArray[np.bool_]
    """bool (C,), cameras that stay."""
    points: Floats
    """float64 (P, 3), map frame, where the points begin."""
    camera_index: Integers
    """int64 (M,)."""
    point_index: Integers
    """int64 (M,)."""
    pixels: Floats
    """float64 (M, 2), undistorted."""
    right: Floats
    """float64 (M,), column in the right image; NaN: seen by the left or only camera alone."""
    sigmas: Floats
    """float64 (M,), standard deviation of `pixels` and `right`, pixels."""
    camera: Pinhole

    def __post_init__(self) -> None:
        cameras, points, count = len(self.T_camera_map), len(self.points), len(self.camera_index)
        wanted = {
            "T_camera_map": (cameras, 4, 4), "fixed": (cameras,), "points": (points, 3), "camera_index": (count,),
            "point_index": (count,), "pixels": (count, 2), "right": (count,), "sigmas": (count,),
        }  # fmt: skip
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise DataError(f"bundle adjustment: {name} is {getattr(self, name).shape}, {shape} is wanted")
        for name, size in (("camera_index", cameras), ("point_index", points)):
            index = getattr(self, name)
            if count and (index.min() < 0 or index.max() >= size):
                wrong = int(np.flatnonzero((index < 0) | (index >= size))[0])
                raise DataError(f"bundle adjustment: {name}[{wrong}] is {index[wrong]}, but there are {size}")
        for name in ("T_camera_map", "points", "pixels", "right"):
            values = getattr(self, name)
            if not np.isfinite(values if name != "right" else values[~np.isnan(values)]).all():
                raise DataError(f"bundle adjustment: {name} has numbers that are not finite")
        if count and not self.sigmas.min() > 0:
            raise DataError(f"bundle adjustment: sigmas must be positive, the least is {self.sigmas.min()}")

    def __len__(self) -> int:
        """Return the number of observations."""
        return len(self.camera_index)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BundleResult:
    """The adjusted cameras and points; rows are those of the problem."""

    T_camera_map: Floats
    """float64 (C, 4, 4)."""
    points: Floats
    """float64 (P, 3)."""
    chi2: Floats
    """float64 (M,), squared residual over squared sigma, without the loss; inf behind the camera."""
    positive_depth: NDArray[np.bool_]
    """bool (M,): the point lies ahead of the camera."""
    inliers: NDArray[np.bool_]
    """bool (M,): ahead of the camera and chi2 within the 95 % bound (5.991 mono, 7.815 stereo)."""
    camera: Pinhole
    """As given, or refined; a refined focal length keeps bf, so that the baseline is bf / fx."""
    intrinsics_sigmas: Floats
    """float64 (5,), standard deviations of fx, fy, cx, cy (pixels) and bf (pixels metres); NaN for what was not refined. They
    hold what the other unknowns leave open, and rest on the problem's `sigmas`."""
    iterations: int
    """Steps that were tried."""
    cost_before: float
    """Half the sum of the losses of the observations that took part, in the (last) round."""
    cost: float
    converged: bool
    """Whether the last round ended before its iterations did."""
