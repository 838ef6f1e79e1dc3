# SPDX-License-Identifier: MIT
"""The ideal camera that everything behind the lens works with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Pinhole:
    """A pinhole camera without distortion, and the baseline of the (real or virtual) right camera beside it."""

    fx: float
    """Pixels, as the next three."""
    fy: float
    cx: float
    cy: float
    width: int
    """Pixels of the undistorted image, as the next."""
    height: int
    baseline_m: float = 0.0
    """Distance of the right camera along +x; 0 for a camera without depth. RGB-D cameras have a virtual one."""
    depth_weight: float = 1.0
    """How much better than to a pixel at this baseline depth is known: the virtual right camera of RGB-D stands so much farther away."""
    bounds: tuple[float, float, float, float] | None = None
    """(x_min, y_min, x_max, y_max) of undistorted pixels, where the lens maps the image's border beyond the image."""

    @property
    def bf(self) -> float:
        """Baseline times focal length (times `depth_weight`), pixels metres: depth = bf / disparity."""
        return self.baseline_m * self.fx * self.depth_weight

    @property
    def matrix(self) -> NDArray[np.float64]:
        """float64 (3, 3), K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def array(self) -> NDArray[np.float64]:
        """float64 (5,): fx, fy, cx, cy, bf, as kernels take it."""
        return np.array([self.fx, self.fy, self.cx, self.cy, self.bf])

    @property
    def limits(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max), pixels: where undistorted points can lie."""
        return self.bounds or (0.0, 0.0, float(self.width), float(self.height))

    def project(self, points_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return pixels (N, 2) of points (N, 3), metres, in the camera's frame; z must not be 0."""
        x, y, z = points_camera.T
        return np.column_stack([self.fx * x / z + self.cx, self.fy * y / z + self.cy])

    def back_project(self, pixels: NDArray[np.float64], depth_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 3), metres, in the camera's frame from pixels (N, 2) and depths (N,) along z."""
        x = (pixels[:, 0] - self.cx) / self.fx * depth_m
        y = (pixels[:, 1] - self.cy) / self.fy * depth_m
        return np.column_stack([x, y, depth_m])
