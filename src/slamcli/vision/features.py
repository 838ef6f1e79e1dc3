# SPDX-License-Identifier: MIT
"""Key points of one image with their descriptors and, where known, their depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Features:
    """N key points of the left or only image, as columns."""

    pixels: NDArray[np.float64]
    """(N, 2), pixels of the ideal pinhole camera (undistorted, rectified)."""
    octaves: NDArray[np.int64]
    """(N,), level of the image pyramid, 0 the finest."""
    angles: NDArray[np.float64]
    """(N,), radians in [0, 2 pi): from the centre to the intensity centroid."""
    responses: NDArray[np.float64]
    """(N,), strength of the corner."""
    descriptors: NDArray[np.uint8]
    """(N, 32), 256 bits."""
    sigmas: NDArray[np.float64]
    """(N,), standard deviation of `pixels`, pixels: scale_factor ** octave, times what the lens stretches."""
    right: NDArray[np.float64]
    """(N,), column in the (real or virtual) right image, pixels; NaN where unknown."""
    depth: NDArray[np.float64]
    """(N,), metres along z; NaN where unknown."""
    raw_pixels: NDArray[np.float64]
    """(N, 2), pixels of the image as it is shown (for pictures and colours)."""

    def __len__(self) -> int:
        """Return the number of key points."""
        return len(self.octaves)
