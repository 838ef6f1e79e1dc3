# SPDX-License-Identifier: MIT
"""Oriented FAST corners with rotated binary descriptors, evenly spread over image and scales, as ORB-SLAM has them.

References
----------
Rublee, Rabaud, Konolige, Bradski: ORB: an efficient alternative to SIFT or SURF, ICCV 2011.
Rosten, Drummond: Machine learning for high-speed corner detection, ECCV 2006.
Mur-Artal, Montiel, Tardos: ORB-SLAM, IEEE T-RO 2015, section III.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _corner_kernels, _orb_kernels
from slamcli.vision._orb_pattern import pattern
from slamcli.vision.features import Features

Grey = NDArray[np.uint8]

_RADIUS = 15
"""Pixels, of the disc whose centroid gives the angle."""
_BORDER = 19
"""Pixels: a turned pattern reaches 18 (two corners of a square of 13), the disc 15."""
_CELL = 35
"""Pixels: the size of the cells with a threshold of their own."""
_GAUSSIAN = np.exp(-0.5 * (np.arange(-3, 4) / 2.0) ** 2)
_GAUSSIAN /= _GAUSSIAN.sum()  # OpenCV's own GaussianBlur rounds otherwise and takes twice as long
_PATTERN_X, _PATTERN_Y = pattern()


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbSettings:
    """How many key points are sought, and where."""

    num_features: int = 1000
    """Per image; fewer are found only where the image has no more corners."""
    scale_factor: float = 1.2
    """Between levels of the pyramid."""
    num_levels: int = 8
    initial_threshold: int = 20
    """Grey levels that nine neighbouring pixels of the circle must be brighter or darker."""
    minimum_threshold: int = 7
    """The same, in cells and levels where the initial one leaves too few."""
    subpixel: bool = True
    """Whether key points lie where the score peaks between pixels; ORB-SLAM leaves them on the pixels."""

    def __post_init__(self) -> None:
        if self.num_features < 1 or self.num_levels < 1 or not self.scale_factor > 1.0:
            raise DataError(
                f"ORB: {self.num_features} features on {self.num_levels} levels of scale {self.scale_factor}: "
                "at least one feature and level, and a scale above 1"
            )
        if not 1 <= self.minimum_threshold <= self.initial_threshold <= 254:
            raise DataError(
                f"ORB: thresholds {self.initial_threshold} and {self.minimum_threshold}: they must lie from 1 to 254, the "
                "initial one not below the minimum"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbExtraction:
    """The key points of an image and the images they were found on."""

    features: Features
    pyramid: tuple[Grey, ...]
    """uint8, from the image itself to the smallest level with room for a key point."""


def extract_orb(grey: Grey, settings: OrbSettings | None = None, mask: NDArray[Any] | None = None) -> OrbExtraction:
    """Return the key points of an image, from fine to coarse levels and row by row.

    Parameters
    ----------
    grey
        uint8 (H, W).
    settings
        How many and where.
    mask
        (H, W), bool or a number: pixels that are not 0 get no key point.

    Returns
    -------
    Features without depth, `raw_pixels` equal to `pixels`; none for an image without corners or with no room for them
    (a key point lies at least 19 pixels of its level inside the image).

    Raises
    ------
    DataError
        If the image is not uint8 (H, W), or the mask has another shape.

    Notes
    -----
    A level's share of the key points falls geometrically with its scale; what a level cannot give, the others do. Pixels of
    coarse levels are mapped by the centres of their areas, (x + 1/2) s - 1/2, so that levels agree on where a corner is.
    A paraboloid through the 3 x 3 scores tells where between the pixels it is: on real images that takes a quarter to a third off
    the error of where corners are seen again (benchmarks/vision_features.py). Descriptors are those of the pixel, and equal
    OpenCV's for the same place and angle, bit by bit.
    """
    settings = settings or OrbSettings()
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise DataError(f"ORB: the image is {grey.dtype} {grey.shape}, not uint8 (H, W)")
    if mask is not None and mask.shape != grey.shape:
        raise DataError(f"ORB: the mask is {mask.shape}, the image {grey.shape}")
    # Writable: for numba, arrays that are not are of another type, to be compiled for anew.
    pyramid = image_pyramid(np.require(grey, requirements=["C", "W"]), settings)
    found = [_level_corners(image, settings, mask) for image in pyramid]
    quotas = _quotas([len(corners.columns) for corners, _ in found], settings)
    levels = [
        _describe_level(image, _chosen(image, *corners, quota), level, grey.shape, settings)
        for level, (image, corners, quota) in enumerate(zip(pyramid, found, quotas, strict=True))
    ]
    return OrbExtraction(features=_joined(levels), pyramid=pyramid)


def image_pyramid(grey: Grey, settings: OrbSettings) -> tuple[Grey, ...]:
    """Return the image and its smaller copies, each made from the one before, as far as key points have room."""
    height, width = grey.shape
    pyramid = [grey]
    for level in range(1, settings.num_levels):
        scale = settings.scale_factor**level
        size = (round(width / scale), round(height / scale))
        if min(size) <= 2 * _BORDER:
            break
        pyramid.append(cv2.resize(pyramid[-1], size, interpolation=cv2.INTER_LINEAR))
    return tuple(pyramid)


def _allowed(mask: NDArray[Any], image: Grey, columns: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which pixels of a level the mask, of the image's size, does not exclude."""
    at_row = ((rows + 0.5) * (mask.shape[0] / image.shape[0])).astype(np.int64)
    at_column = ((columns + 0.5) * (mask.shape[1] / image.shape[1])).astype(np.int64)
    return np.asarray(mask[at_row, at_column] == 0)


