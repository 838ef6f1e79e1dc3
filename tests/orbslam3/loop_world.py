# SPDX-License-Identifier: MIT
"""Maps of a round room built directly: matches are known, drift comes from a focal length that is slightly wrong."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slamcli.geometry import se3
from slamcli.orbslam3.bundles import adjust_local
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.pose_optimisation import optimise_pose
from slamcli.vision.triangulation import triangulate

SCALES = 1.2 ** np.arange(8.0)
MEMORY = 6
"""Keyframes after which a point is forgotten: seen again, it becomes another one."""


def camera(*, stereo, focal=300.0):
    return Pinhole(fx=focal, fy=focal, cx=320.0, cy=240.0, width=640, height=480, baseline_m=0.12 if stereo else 0.0)


def wall_points(rng, count, radius=5.0):
    """Points on the wall of a round room, z along the axis."""
    angle = rng.uniform(0, 2 * np.pi, count)
    r = radius + rng.normal(0, 0.4, count)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), rng.uniform(-1.5, 1.5, count)])


def true_pose(turn, radius=2.0):
    """T_camera_world of a camera that looks outwards from a circle, at an angle in radians."""
    c, s = np.cos(turn), np.sin(turn)
    ahead, right, down = np.array([c, s, 0]), np.array([s, -c, 0]), np.array([0, 0, -1.0])
    rotation = np.stack([right, down, ahead])
    return se3.from_rotation_translation(rotation, -rotation @ np.array([radius * c, radius * s, 0]))


@dataclass
class World:
    """Things to be seen, and what was made of them."""

    seed: int = 0
    count: int = 1500
    stereo: bool = True
    focal_error: float = 0.004
    noise_px: float = 0.5
    points: np.ndarray = field(init=False)
    descriptors: np.ndarray = field(init=False)

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed)
        self.points = wall_points(self.rng, self.count)
        self.descriptors = self.rng.integers(0, 256, (self.count, 32), dtype=np.uint8)
        self.camera = camera(stereo=self.stereo)
        self.lens = camera(stereo=self.stereo, focal=self.camera.fx * (1 + self.focal_error))
        self.truth = []
        """True poses of the keyframes of the map that is being built."""
        self.physical = {}
        """Which thing a map point is: (map id, point) -> thing."""

    def look(self, T_camera_world):
        """Features of what a camera sees, and which things they are."""
        rng = self.rng
        at_camera = self.points @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
        ahead = np.flatnonzero(at_camera[:, 2] > 0.5)
        pixels = self.lens.project(at_camera[ahead])
        x_min, y_min, x_max, y_max = self.camera.limits
        inside = (pixels[:, 0] > x_min) & (pixels[:, 0] < x_max) & (pixels[:, 1] > y_min) & (pixels[:, 1] < y_max)
        things, pixels = ahead[inside], pixels[inside]
        distance = np.linalg.norm(at_camera[things], axis=1)
        # as if every thing were as large as 3 m away at octave 3
        octaves = np.clip(np.round(3 - np.log(distance / 3.0) / np.log(1.2)), 0, 7).astype(np.int64)
        sigmas = SCALES[octaves]
        pixels = pixels + self.noise_px * rng.normal(size=pixels.shape) * sigmas[:, None] / 2
        right, depth = np.full(len(things), np.nan), np.full(len(things), np.nan)
        if self.stereo:
            right = pixels[:, 0] - self.lens.bf / at_camera[things, 2] + 0.2 * rng.normal(size=len(things))
            depth = self.camera.bf / np.maximum(pixels[:, 0] - right, 0.1)
        flips = np.packbits(rng.random((len(things), 256)) < 0.03, axis=1)
        features = Features(
            pixels=pixels, octaves=octaves, angles=np.zeros(len(things)), responses=rng.random(len(things)),
            descriptors=self.descriptors[things] ^ flips, sigmas=sigmas, right=right, depth=depth, raw_pixels=pixels,
        )  # fmt: skip
        return features, things

    def build(self, turns, start=None):
        """A map of keyframes at true angles; `start` is where the first one believes to be."""
        sparse_map = SparseMap(self.camera, SCALES)
        self.truth, last_seen = [], {}  # thing -> (point, keyframe)
        for k, turn in enumerate(turns):
            T_true = true_pose(turn)
            features, things = self.look(T_true)
            if k == 0:
                T = np.eye(4) if start is None else start
            else:
                T = T_true @ se3.inverse(self.truth[-1]) @ sparse_map.T_camera_map[k - 1]
            ids = np.array(
                [last_seen[t][0] if t in last_seen and k - last_seen[t][1] <= MEMORY else -1 for t in things]
            )
            ids = sparse_map.resolved(ids)
            old = np.flatnonzero(ids >= 0)
            if k > 1:
                found = optimise_pose(
                    T, sparse_map.positions[ids[old]], features.pixels[old], features.right[old], features.sigmas[old],
                    self.camera,
                )  # fmt: skip
                T = found.T_camera_map
                ids[old[~found.inliers]] = -1
            frame = Frame(
                number=k, stamp_ns=k * 10**8, features=features, grid=feature_grid(features, self.camera), T_camera_map=T,
                points=ids,
            )  # fmt: skip
            sparse_map.add_keyframe(frame, k - 1)
            self.truth.append(T_true)
            self._create(sparse_map, k, features, things)
            for i, thing in enumerate(things.tolist()):
                point = int(sparse_map.seen[k, i])
                if point >= 0:
                    last_seen[thing] = (point, k)
                    self.physical[id(sparse_map), point] = thing
            sparse_map.refresh_points(sparse_map.points_of(np.array([k])))
            if k > 1:
                adjust_local(sparse_map, k, most=8)
        return sparse_map

    def _create(self, sparse_map, k, features, things):
        free = np.flatnonzero(sparse_map.seen[k, : len(things)] < 0)
        if self.stereo:
            near = free[features.depth[free] < 6.0]
            T = se3.inverse(sparse_map.T_camera_map[k])
            points = self.camera.back_project(features.pixels[near], features.depth[near]) @ T[:3, :3].T + T[:3, 3]
            sparse_map.add_points(points, k, near)
        elif k:
            before = {t: i for i, t in enumerate(self._things) if sparse_map.seen[k - 1, i] < 0}
            pairs = np.array([(i, before[t]) for i, t in enumerate(things) if i in set(free.tolist()) and t in before])
            if len(pairs):
                a, b = pairs.T
                last = sparse_map.features(k - 1)
                made = triangulate(
                    sparse_map.T_camera_map[k], sparse_map.T_camera_map[k - 1], features.pixels[a], last.pixels[b],
                    self.camera, sigmas_a=features.sigmas[a], sigmas_b=last.sigmas[b],
                )  # fmt: skip
                ids = sparse_map.add_points(made.points[made.ok], k, a[made.ok])
                sparse_map.see(k - 1, b[made.ok], ids)
        self._things = things


def position_error(sparse_map, truth, *, with_scale=False):
    """Largest and root mean square distance of living keyframes from the truth, metres, both seen from the first."""
    from slamcli.geometry.alignment import umeyama

    living = sparse_map.living_keyframes
    centres = sparse_map.centres[living]
    wanted = np.array([se3.inverse(truth[k])[:3, 3] for k in living])
    lay = umeyama(centres, wanted, with_scale=with_scale)
    distance = np.linalg.norm(lay.transform_points(centres) - wanted, axis=1)
    return float(distance.max()), float(np.sqrt((distance**2).mean()))
