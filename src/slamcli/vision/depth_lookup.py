# SPDX-License-Identifier: MIT
"""Depth of key points from a depth image of the same camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole


def with_depth(features: Features, depth: NDArray[np.float32], camera: Pinhole) -> Features:
    """Return the features with the depth of the nearest pixel, and the column that a virtual right camera would see.

    Parameters
    ----------
    features
        N key points; `raw_pixels` say where in the depth image they lie.
    depth
        float32 (H, W), metres along z, registered to the image; 0 and what is not finite or negative means unknown.
    camera
        Its baseline, metres, is that of the virtual right camera: right = x - bf / depth. Without one, `right` stays NaN.

    Raises
    ------
    DataError
        If the depth image is not (H, W).
    """
    if depth.ndim != 2:
        raise DataError(f"depth image: shape {depth.shape}, not (H, W)")
    columns, rows = np.rint(features.raw_pixels).astype(np.int64).T
    inside = (columns >= 0) & (columns < depth.shape[1]) & (rows >= 0) & (rows < depth.shape[0])
    found = np.full(len(features), np.nan)
    found[inside] = depth[rows[inside], columns[inside]]
    found[~(np.isfinite(found) & (found > 0.0))] = np.nan
    right = features.pixels[:, 0] - camera.bf / found if camera.bf > 0.0 else np.full(len(features), np.nan)
    return replace(features, depth=found, right=right)