@dataclass(frozen=True, slots=True)
class _Corners:
    """Of one level."""

    columns: NDArray[np.int64]
    rows: NDArray[np.int64]
    scores: NDArray[np.uint8]
    peaks: NDArray[np.float64]
    """(N, 2), pixels from the corner."""

    def __getitem__(self, some: NDArray[Any]) -> _Corners:
        return _Corners(self.columns[some], self.rows[some], self.scores[some], self.peaks[some])


def _level_corners(image: Grey, settings: OrbSettings, mask: NDArray[Any] | None) -> tuple[_Corners, NDArray[np.bool_]]:
    """A level's corners, and which of them are wanted first."""
    found = _Corners(*_corner_kernels.corners(image, _BORDER, np.uint8(settings.minimum_threshold)))
    if mask is not None:
        found = found[_allowed(mask, image, found.columns, found.rows)]
    height, width = image.shape
    initial = np.uint8(settings.initial_threshold)
    first = _corner_kernels.strong_in_cells(
        found.columns, found.rows, found.scores, _BORDER, width, height, _CELL, initial
    )
    return found, first


def _quotas(available: list[int], settings: OrbSettings) -> list[int]:
    """How many key points each level gives: geometric shares, and what one lacks is shared among the others."""
    shares = np.array([settings.scale_factor**-level for level in range(len(available))])
    limits = np.array(available, dtype=np.int64)
    quotas = np.zeros(len(available), dtype=np.int64)
    while (left := settings.num_features - int(quotas.sum())) > 0 and (open_ := quotas < limits).any():
        ends = np.rint(left * np.cumsum(shares * open_) / float((shares * open_).sum())).astype(np.int64)
        quotas = np.minimum(quotas + np.diff(ends, prepend=0), limits)
    return [int(quota) for quota in quotas]


def _chosen(image: Grey, found: _Corners, first: NDArray[np.bool_], quota: int) -> _Corners:
    if int(first.sum()) >= quota:
        found = found[first]
    height, width = image.shape
    kept = _corner_kernels.distribute(
        found.columns, found.rows, found.scores, _BORDER, _BORDER, width - _BORDER, height - _BORDER, quota
    )
    return found[kept]


def _half_widths() -> NDArray[np.int64]:
    """How far a disc that is symmetric about its diagonals reaches in each row from its centre, int64 (radius + 1,)."""
    reach = np.rint(np.sqrt(_RADIUS**2 - np.arange(_RADIUS + 1) ** 2)).astype(np.int64)
    u, v = np.meshgrid(np.arange(_RADIUS + 1), np.arange(_RADIUS + 1))
    inside = np.maximum(u, v) <= reach[np.minimum(u, v)]
    return inside.sum(axis=1) - 1


_HALF_WIDTHS = _half_widths()


def _describe_level(
    image: Grey, corners: _Corners, level: int, shape: tuple[int, ...], settings: OrbSettings
) -> Features:
    columns, rows, count = corners.columns, corners.rows, len(corners.columns)
    angles = np.zeros(count)
    descriptors = np.zeros((count, 32), dtype=np.uint8)
    if count:
        angles = _orb_kernels.centroid_angles(image, columns, rows, _HALF_WIDTHS)
        _orb_kernels.describe(_smooth(image), columns, rows, angles, _PATTERN_X, _PATTERN_Y, descriptors)
    stretch = np.array([shape[1], shape[0]]) / np.maximum(np.array([image.shape[1], image.shape[0]]), 1)
    places = np.column_stack([columns, rows]).astype(np.float64)
    if settings.subpixel:
        places += corners.peaks
    pixels = (places + 0.5) * stretch - 0.5
    return Features(
        pixels=pixels,
        octaves=np.full(count, level, dtype=np.int64),
        angles=angles,
        responses=corners.scores.astype(np.float64),
        descriptors=descriptors,
        sigmas=np.full(count, settings.scale_factor**level),
        right=np.full(count, math.nan),
        depth=np.full(count, math.nan),
        raw_pixels=pixels.copy(),
    )


def _smooth(image: Grey) -> Grey:
    smooth = cv2.sepFilter2D(image, cv2.CV_8U, _GAUSSIAN, _GAUSSIAN, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(smooth, dtype=np.uint8)


def describe_at(
    grey: Grey, places: NDArray[np.int64], *, angle_rad: float | None = None
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return angles (N,), radians, and descriptors (N, 32) of pixels (N, 2) at least 19 pixels inside an image (H, W).

    `angle_rad`: by how much the pattern is turned; None: by each pixel's own angle.
    """
    columns, rows = np.ascontiguousarray(places[:, 0]), np.ascontiguousarray(places[:, 1])
    descriptors = np.zeros((len(places), 32), dtype=np.uint8)
    if not len(places):
        return np.zeros(0), descriptors
    image = np.require(grey, requirements=["C", "W"])
    if angle_rad is None:
        angles = _orb_kernels.centroid_angles(image, columns, rows, _HALF_WIDTHS)
    else:
        angles = np.full(len(places), float(angle_rad))
    _orb_kernels.describe(_smooth(image), columns, rows, angles, _PATTERN_X, _PATTERN_Y, descriptors)
    return angles % (2.0 * math.pi), descriptors


def _joined(levels: list[Features]) -> Features:
    columns = {field.name: [getattr(level, field.name) for level in levels] for field in fields(Features)}
    return Features(**{name: np.concatenate(parts) for name, parts in columns.items()})


def warm() -> None:
    """Compile the kernels of this module."""
    rng = np.random.default_rng(0)
    extract_orb(rng.integers(0, 256, (60, 60), dtype=np.uint8), OrbSettings(num_features=10, num_levels=1))
