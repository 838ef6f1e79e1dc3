# SPDX-License-Identifier: MIT
"""From a measurement to a frame: prepared images, key points, their depth, their grid, their colours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import CameraRig, Measurement
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.parameters import OrbSlam3Parameters
from slamcli.orbslam3.preparing import preparation_settings
from slamcli.orbslam3.settings import grid_settings, orb_settings
from slamcli.vision.depth_lookup import with_depth
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid
from slamcli.vision.orb import extract_orb
from slamcli.vision.preparation import Preparation, PreparedFrame
from slamcli.vision.reduction import reduced_picture
from slamcli.vision.stereo_matching import match_stereo

_STEP = 8
"""The depth of one column and row in so many is kept, for the occupancy grid."""


class FrameMaker:
    """Makes frames out of what a rig gives; `make` may run on any thread."""

    def __init__(self, parameters: OrbSlam3Parameters, rig: CameraRig) -> None:
        self._orb = orb_settings(parameters)
        self.preparation = Preparation(rig, preparation_settings(parameters, rig))
        weight = parameters.slamcli.depth_weight if rig.mode == "rgbd" else 1.0
        self.camera = replace(self.preparation.camera, depth_weight=weight)
        self.grid_settings = grid_settings(parameters)
        self.scales: NDArray[np.float64] = self._orb.scale_factor ** np.arange(self._orb.num_levels, dtype=np.float64)

    @property
    def depth_pixels(self) -> NDArray[np.float64]:
        """float64 (M, 2), where the depths that a frame keeps lie in the ideal camera; NaN outside."""
        v, u = np.mgrid[0 : self.preparation.height : _STEP, 0 : self.preparation.width : _STEP]
        return self.preparation.to_pinhole(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)).pixels

    def make(self, number: int, measurement: Measurement) -> Frame:
        """Return a frame that sees no map point yet."""
        prepared = self.preparation.prepare(measurement)
        features = self._features(prepared)
        depth = None if prepared.depth is None else prepared.depth[::_STEP, ::_STEP].ravel().astype(np.float16)
        image = prepared.grey if prepared.colour is None else prepared.colour
        return Frame(
            number=number,
            stamp_ns=prepared.stamp_ns,
            features=features,
            grid=feature_grid(features, self.camera),
            points=np.full(len(features), -1, dtype=np.int64),
            colours=colours_at(image, features.raw_pixels),
            depth=depth,
            picture=reduced_picture(image),
        )

    def _features(self, prepared: PreparedFrame) -> Features:
        found = extract_orb(prepared.grey, self._orb)
        if prepared.right is not None:
            right, depth = match_stereo(found, extract_orb(prepared.right, self._orb), self.camera)
            return replace(found.features, right=right, depth=depth)
        features = self.preparation.undistorted(found.features)
        return features if prepared.depth is None else with_depth(features, prepared.depth, self.camera)


def colours_at(image: NDArray[np.uint8], pixels: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return RGB (N, 3) of an image (H, W, 3) RGB or (H, W) grey at pixels (N, 2)."""
    column = np.clip(np.rint(pixels[:, 0]).astype(np.int64), 0, image.shape[1] - 1)
    row = np.clip(np.rint(pixels[:, 1]).astype(np.int64), 0, image.shape[0] - 1)
    values = image[row, column]
    return np.repeat(values[:, None], 3, axis=1) if values.ndim == 1 else values
