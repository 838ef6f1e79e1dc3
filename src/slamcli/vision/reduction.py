# SPDX-License-Identifier: MIT
"""From an image to a small picture of it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.vision.pictures import Picture

_MOST_COLUMNS = 240
_QUALITY = 75


def reduced_grey(grey: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Return an image (H, W) made `step` times smaller by averages; what does not fill a whole pixel at the end is cut off."""
    height, width = grey.shape[0] // step, grey.shape[1] // step
    cut = grey[: height * step, : width * step]
    return np.asarray(cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def reduced_picture(image: NDArray[np.uint8]) -> Picture:
    """Return the picture of an image, uint8 (H, W) or (H, W, 3) red first."""
    height, width = image.shape[:2]
    factor = max(1, -(-width // _MOST_COLUMNS))
    size = max(1, width // factor), max(1, height // factor)
    cut = image[: size[1] * factor, : size[0] * factor]
    small = cv2.resize(cut, size, interpolation=cv2.INTER_AREA) if factor > 1 else cut
    blue_first = small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", blue_first, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return Picture(jpeg=data.tobytes(), width=size[0], height=size[1], factor=factor)
