# SPDX-License-Identifier: MIT
"""Corners by the smallest eigenvalue of the structure tensor (Shi, Tomasi: Good features to track, CVPR 1994)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError


@dataclass(frozen=True, slots=True, kw_only=True)
class GfttSettings:
    """Which corners count."""

    quality_level: float = 0.001
    """Share of the best corner's strength that a corner needs."""
    min_distance: float = 7.0
    """Pixels between two corners."""
    block_size: int = 3
    """Pixels along a side of the window."""
    harris: bool = False
    """Whether strength is Harris' and not the smallest eigenvalue."""
    harris_k: float = 0.04


def find_corners(
    grey: NDArray[np.uint8], settings: GfttSettings, *, most: int = 0, excluded: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return pixels (N, 2) and strengths (N,) of the strongest corners, the strongest first.

    Parameters
    ----------
    grey
        uint8 (H, W).
    most
        How many; 0: all.
    excluded
        bool (H, W): pixels that are no corners.

    Raises
    ------
    DataError
        If the image is not uint8 (H, W), or the mask has another shape.
    """
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise DataError(f"corners: the image is {grey.dtype} {grey.shape}, not uint8 (H, W)")
    if excluded is not None and excluded.shape != grey.shape:
        raise DataError(f"corners: the mask is {excluded.shape}, the image {grey.shape}")
    mask = None if excluded is None else np.where(excluded, 0, 255).astype(np.uint8)
    found: tuple[Any, Any] = cv2.goodFeaturesToTrackWithQuality(
        grey, most, settings.quality_level, settings.min_distance, mask, blockSize=settings.block_size, gradientSize=3,
        useHarrisDetector=settings.harris, k=settings.harris_k,
    )  # fmt: skip
    if found[0] is None:
        return np.zeros((0, 2)), np.zeros(0)
    return np.asarray(found[0], np.float64).reshape(-1, 2), np.asarray(found[1], np.float64).ravel()


def refine_corners(
    grey: NDArray[np.uint8], pixels: NDArray[np.float64], *, half_window: int, iterations: int, epsilon: float
) -> NDArray[np.float64]:
    """Return corners (N, 2) moved to where gradients around them meet (Förstner), to parts of a pixel.

    Parameters
    ----------
    half_window
        Pixels each way.
    iterations, epsilon
        At most, and pixels by which the last one moves it.
    """
    if len(pixels) == 0 or iterations <= 0:
        return pixels
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, iterations, epsilon)
    corners = np.ascontiguousarray(pixels, np.float32).reshape(-1, 1, 2)
    moved = cv2.cornerSubPix(grey, corners, (half_window, half_window), (-1, -1), criteria)
    return np.asarray(moved, np.float64).reshape(-1, 2)
