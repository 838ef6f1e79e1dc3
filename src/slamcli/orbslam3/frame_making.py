# SPDX-License-Identifier: MIT
"""From prepared images to a frame: key points, their depth, their grid, their colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.frame import Frame
from slamcli.vision.depth_lookup import with_depth
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid
from slamcli.vision.pinhole import Pinhole


def make_frame(number: int, stamp_ns: int, features: Features, camera: Pinhole, colour: NDArray[np.uint8] | None) -> Frame:
    """Return a frame that sees no map point yet."""
    return Frame(
        number=number,
        stamp_ns=stamp_ns,
        features=features,
        grid=feature_grid(features, camera),
        points=np.full(len(features), -1, dtype=np.int64),
        colours=None if colour is None else colours_at(colour, features.raw_pixels),
    )


def colours_at(image: NDArray[np.uint8], pixels: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return RGB (N, 3) of an image (H, W, 3) RGB or (H, W) grey at pixels (N, 2)."""
    column = np.clip(np.rint(pixels[:, 0]).astype(np.int64), 0, image.shape[1] - 1)
    row = np.clip(np.rint(pixels[:, 1]).astype(np.int64), 0, image.shape[0] - 1)
    values = image[row, column]
    return np.repeat(values[:, None], 3, axis=1) if values.ndim == 1 else values


__all__ = ["colours_at", "make_frame", "with_depth"]
