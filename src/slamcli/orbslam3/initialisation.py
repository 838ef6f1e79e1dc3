# SPDX-License-Identifier: MIT
"""The first keyframes and points of a map."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from slamcli.errors import EstimationError
from slamcli.orbslam3.bundles import adjust_all
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.point_creation import points_from_depth
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.orbslam3.start_refusals import FEW_KEY_POINTS, FEW_MATCHES, LITTLE_DEPTH, NO_PARALLAX
from slamcli.vision.matching import match_brute_force
from slamcli.vision.two_view import initialise_two_view

_LEAST_FEATURES, _LEAST_MATCHES, _LEAST_POINTS, _LEAST_DEEP = 100, 100, 50, 50
_MOST_APART = 60
"""Hamming distance of matches between the first two keyframes: key points of all octaves, anywhere in the image."""


def start_with_depth(
    sparse_map: SparseMap, frame: Frame, close_m: float, least: int, words: Any, refused: Counter[str]
) -> bool:
    """Make the first keyframe of a camera with depth, at the origin; return whether it has `least` features, and depth for enough.

    If not, why is counted in `refused`.
    """
    if len(frame.features) < least or int((frame.features.depth < np.inf).sum()) < _LEAST_DEEP:
        refused[FEW_KEY_POINTS if len(frame.features) < least else LITTLE_DEPTH] += 1
        return False
    frame.T_camera_map = np.eye(4)
    keyframe = sparse_map.add_keyframe(frame, -1, words)
    points_from_depth(sparse_map, keyframe, close_m, frame.colours)
    frame.points = sparse_map.seen[keyframe, : len(frame.features)].copy()
    frame.reference = keyframe
    return True


class MonocularStart:
    """Waits for two frames far enough apart, and makes the first two keyframes and their points of them.

    Why a frame was not one of them is counted in `refused`.
    """

    def __init__(self, seed: int, make_words: Callable[[Frame], Any], refused: Counter[str]) -> None:
        self._seed, self._make_words, self._refused = seed, make_words, refused
        self._first: Frame | None = None

    def take(self, sparse_map: SparseMap, frame: Frame) -> bool:
        """Take the next frame; return whether the map has begun. The median depth of the first keyframe is then 1."""
        if len(frame.features) <= _LEAST_FEATURES:
            self._first = None
            self._refused[FEW_KEY_POINTS] += 1
            return False
        if self._first is None:
            self._begin(frame)
            return False
        matched = match_brute_force(
            self._first.features.descriptors, frame.features.descriptors, max_distance=_MOST_APART, ratio=0.9, mutual=True,
            angles_a=self._first.features.angles, angles_b=frame.features.angles,
        )  # fmt: skip
        at_first = np.flatnonzero(matched >= 0)
        if len(at_first) < _LEAST_MATCHES:
            self._begin(frame)
            self._refused[FEW_MATCHES] += 1
            return False
        at_frame = matched[at_first]
        try:
            start = initialise_two_view(
                self._first.features.pixels[at_first],
                frame.features.pixels[at_frame],
                sparse_map.camera,
                seed=self._seed + frame.number,
            )
        except EstimationError:
            self._refused[NO_PARALLAX] += 1
            return False
        good = np.isfinite(start.points).all(axis=1)
        if good.sum() < _LEAST_POINTS:
            self._refused[NO_PARALLAX] += 1
            return False
        self._build(sparse_map, self._first, frame, start.T_b_a, start.points[good], at_first[good], at_frame[good])
        return True

    def _begin(self, frame: Frame) -> None:
        self._first = frame

    def _build(
        self, sparse_map: SparseMap, first: Frame, frame: Frame, T_b_a: Any, points: Any, at_first: Any, at_frame: Any
    ) -> None:
        scale = 1.0 / float(np.median(points[:, 2]))
        first.T_camera_map = np.eye(4)
        frame.T_camera_map = T_b_a.copy()
        frame.T_camera_map[:3, 3] *= scale
        a = sparse_map.add_keyframe(first, -1, self._make_words(first))
        b = sparse_map.add_keyframe(frame, a, self._make_words(frame))
        colours = None if frame.colours is None else frame.colours[at_frame]
        ids = sparse_map.add_points(points * scale, a, at_first, colours)
        sparse_map.see(b, at_frame, ids)
        sparse_map.refresh_points(ids)
        adjust_all(sparse_map, rounds=(10, 10))
        _normalise(sparse_map, a)
        for part, keyframe in ((first, a), (frame, b)):
            part.points = sparse_map.seen[keyframe, : len(part.features)].copy()
            part.T_camera_map = sparse_map.T_camera_map[keyframe].copy()
            part.reference = keyframe


def _normalise(sparse_map: SparseMap, keyframe: int) -> None:
    """Scale the map such that the median depth of a keyframe is 1."""
    ids = sparse_map.points_of(np.array([keyframe]))
    T = sparse_map.T_camera_map[keyframe]
    scale = 1.0 / float(np.median(sparse_map.positions[ids] @ T[2, :3] + T[2, 3]))
    sparse_map.positions[:] *= scale
    sparse_map.T_camera_map[:, :3, 3] *= scale
    sparse_map.refresh_points(ids)
