# SPDX-License-Identifier: MIT
"""Images and depth images as compressed bytes, and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.vision.depth_coding import MAGIC, decode_rvl, encode_rvl, in_millimetres

MILLIMETRES = 1000.0
_PNG = b"\x89PNG"


def encode_image(image: NDArray[np.uint8], encoding: str = ".jpg") -> bytes:
    """Return the bytes of an image.

    Parameters
    ----------
    image
        uint8 (H, W, 3), red first, or (H, W).
    encoding
        ``.jpg`` (quality 95, as OpenCV's and RTAB-Map's default) or ``.png`` (lossless).
    """
    pixels = np.ascontiguousarray(image[:, :, ::-1]) if image.ndim == 3 else np.ascontiguousarray(image)
    return _encoded(pixels, encoding)


def decode_image(data: bytes) -> NDArray[np.uint8]:
    """Return uint8 (H, W, 3), red first, or (H, W).

    Raises
    ------
    FormatError
        If the bytes are no image of 8 bits.
    """
    image = _decoded(data)
    if image.dtype != np.uint8:
        raise FormatError(f"an image of {image.dtype} where one of 8 bits was expected")
    return image if image.ndim == 2 else np.ascontiguousarray(image[:, :, 2::-1])


def encode_depth(depth: NDArray[np.float32], encoding: str = ".rvl", *, whole_millimetres: bool = False) -> bytes:
    """Return the bytes of a depth image.

    Depths that are whole millimetres below 65.536 m, as depth cameras give them, are kept as 16 bits in `encoding`. Others are kept
    as they are, float32 in the four bytes of a PNG's colours and transparency, as RTAB-Map does it.

    Parameters
    ----------
    depth
        float32 (H, W), metres; 0, NaN and what is negative mean unknown.
    encoding
        ``.rvl`` or ``.png``, of 16-bit images.
    whole_millimetres
        Whether to round to millimetres (and forget what is farther than 65.535 m) what is not whole.
    """
    values = in_millimetres(depth, rounding=whole_millimetres)
    if values is None:
        known = np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(0.0))
        return _encoded(np.ascontiguousarray(known, dtype="<f4").view(np.uint8).reshape(*known.shape, 4), ".png")
    return encode_rvl(values) if encoding == ".rvl" else _encoded(values, ".png")


def decode_depth(data: bytes) -> NDArray[np.float32]:
    """Return float32 (H, W), metres, 0 where unknown, from any of the encodings of `encode_depth`.

    Raises
    ------
    FormatError
        If the bytes are none of them, or damaged.
    """
    image = decode_rvl(data) if data.startswith(MAGIC) else _decoded(data)
    if image.dtype == np.uint16 and image.ndim == 2:
        return (image / MILLIMETRES).astype(np.float32)
    if image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 4:
        depth = np.ascontiguousarray(image).view("<f4")[:, :, 0]
        return np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(0.0)).astype(np.float32)
    raise FormatError(f"an image of {image.dtype} and shape {image.shape} where a depth image was expected")


def is_depth(data: bytes) -> bool:
    """Return whether the bytes are a depth image (and not that of a right camera): RVL, or a PNG of 16 bits or of four channels."""
    if data.startswith(MAGIC):
        return True
    if not data.startswith(_PNG) or len(data) < 26:
        return False
    bits, colours = data[24], data[25]
    return bits == 16 or colours == 6


def _encoded(pixels: NDArray[Any], encoding: str) -> bytes:
    options: Sequence[int] = (cv2.IMWRITE_PNG_COMPRESSION, 1) if encoding == ".png" else (cv2.IMWRITE_JPEG_QUALITY, 95)
    done, data = cv2.imencode(encoding, pixels, list(options))
    if not done:
        raise FormatError(f"an image of {pixels.dtype} and shape {pixels.shape} cannot be kept as {encoding}")
    return bytes(data.tobytes())


def _decoded(data: bytes) -> NDArray[Any]:
    image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if image is None:
        raise FormatError(f"{len(data)} bytes that are no image: they are damaged or in an unknown encoding")
    return image
