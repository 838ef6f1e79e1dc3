# SPDX-License-Identifier: MIT
"""From prepared images to key points with depth, the strongest first."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.feature_selection import DepthMask, chosen_rows, region_mask, rows_of
from slamcli.rtabmap.feature_settings import Detector, FeatureSettings
from slamcli.vision.corner_description import described_corners, extract_opencv_orb
from slamcli.vision.depth_lookup import with_depth
from slamcli.vision.features import Features
from slamcli.vision.gftt import find_corners, refine_corners
from slamcli.vision.orb import extract_orb
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.preparation import Preparation, PreparedFrame
from slamcli.vision.reduction import reduced_grey
from slamcli.vision.row_matching import match_rows
from slamcli.vision.stereo_matching import match_stereo

_PLENTY = 4
"""So many times more key points are sought where a grid or square covering chooses among them."""
_ALL = 100_000

_UPRIGHT = {Detector.GFTT_ORB: -math.pi / 180.0, Detector.GFTT_BRIEF: 0.0}
"""OpenCV's corners have the angle -1, which its ORB takes for degrees; RTAB-Map's descriptors are so."""

Grey = NDArray[np.uint8]
Mask = NDArray[np.bool_] | None


class FeatureExtractor:
    """Finds key points, describes them, and looks their depth up or measures it in the right image.

    Parameters
    ----------
    settings
        Which and how many.
    preparation
        Where the images come from. `camera` is its ideal camera, with the weight that depth has (RGB-D).
    """

    def __init__(self, settings: FeatureSettings, preparation: Preparation) -> None:
        self.settings = settings
        self._preparation = preparation
        weight = settings.depth_weight if preparation.rig.mode == "rgbd" else 1.0
        self.camera = replace(preparation.camera, depth_weight=weight)
        self._depth_mask = DepthMask(settings, preparation)
        self._region = region_mask(settings, preparation.height, preparation.width)

    def extract(self, prepared: PreparedFrame) -> Features:
        """Return the key points of the left or only image, by response; `right` and `depth` are NaN where unknown.

        May run on any thread.
        """
        step = self.settings.decimation
        grey, right = prepared.grey, prepared.right
        excluded = self._excluded(prepared)
        camera = self.camera
        if step > 1:
            grey, right = reduced_grey(grey, step), None if right is None else reduced_grey(right, step)
            excluded = None if excluded is None else excluded[step // 2 :: step, step // 2 :: step]
            excluded = None if excluded is None else np.ascontiguousarray(excluded[: len(grey), : grey.shape[1]])
            camera = _reduced_camera(camera, step)
        features = _enlarged(self._found(grey, right, excluded, camera), step)
        if right is None:
            features = self._preparation.undistorted(features)
        if prepared.depth is not None:
            features = with_depth(features, prepared.depth, self.camera)
        features = self._within_depth(features)
        return rows_of(features, chosen_rows(features, self.settings, prepared.grey.shape))

    def _excluded(self, prepared: PreparedFrame) -> Mask:
        if prepared.depth is None or not self.settings.depth_as_mask:
            return self._region
        without = self._depth_mask.excluded(prepared.depth)
        return without if self._region is None else without | self._region

    def _found(self, grey: Grey, right: Grey | None, excluded: Mask, camera: Pinhole) -> Features:
        """Features of a whole image, more than are wanted where others choose among them; with depth from a right image."""
        settings = self.settings
        number = settings.max_features or _ALL
        choosy = settings.spread or settings.grid_rows * settings.grid_columns > 1
        number *= _PLENTY if choosy else 1
        if settings.detector is Detector.ORB_OCTREE:
            octree = replace(settings.octree, num_features=number)
            found = extract_orb(grey, octree, excluded)
            if right is None:
                return found.features
            by_looks = match_stereo(found, extract_orb(right, octree), camera)
            by_rows = match_rows(grey, right, found.features.pixels, camera, settings.rows)
            unknown = np.isnan(by_looks[0])  # often only because the right image's corner is not among its key points
            columns, depth = (np.where(unknown, row, looks) for looks, row in zip(by_looks, by_rows, strict=True))
            return replace(found.features, right=columns, depth=depth)
        if settings.detector is Detector.ORB:
            features = extract_opencv_orb(grey, replace(settings.orb, num_features=number), excluded)
        else:
            features = self._corners(grey, 0 if choosy else settings.max_features, excluded)
        if right is None:
            return features
        columns, depth = match_rows(grey, right, features.pixels, camera, settings.rows)
        return replace(features, right=columns, depth=depth)

    def _corners(self, grey: Grey, most: int, excluded: Mask) -> Features:
        settings = self.settings
        pixels, responses = find_corners(grey, settings.gftt, most=most, excluded=excluded)
        pixels = refine_corners(
            grey, pixels, half_window=settings.subpixel_window, iterations=settings.subpixel_iterations,
            epsilon=settings.subpixel_epsilon,
        )  # fmt: skip
        return described_corners(grey, pixels, responses, angle_rad=_UPRIGHT[settings.detector])

    def _within_depth(self, features: Features) -> Features:
        """Drop what is too near or too far; what has no depth stays, unless depth is a mask."""
        settings, depth = self.settings, features.depth
        out = depth < settings.min_depth_m  # NaN: unknown
        if settings.max_depth_m > 0.0:
            out |= depth > settings.max_depth_m
        return rows_of(features, np.flatnonzero(~out)) if out.any() else features


def _reduced_camera(camera: Pinhole, step: int) -> Pinhole:
    return replace(
        camera, fx=camera.fx / step, fy=camera.fy / step, cx=(camera.cx + 0.5) / step - 0.5, cy=(camera.cy + 0.5) / step - 0.5,
        width=camera.width // step, height=camera.height // step, bounds=None,
    )  # fmt: skip


def _enlarged(features: Features, step: int) -> Features:
    """Features of a reduced image in pixels of the image itself."""
    if step <= 1:
        return features
    pixels = (features.pixels + 0.5) * step - 0.5
    return replace(
        features, pixels=pixels, raw_pixels=pixels.copy(), right=(features.right + 0.5) * step - 0.5,
        sigmas=features.sigmas * step,
    )  # fmt: skip
