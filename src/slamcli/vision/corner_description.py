# SPDX-License-Identifier: MIT
"""Binary descriptors of key points that another detector found, on the image as it is (one scale)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision.features import Features
from slamcli.vision.orb import describe_at

BORDER = 19
"""Pixels from the image's border that have no descriptor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenCvOrbSettings:
    """OpenCV's own ORB (Rublee et al., ICCV 2011)."""

    num_features: int = 500
    scale_factor: float = 2.0
    num_levels: int = 3
    edge_threshold: int = 19
    """Pixels from the border without key points."""
    first_level: int = 0
    wta_k: int = 2
    """Pixels that each comparison takes."""
    fast_score: bool = False
    """Whether corners are ranked by FAST's score and not Harris'."""
    patch_size: int = 31
    fast_threshold: int = 20


def described_corners(
    grey: NDArray[np.uint8], pixels: NDArray[np.float64], responses: NDArray[np.float64], *, angle_rad: float | None
) -> Features:
    """Return features at corners (N, 2) of one scale; those within 19 pixels of the border are dropped.

    Parameters
    ----------
    angle_rad
        By how much the pattern is turned, the same for all: tells more corners apart where the camera does not roll. None: by each corner's
        own angle.
    """
    places = np.rint(pixels).astype(np.int64)
    height, width = grey.shape
    inside = (places >= BORDER).all(axis=1) & (places[:, 0] < width - BORDER) & (places[:, 1] < height - BORDER)
    keep = np.flatnonzero(inside)
    angles, descriptors = describe_at(grey, places[keep], angle_rad=angle_rad)
    unknown = np.full(len(keep), np.nan)
    return Features(
        pixels=pixels[keep], octaves=np.zeros(len(keep), dtype=np.int64), angles=angles, responses=responses[keep],
        descriptors=descriptors, sigmas=np.ones(len(keep)), right=unknown, depth=unknown.copy(), raw_pixels=pixels[keep].copy(),
    )  # fmt: skip


def extract_opencv_orb(
    grey: NDArray[np.uint8], settings: OpenCvOrbSettings, excluded: NDArray[np.bool_] | None = None
) -> Features:
    """Return the key points that OpenCV's ORB finds, in its order.

    Raises
    ------
    DataError
        If the image is not uint8 (H, W).
    """
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise DataError(f"ORB: the image is {grey.dtype} {grey.shape}, not uint8 (H, W)")
    orb = cv2.ORB_create(  # type: ignore[attr-defined]
        nfeatures=settings.num_features, scaleFactor=settings.scale_factor, nlevels=settings.num_levels,
        edgeThreshold=settings.edge_threshold, firstLevel=settings.first_level, WTA_K=settings.wta_k,
        scoreType=cv2.ORB_FAST_SCORE if settings.fast_score else cv2.ORB_HARRIS_SCORE, patchSize=settings.patch_size,
        fastThreshold=settings.fast_threshold,
    )  # fmt: skip
    mask = None if excluded is None else np.where(excluded, 0, 255).astype(np.uint8)
    found, descriptors = orb.detectAndCompute(grey, mask)
    count = len(found)
    pixels = np.array([point.pt for point in found], dtype=np.float64).reshape(-1, 2)
    octaves = np.array([point.octave for point in found], dtype=np.int64)
    unknown = np.full(count, np.nan)
    return Features(
        pixels=pixels, octaves=octaves, angles=np.radians([point.angle for point in found]).reshape(-1),
        responses=np.array([point.response for point in found], dtype=np.float64),
        descriptors=np.zeros((0, 32), dtype=np.uint8) if descriptors is None else np.asarray(descriptors, dtype=np.uint8),
        sigmas=settings.scale_factor ** (octaves - settings.first_level).astype(np.float64), right=unknown, depth=unknown.copy(),
        raw_pixels=pixels.copy(),
    )  # fmt: skip
