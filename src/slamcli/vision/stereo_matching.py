# SPDX-License-Identifier: MIT
"""Depth of key points from a rectified stereo pair.

References
----------
Mur-Artal, Tardos: ORB-SLAM2, IEEE T-RO 2017, section III-A. Lucas, Kanade: An iterative image registration technique, IJCAI 1981.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _stereo_kernels as kernels
from slamcli.vision.features import Features
from slamcli.vision.orb import OrbExtraction, OrbSettings, extract_orb
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

_HALF = 5
"""Pixels of the level that windows reach each way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoSettings:
    """Which pairs of key points are believed."""

    max_distance: int = 100
    """Bits between the descriptors."""
    row_band: float = 2.0
    """Rows that the two may differ by, times the scale of the right one's level."""
    search_px: int = 5
    """Pixels of the level that the window is moved each way."""
    min_correlation: float = 0.75
    """Of the two windows, once they lie on each other."""


def match_stereo(
    left: OrbExtraction, right: OrbExtraction, camera: Pinhole, settings: StereoSettings | None = None
) -> tuple[Floats, Floats]:
    """Return the column in the right image and the depth, float64 (N,), of the N key points of the left one; NaN where unknown.

    Parameters
    ----------
    left, right
        What was found on the two rectified images.
    camera
        The left camera with its baseline. Points nearer than the baseline are not looked for.
    settings
        Which pairs are believed.

    Returns
    -------
    Columns, pixels, and depths, metres, along z.

    Raises
    ------
    DataError
        If the camera has no baseline, or the images are of different size.

    Notes
    -----
    Candidates come from the descriptors of the key points in the same rows; a window of 11 x 11 pixels of the level then finds the
    place to half a pixel. ORB-SLAM2 stops there, with a parabola through the differences, and drops the worst pairs by
    their median. Here the place is refined on the finest image, in windows that grow with the root of the scale, up to
    brightness and contrast, and pairs are dropped by their correlation. On kitti06 (benchmarks/vision_features.py) more key
    points get a depth, and their disparities agree better with the next frame's, most of all those of coarse levels.
    """
    settings = settings or StereoSettings()
    if camera.bf <= 0.0:
        raise DataError("stereo matching: the camera has no baseline")
    if left.pyramid[0].shape != right.pyramid[0].shape:
        raise DataError(
            f"stereo matching: the images are {left.pyramid[0].shape} and {right.pyramid[0].shape}, not of one size"
        )
    candidates = _candidates(left, right, camera, settings)
    disparities = _refined(left, _searched(left, right, candidates, settings), right, settings)
    disparities[~((disparities > 0.0) & (disparities <= camera.fx))] = np.nan
    return left.features.pixels[:, 0] - disparities, camera.bf / disparities


def _candidates(left: OrbExtraction, right: OrbExtraction, camera: Pinhole, settings: StereoSettings) -> Rows:
    one, two = left.features, right.features
    rows: Rows = kernels.in_row_bands(
        np.ascontiguousarray(one.pixels),
        one.octaves,
        np.ascontiguousarray(one.descriptors).view(np.uint64),
        np.ascontiguousarray(two.pixels),
        two.octaves,
        two.sigmas,
        np.ascontiguousarray(two.descriptors).view(np.uint64),
        left.pyramid[0].shape[0],
        float(settings.row_band),
        float(camera.fx),
        int(settings.max_distance),
    )
    return rows


def _stretch(extraction: OrbExtraction, level: int) -> Floats:
    """Pixels of the image per pixel of a level, along x and y."""
    (height, width), (level_height, level_width) = extraction.pyramid[0].shape, extraction.pyramid[level].shape
    return np.array([width / level_width, height / level_height])


def _searched(left: OrbExtraction, right: OrbExtraction, candidates: Rows, settings: StereoSettings) -> Floats:
    """Disparities, pixels of the image, by windows on the level of each left key point."""
    disparities = np.full(len(candidates), np.nan)
    for level in range(min(len(left.pyramid), len(right.pyramid))):
        members = np.flatnonzero((left.features.octaves == level) & (candidates >= 0))
        if len(members) == 0:
            continue
        stretch = _stretch(left, level)
        places = _nearest(left.features.pixels[members], stretch)
        starts = _nearest(right.features.pixels[candidates[members]], stretch)
        columns = np.ascontiguousarray(places[:, 0])
        found = kernels.window_search(
            left.pyramid[level],
            right.pyramid[level],
            columns,
            np.ascontiguousarray(places[:, 1]),
            np.ascontiguousarray(starts[:, 0]),
            _HALF,
            int(settings.search_px),
        )
        disparities[members] = (columns - found) * stretch[0]
    return disparities


def _nearest(pixels: Floats, stretch: Floats) -> Rows:
    return np.rint((pixels + 0.5) / stretch - 0.5).astype(np.int64)


def _refined(left: OrbExtraction, disparities: Floats, right: OrbExtraction, settings: StereoSettings) -> Floats:
    """Disparities from the finest images, NaN where the windows do not correlate."""
    features: Features = left.features
    places = np.rint(features.pixels).astype(np.int64)
    columns = np.ascontiguousarray(places[:, 0])
    scales = np.array([_stretch(left, level)[0] for level in range(len(left.pyramid))])[features.octaves]
    found, correlations = kernels.refine(
        left.pyramid[0],
        right.pyramid[0],
        columns,
        np.ascontiguousarray(places[:, 1]),
        columns - disparities,
        np.rint(_HALF * np.sqrt(scales)).astype(np.int64),
        scales,
    )
    found[~(correlations >= settings.min_correlation)] = np.nan
    return np.asarray(columns - found)


def warm() -> None:
    """Compile the kernels of this module."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (60, 80), dtype=np.uint8)
    extraction = extract_orb(image, OrbSettings(num_features=10, num_levels=1))
    match_stereo(
        extraction, extraction, Pinhole(fx=50.0, fy=50.0, cx=40.0, cy=30.0, width=80, height=60, baseline_m=0.1)
    )
