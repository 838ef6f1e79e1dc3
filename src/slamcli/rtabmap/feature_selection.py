# SPDX-License-Identifier: MIT
"""Where key points may lie, and which of them are kept."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.feature_settings import FeatureSettings
from slamcli.vision.features import Features
from slamcli.vision.preparation import Preparation
from slamcli.vision.square_covering import spread_evenly

Rows = NDArray[np.int64]


def rows_of(features: Features, rows: Rows) -> Features:
    """Return some of the features, in the order of `rows` (M,)."""
    return Features(**{column.name: getattr(features, column.name)[rows] for column in fields(Features)})


def region_mask(settings: FeatureSettings, height: int, width: int) -> NDArray[np.bool_] | None:
    """Return which pixels (H, W) lie outside the region of interest; None: none."""
    left, right, top, bottom = settings.roi_ratios
    if not any(settings.roi_ratios):
        return None
    outside = np.ones((height, width), dtype=np.bool_)
    outside[
        round(top * height) : round((1.0 - bottom) * height), round(left * width) : round((1.0 - right) * width)
    ] = False
    return outside


class DepthMask:
    """Tells which pixels of a depth image cannot have key points."""

    def __init__(self, settings: FeatureSettings, preparation: Preparation) -> None:
        self._settings = settings
        self._rise: NDArray[np.float32] | None = None
        """(H, W): how much a pixel's point is above the camera, in the base frame, per metre of depth."""
        if settings.floor_threshold_m != 0.0 and preparation.rig.mode == "rgbd":
            v, u = np.mgrid[0 : preparation.height, 0 : preparation.width]
            ideal = preparation.to_pinhole(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)).pixels
            rays = preparation.camera.back_project(ideal, np.ones(len(ideal)))
            up = rays @ preparation.T_base_camera[2, :3]
            self._rise = up.reshape(u.shape).astype(np.float32)
        self._camera_height = float(preparation.T_base_camera[2, 3])

    def excluded(self, depth: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Return bool (H, W): no depth, too near, too far, or below the floor's threshold."""
        settings = self._settings
        farthest = settings.max_depth_m if settings.max_depth_m > 0.0 else np.float32(3e38)
        with np.errstate(invalid="ignore"):
            usable = (depth > 0.0) & (depth >= settings.min_depth_m) & (depth <= farthest)
            if self._rise is not None:
                usable &= self._camera_height + self._rise * depth >= settings.floor_threshold_m
        return ~usable


def chosen_rows(features: Features, settings: FeatureSettings, shape: tuple[int, ...]) -> Rows:
    """Return the rows that are kept, the strongest first; of equals the first.

    Each cell of the grid gives its share of `max_features`.
    """
    order = np.argsort(-features.responses, kind="stable")
    if settings.max_features <= 0:
        return order
    cells = settings.grid_rows * settings.grid_columns
    if cells == 1:
        return _limited(features, order, settings.max_features, settings, shape)
    height, width = shape[0], shape[1]
    pixels = features.raw_pixels
    rows = np.clip((pixels[:, 1] * settings.grid_rows / height).astype(np.int64), 0, settings.grid_rows - 1)
    columns = np.clip((pixels[:, 0] * settings.grid_columns / width).astype(np.int64), 0, settings.grid_columns - 1)
    cell = (rows * settings.grid_columns + columns)[order]
    share = max(1, settings.max_features // cells)
    kept = [_limited(features, order[cell == number], share, settings, shape) for number in range(cells)]
    together = np.zeros(len(order), dtype=np.bool_)
    together[np.concatenate(kept)] = True
    return order[together[order]]


def _limited(features: Features, order: Rows, number: int, settings: FeatureSettings, shape: tuple[int, ...]) -> Rows:
    if settings.spread:
        return order[spread_evenly(features.raw_pixels[order], number, shape[1], shape[0])]
    return order[:number]
