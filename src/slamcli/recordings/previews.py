# SPDX-License-Identifier: MIT
"""Images of a recording as small JPEG files."""

from __future__ import annotations

import numpy as np

from slamcli.errors import DataError
from slamcli.measurements import Image

_QUALITY = 85


def jpeg_preview(image: Image, max_width: int) -> bytes:
    """Return a JPEG of a colour or grey image, no wider than `max_width` pixels; the same image gives the same bytes.

    Raises
    ------
    DataError
        If it is a depth image.
    """
    import cv2

    if image.encoding == "depth":
        raise DataError(f"{image.topic}: a depth image has no preview")
    pixels = np.asarray(image.pixels, dtype=np.uint8)
    if image.encoding == "rgb8":
        pixels = pixels[..., ::-1]
    height, width = pixels.shape[:2]
    if width > max_width:
        size = (max_width, max(1, round(height * max_width / width)))
        pixels = np.asarray(cv2.resize(np.ascontiguousarray(pixels), size, interpolation=cv2.INTER_AREA), np.uint8)
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(pixels), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return bytes(np.asarray(data).tobytes())
