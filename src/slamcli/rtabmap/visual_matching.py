# SPDX-License-Identifier: MIT
"""Which features of two places are the same: by their descriptors alone, or near where a motion puts them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.signature import Signature
from slamcli.rtabmap.visual_settings import VisualSettings
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid, match_brute_force, search_by_projection
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]
Pairs = NDArray[np.int64]

CROSS_CHECK = 5
"""Vis/CorNNType: each the other's nearest."""
BITS = 256
LOOSE_BITS, LOOSE_RATIO = 85, 0.95
"""Where strict matching finds nothing that holds: wide changes of view leave the second best as near as the right one."""
GUIDED_BITS, GUIDED_RATIO = 100, 0.9


def match_descriptors(a: Signature, b: Signature, rows: Pairs, settings: VisualSettings, *, loose: bool) -> Pairs:
    """Return rows of a's (among `rows`) and b's features that look most like each other, int64 (M, 2).

    No feature is matched twice. Where key points have a direction, matches must agree on how far the image turned.
    """
    if not len(rows) or not len(b.features):
        return np.zeros((0, 2), np.int64)
    ratio = 1.0 if settings.cor_nn_type == CROSS_CHECK else settings.cor_nndr
    bits = BITS
    if loose:
        bits, ratio = LOOSE_BITS, max(ratio, LOOSE_RATIO)
    turned = _directed(a.features) and _directed(b.features)
    found = match_brute_force(
        a.features.descriptors[rows], b.features.descriptors, max_distance=bits, ratio=ratio,
        angles_a=a.features.angles[rows] if turned else None, angles_b=b.features.angles if turned else None,
    )  # fmt: skip
    hits = np.flatnonzero(found >= 0)
    return np.stack([rows[hits], found[hits]], axis=1)


def match_projected(
    a: Signature, b: Signature, rows: Pairs, T_camera_a: Floats, camera: Pinhole, radius_px: float, ratio: float
) -> Pairs:
    """Return rows of a's (among `rows`) and b's features that match around where a's points are expected, int64 (M, 2).

    Parameters
    ----------
    rows
        int64 (N,), features of a whose points are known.
    T_camera_a
        float64 (4, 4), from the base at a to the camera at b.
    radius_px
        Half the side of the window, pixels at the finest octave.
    ratio
        Best to second best.
    """
    local = a.points[rows] @ T_camera_a[:3, :3].T + T_camera_a[:3, 3]
    ahead = local[:, 2] > 1e-3
    local[~ahead, 2] = 1.0
    pixels = camera.project(local)
    left, top, right, bottom = camera.limits
    u, v = pixels.T
    seen = np.flatnonzero(ahead & (u >= left) & (u < right) & (v >= top) & (v < bottom))
    if not len(seen) or not len(b.features):
        return np.zeros((0, 2), np.int64)
    last = int(b.features.octaves.max())
    count = len(seen)
    found = search_by_projection(
        pixels[seen], np.full(count, radius_px), np.zeros(count, np.int64), np.full(count, last, np.int64),
        a.features.descriptors[rows[seen]], b.features, feature_grid(b.features, camera),
        np.ones(len(b.features), np.bool_), max_distance=GUIDED_BITS, ratio=ratio,
    )  # fmt: skip
    hits = np.flatnonzero(found >= 0)
    return np.stack([rows[seen[hits]], found[hits]], axis=1)


def _directed(features: Features) -> bool:
    """Whether the key points have directions: detectors without leave one and the same."""
    return bool(len(features) and np.ptp(features.angles) > 0)
