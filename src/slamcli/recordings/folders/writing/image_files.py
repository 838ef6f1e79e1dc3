# SPDX-License-Identifier: MIT
"""Images of messages as files: their own bytes where these are a file already, else a PNG of the same pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.measurements import Image
from slamcli.recordings.adapters.compressed_image import damage_of, image_format

_SUFFIXES = {"jpeg": ".jpg", "png": ".png", "mono16; png compressed ": ".png"}
_LARGEST = 65535


def file_bytes(message: Any, *, png_only: bool) -> tuple[bytes, str] | None:
    """Return the bytes and the suffix of a CompressedImage that is a whole PNG or JPEG file; None where it must be decoded.

    Parameters
    ----------
    message
        A decoded CompressedImage or Image.
    png_only
        Whether readers of the layout expect PNG whatever the content.
    """
    if not hasattr(message, "format") or "compresseddepth" in message.format.lower():
        return None
    data = np.asarray(message.data, dtype=np.uint8).tobytes()
    suffix = _SUFFIXES.get(image_format(data, ""))
    return None if suffix is None or (png_only and suffix != ".png") or damage_of(data) else (data, suffix)


def png_bytes(pixels: NDArray[Any]) -> bytes:
    """Return a PNG of grey, blue-green-red or 16 bit pixels.

    Raises
    ------
    DataError
        If they cannot be encoded.
    """
    import cv2

    done, data = cv2.imencode(".png", np.ascontiguousarray(pixels))
    if not done:
        raise DataError(f"pixels of shape {pixels.shape} cannot be written as PNG")
    return bytes(np.asarray(data).tobytes())


def camera_pixels(image: Image) -> NDArray[np.uint8]:
    """Return grey or blue-green-red pixels, as OpenCV writes them."""
    pixels = np.asarray(image.pixels, dtype=np.uint8)
    return pixels[..., ::-1] if image.encoding == "rgb8" else pixels


def depth_pixels(image: Image, units_per_m: float) -> tuple[NDArray[np.uint16], int]:
    """Return raw depth, uint16 (H, W), 0 for none, and how many pixels were too far away to be written."""
    raw = np.rint(np.nan_to_num(np.asarray(image.pixels, dtype=np.float64), posinf=0.0, neginf=0.0) * units_per_m)
    far = raw >= _LARGEST
    raw[far | (raw < 0)] = 0
    return raw.astype(np.uint16), int(np.count_nonzero(far))


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file in the folder that is being made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
