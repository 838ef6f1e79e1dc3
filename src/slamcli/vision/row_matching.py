# SPDX-License-Identifier: MIT
"""Where pixels of the left image lie in the rows of the right one, by their surroundings alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _row_kernels as row_kernels
from slamcli.vision import _stereo_kernels as stereo_kernels
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]
_HALF = 5
"""Pixels that the windows of the refinement reach each way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RowMatchSettings:
    """Which pairs of pixels are believed."""

    window_width: int = 15
    """Pixels, odd (the next odd number otherwise)."""
    window_height: int = 3
    min_disparity: float = 0.5
    """Pixels; nearer to nothing is dropped."""
    max_disparity: float = 128.0
    squared: bool = True
    """Whether windows are compared by squared differences, or else by absolute ones."""
    refine: bool = True
    """Whether the place is refined as optical flow does (Lucas, Kanade, IJCAI 1981; along the row, up to brightness and contrast), and pairs that
    do not correlate are dropped."""
    min_correlation: float = 0.75
    """Of windows that were refined."""


def match_rows(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    pixels: Floats,
    camera: Pinhole,
    settings: RowMatchSettings | None = None,
) -> tuple[Floats, Floats]:
    """Return columns in the right image and depths, float64 (N,), of pixels (N, 2) of the left one; NaN where unknown.

    Parameters
    ----------
    left, right
        uint8 (H, W), rectified.
    camera
        The left camera with its baseline.

    Raises
    ------
    DataError
        If the camera has no baseline, or the images are of different size.
    """
    settings = settings or RowMatchSettings()
    if camera.bf <= 0.0:
        raise DataError("stereo matching: the camera has no baseline")
    if left.shape != right.shape:
        raise DataError(f"stereo matching: the images are {left.shape} and {right.shape}, not of one size")
    left, right = np.require(left, requirements=["C", "W"]), np.require(right, requirements=["C", "W"])
    places = np.rint(pixels).astype(np.int64)
    columns, rows = np.ascontiguousarray(places[:, 0]), np.ascontiguousarray(places[:, 1])
    least, most = int(np.floor(settings.min_disparity)), int(np.ceil(settings.max_disparity))
    disparities = row_kernels.block_match(
        left, right, columns, rows, settings.window_width // 2, settings.window_height // 2, max(least - 1, -1), most + 1,
        settings.squared,
    )  # fmt: skip
    if settings.refine:
        count = len(columns)
        found, correlations = stereo_kernels.refine(
            left, right, columns, rows, columns - disparities, np.full(count, _HALF, dtype=np.int64), np.ones(count)
        )
        found[~(correlations >= settings.min_correlation)] = np.nan
        disparities = columns - found
    disparities[
        ~((disparities >= settings.min_disparity) & (disparities <= settings.max_disparity) & (disparities > 0.0))
    ] = np.nan
    return pixels[:, 0] - disparities, camera.bf / disparities


def warm() -> None:
    """Compile the kernels of this module."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (40, 80), dtype=np.uint8)
    camera = Pinhole(fx=50.0, fy=50.0, cx=40.0, cy=20.0, width=80, height=40, baseline_m=0.1)
    match_rows(image, image, np.array([[40.0, 20.0]]), camera, RowMatchSettings(max_disparity=8.0))
