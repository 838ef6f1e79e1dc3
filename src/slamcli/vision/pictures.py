# SPDX-License-Identifier: MIT
"""Small pictures of what a camera saw, kept for people to look at: nothing is computed from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

_MOST_COLUMNS = 240
_QUALITY = 75


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """An image at a whole fraction of its size, about 10 kB."""

    jpeg: bytes
    width: int
    height: int
    factor: int
    """Image pixels per picture pixel."""

    def places(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where pixels (N, 2) of the image lie in the picture."""
        return (pixels + 0.5) / self.factor - 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KeyframeView:
    """A keyframe's picture and the key points in it that see points of the map."""

    stamp_ns: int
    picture: Picture
    places: NDArray[np.float64]
    """float64 (N, 2), picture pixels."""
    num_features: int
    """Key points of the image, those that see nothing too."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaceView:
    """The same place at two times: what closed a loop or joined two maps."""

    older: KeyframeView
    """With `places` (M, 2) of the matches alone."""
    newer: KeyframeView
    """The same, row by row."""
    kind: Literal["loop", "join"] = "loop"


def reduced_picture(image: NDArray[np.uint8]) -> Picture:
    """Return the picture of an image, uint8 (H, W) or (H, W, 3) red first."""
    height, width = image.shape[:2]
    factor = max(1, -(-width // _MOST_COLUMNS))
    size = max(1, width // factor), max(1, height // factor)
    cut = np.ascontiguousarray(image[: size[1] * factor, : size[0] * factor])
    small = cv2.resize(cut, size, interpolation=cv2.INTER_AREA) if factor > 1 else cut
    blue_first = small if small.ndim == 2 else small[..., ::-1]
    _, data = cv2.imencode(".jpg", blue_first, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return Picture(jpeg=data.tobytes(), width=size[0], height=size[1], factor=factor)
