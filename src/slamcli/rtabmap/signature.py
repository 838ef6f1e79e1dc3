# SPDX-License-Identifier: MIT
"""What the memory keeps of one place: its words, its points and what the sensors saw there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NodeScan:
    """What a range sensor saw, in the base frame."""

    points: NDArray[np.float32]
    """(N, 3), metres, base frame: deskewed to the node's stamp."""
    planar: bool
    """Whether it is from a planar scanner: then all points have the scanner's height."""
    T_base_sensor: NDArray[np.float64]
    """(4, 4): where its rays began."""
    range_max_m: float = 0.0
    """0: not known."""
    open_ends: NDArray[np.float32] | None = None
    """(M, 3), metres, base frame: ends of rays that met nothing (known to be free that far)."""

    def moved(self, T_new_old: NDArray[np.float64]) -> NodeScan:
        """Return the scan as it is seen from another place of the base: p_new = T_new_old @ p_old."""
        ends = self.open_ends
        return replace(
            self, points=_moved(self.points, T_new_old), T_base_sensor=T_new_old @ self.T_base_sensor,
            open_ends=None if ends is None else _moved(ends, T_new_old),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NodeImages:
    """What the cameras saw, as the ideal pinhole camera would (undistorted, rectified)."""

    colour: NDArray[np.uint8]
    """(H, W, 3), red first, or (H, W) of a grey camera."""
    camera: Pinhole
    """Of these pixels."""
    T_base_camera: NDArray[np.float64]
    """(4, 4), pose of the ideal camera (optical axes) in the base frame."""
    depth: NDArray[np.float32] | None = None
    """(H, W), metres along z; 0 where unknown."""
    right: NDArray[np.uint8] | None = None
    """(H, W), of a rectified pair."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signature:
    """A place that was visited, a node of the graph. Its weight, which changes, is the memory's."""

    id: int
    """From 1 on, in the order of time; across sessions too."""
    map_id: int
    """Which session, from 0 on: poses of different maps are joined by loop closures only."""
    stamp_ns: int
    T_odom_base: NDArray[np.float64]
    """float64 (4, 4), by odometry, never changed."""
    features: Features
    """N key points, N may be 0; the `Kp/MaxFeatures` that the dictionary quantised come first, by response."""
    points: NDArray[np.float64]
    """float64 (N, 3), metres, base frame: where the key points lie; NaN where their depth is not known."""
    word_ids: NDArray[np.int64]
    """int64 (N,), word of the dictionary, from 1 on; 0 for key points that are not quantised."""
    scan: NodeScan | None = None


def _moved(points: NDArray[np.float32], T_new_old: NDArray[np.float64]) -> NDArray[np.float32]:
    return (points.astype(np.float64) @ T_new_old[:3, :3].T + T_new_old[:3, 3]).astype(np.float32)


def no_features() -> Features:
    """Return features of a node without images: none."""
    column = np.zeros(0)
    return Features(
        pixels=np.zeros((0, 2)), octaves=np.zeros(0, dtype=np.int64), angles=column, responses=column,
        descriptors=np.zeros((0, 32), dtype=np.uint8), sigmas=column, right=column, depth=column, raw_pixels=np.zeros((0, 2)),
    )  # fmt: skip


def is_bad(signature: Signature) -> bool:
    """Return whether a node has no words: it is no place that could be known again."""
    return not (signature.word_ids > 0).any()
