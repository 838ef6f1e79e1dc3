# SPDX-License-Identifier: MIT
"""Photographs in files: PNG, JPEG, PGM, BMP, TIFF and WebP."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError

SUFFIXES = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp", ".tif", ".tiff", ".webp")


def pictures_in(folder: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the pictures in a folder and the folders below it, by name."""
    return tuple(sorted(path for path in Path(folder).rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file()))


def read_grey(source: str | os.PathLike[str]) -> NDArray[np.uint8]:
    """Return a picture as grey levels, uint8 (H, W); transparency is ignored.

    Raises
    ------
    FormatError
        If the file cannot be read or is no picture.
    """
    path = Path(source)
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror or error}") from error
    try:
        pixels = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    except cv2.error:
        pixels = None
    if pixels is None:
        raise FormatError(f"{path}: no picture ({', '.join(suffix[1:] for suffix in SUFFIXES)}), or a damaged one")
    return np.asarray(pixels, np.uint8)
