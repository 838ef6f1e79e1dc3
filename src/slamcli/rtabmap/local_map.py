# SPDX-License-Identifier: MIT
"""The points that odometry tracks, and the keyframes that saw them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.vision.features import Features
from slamcli.vision.matching import FeatureGrid, best_descriptors, feature_grid
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.point_projection import PointAppearance, SeenPoints, project_visible

Floats = NDArray[np.float64]
Ids = NDArray[np.int64]
_ONE_SCALE_REACH = 2.0
"""Key points without a pyramid are known again when they look up to so many times larger or smaller."""


@dataclass(slots=True, kw_only=True, eq=False)
class Keyframe:
    """A frame that the local map took in."""

    number: int
    """Among all keyframes."""
    features: Features
    grid: FeatureGrid
    T_camera_odom: Floats
    """float64 (4, 4)."""
    points: Ids
    """(N,), row of the map's point that each feature sees, or -1."""

    def mean_motion(self, features: Features, points: Ids) -> float:
        """Return by how many pixels the points that another frame sees too (M,) moved on average; infinite where there are none."""
        _, here, there = np.intersect1d(
            np.where(self.points >= 0, self.points, -1), np.where(points >= 0, points, -2), return_indices=True
        )
        moved = np.linalg.norm(features.pixels[there] - self.features.pixels[here], axis=1)
        return float(moved.mean()) if len(moved) else np.inf


class LocalMap:
    """Points as columns, and the keyframes that see some of them; rows move when points are dropped."""

    def __init__(self, camera: Pinhole, scales: tuple[float, ...], *, num_before: int = 0) -> None:
        self.camera, self.scales = camera, np.array(scales, dtype=np.float64)
        self.keyframes: list[Keyframe] = []
        """The newest last."""
        self.num_keyframes = num_before
        """That there have been."""
        self.positions = np.zeros((0, 3))
        self.normals = np.zeros((0, 3))
        self.near, self.far = np.zeros(0), np.zeros(0)
        self.descriptors = np.zeros((0, 32), dtype=np.uint8)
        self.last_seen = np.zeros(0, dtype=np.int64)
        """Number of the frame."""
        self.visible, self.found = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        """Frames that should have seen it, and those that did."""

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.positions)

    def seen_from(self, T_camera_odom: Floats, rows: Ids | None = None) -> SeenPoints:
        """Return which points a camera at a pose sees."""
        points = PointAppearance(self.positions, self.normals, self.near, self.far)
        chosen = np.arange(len(self)) if rows is None else rows
        return project_visible(points, chosen, T_camera_odom, self.camera, self.scales)

    def note_sightings(self, points: Ids, visible: Ids, frame: int) -> None:
        """Note the rows `visible` that a frame should have seen, and what its features saw: `points` (N,), -1 for none."""
        seen = points[points >= 0]
        self.visible[visible] += 1
        self.found[seen] += 1
        self.last_seen[seen] = frame

    def add_keyframe(
        self, features: Features, grid: FeatureGrid | None, T_camera_odom: Floats, points: Ids
    ) -> Keyframe:
        """Append a frame with the points that it sees (N,)."""
        keyframe = Keyframe(
            number=self.num_keyframes, features=features, grid=grid or feature_grid(features, self.camera),
            T_camera_odom=T_camera_odom.copy(), points=points.copy(),
        )  # fmt: skip
        self.keyframes.append(keyframe)
        self.num_keyframes += 1
        return keyframe

    def add_points(self, keyframe: Keyframe, features: Ids, frame: int) -> Ids:
        """Append the points of a keyframe's features (M,) with depth; return their rows."""
        seen = keyframe.features
        positions = _placed(
            keyframe.T_camera_odom, self.camera.back_project(seen.pixels[features], seen.depth[features])
        )
        count = len(features)
        rows = np.arange(len(self), len(self) + count)
        self.positions = np.concatenate([self.positions, positions])
        self.normals = np.concatenate([self.normals, np.zeros((count, 3))])
        self.near = np.concatenate([self.near, np.zeros(count)])
        self.far = np.concatenate([self.far, np.zeros(count)])
        self.descriptors = np.concatenate([self.descriptors, seen.descriptors[features]])
        self.last_seen = np.concatenate([self.last_seen, np.full(count, frame)])
        self.visible = np.concatenate([self.visible, np.ones(count, dtype=np.int64)])
        self.found = np.concatenate([self.found, np.ones(count, dtype=np.int64)])
        keyframe.points[features] = rows
        return rows

    def sightings(self) -> tuple[Ids, Ids, Ids]:
        """Return who sees what: places in `keyframes` (M,), features (M,) and points (M,), keyframe after keyframe."""
        places, features, points = [], [], []
        for place, keyframe in enumerate(self.keyframes):
            at = np.flatnonzero(keyframe.points >= 0)
            places.append(np.full(len(at), place))
            features.append(at)
            points.append(keyframe.points[at])
        if not places:
            none = np.zeros(0, dtype=np.int64)
            return none, none, none
        return np.concatenate(places), np.concatenate(features), np.concatenate(points)

    def refresh(self) -> None:
        """Compute direction, distances and descriptors of all points anew from who sees them."""
        places, _, points = self.sightings()
        if not len(points):
            return
        centres = np.array([se3.inverse(keyframe.T_camera_odom)[:3, 3] for keyframe in self.keyframes])
        rays = self.positions[points] - centres[places]
        lengths = np.linalg.norm(rays, axis=1) + 1e-12
        sums = np.zeros((len(self), 3))
        np.add.at(sums, points, rays / lengths[:, None])
        self.normals = sums / (np.linalg.norm(sums, axis=1) + 1e-12)[:, None]
        octaves = np.concatenate([k.features.octaves[k.points >= 0] for k in self.keyframes])
        last = np.zeros(len(self), dtype=np.int64)
        last[points] = np.arange(len(points))  # the newest view, as keyframes come in order
        widest = lengths[last] * self.scales[octaves[last]]
        if len(self.scales) > 1:
            self.far, self.near = widest, widest / self.scales[-1]
        else:
            self.far, self.near = widest * _ONE_SCALE_REACH, widest / _ONE_SCALE_REACH
        order = np.argsort(points, kind="stable")
        starts = np.searchsorted(points[order], np.arange(len(self) + 1))
        all_descriptors = np.concatenate([k.features.descriptors[k.points >= 0] for k in self.keyframes])[order]
        best = best_descriptors(all_descriptors, starts)
        known = best >= 0
        self.descriptors[known] = all_descriptors[best[known]]

    def drop(self, gone: NDArray[np.bool_]) -> Ids:
        """Take points (P,) out; return the new rows of all old ones, -1 of those that are gone. Keyframes that then see nothing go too."""
        moved = np.where(gone, -1, np.cumsum(~gone) - 1)
        if gone.any():
            for name in ("positions", "normals", "near", "far", "descriptors", "last_seen", "visible", "found"):
                setattr(self, name, getattr(self, name)[~gone])
            for keyframe in self.keyframes:
                seeing = keyframe.points >= 0
                keyframe.points[seeing] = moved[keyframe.points[seeing]]
        return moved


def _placed(T_camera_odom: Floats, points_camera: Floats) -> Floats:
    T_odom_camera = se3.inverse(T_camera_odom)
    return points_camera @ T_odom_camera[:3, :3].T + T_odom_camera[:3, 3]
