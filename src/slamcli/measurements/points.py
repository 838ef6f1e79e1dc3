# SPDX-License-Identifier: MIT
"""A cloud of points that one sensor measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointCloud:
    """Points in the sensor's frame; what has one entry per point is filtered together with them."""

    stamp_ns: int
    frame_id: str
    points_m: NDArray[np.float32]
    """float32 (N, 3), finite."""
    offset_ns: NDArray[np.int64] | None = None
    """int64 (N,), when each point was measured, after `stamp_ns`, or None."""
    intensities: NDArray[np.float32] | None = None
    """float32 (N,) or None."""
    rings: NDArray[np.uint16] | None = None
    """uint16 (N,), which beam of the sensor measured each point, or None."""
    colours: NDArray[np.uint8] | None = None
    """uint8 (N, 3), red, green, blue, or None."""
    shape: tuple[int, int] | None = None
    """Rows and columns of an organised cloud, or None."""
    cells: NDArray[np.int64] | None = None
    """int64 (N,), row * columns + column of each point in an organised cloud; all other cells are empty. None without `shape`."""
    topic: str = ""

    def __post_init__(self) -> None:
        if self.points_m.ndim != 2 or self.points_m.shape[1] != 3:
            raise DataError(f"point cloud at {self.stamp_ns} ns: points have shape {self.points_m.shape}, not (N, 3)")
        for name in ("offset_ns", "intensities", "rings", "cells"):
            values = getattr(self, name)
            if values is not None and values.shape != (len(self.points_m),):
                raise DataError(
                    f"point cloud at {self.stamp_ns} ns: {name} has shape {values.shape} for {len(self.points_m)} points"
                )
        if self.colours is not None and self.colours.shape != self.points_m.shape:
            raise DataError(
                f"point cloud at {self.stamp_ns} ns: colours have shape {self.colours.shape} for {len(self.points_m)} points"
            )
        if (self.shape is None) != (self.cells is None):
            raise DataError(f"point cloud at {self.stamp_ns} ns: `shape` and `cells` go together")
