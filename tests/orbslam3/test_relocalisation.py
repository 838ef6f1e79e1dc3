# SPDX-License-Identifier: MIT
"""A frame is found in a map by descriptors alone, to where it was taken; what does not fit is refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.relocalisation import RelocalisationSettings, alike, relocalise
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=300.0, fy=300.0, cx=160.0, cy=120.0, width=320, height=240, baseline_m=0.1)
MONO = Pinhole(fx=300.0, fy=300.0, cx=160.0, cy=120.0, width=320, height=240)
SCALES = 1.2 ** np.arange(8.0)
SETTINGS = RelocalisationSettings()


def pose(x, yaw=0.0):
    T = np.eye(4)
    T[0, 0] = T[2, 2] = np.cos(yaw)
    T[0, 2], T[2, 0] = np.sin(yaw), -np.sin(yaw)
    T[:3, 3] = T[:3, :3] @ np.array([-x, 0.0, 0.0])
    return T


class World:
    """Points on two walls, each with a descriptor of its own."""

    def __init__(self, seed, count=700):
        self.rng = np.random.default_rng(seed)
        self.positions = np.column_stack(
            [self.rng.uniform(-4, 6, count), self.rng.uniform(-1.5, 1.5, count), self.rng.uniform(2.5, 5, count)]
        )
        self.descriptors = self.rng.integers(0, 256, (count, 32), np.uint8)

    def frame(self, number, T, camera=CAMERA, noise=0.3, wrong=20):
        """What a camera at a pose sees, with noise, and `wrong` features that are nothing; and the point of each feature."""
        at = self.positions @ T[:3, :3].T + T[:3, 3]
        pixels = camera.project(at)
        inside = (at[:, 2] > 0.1) & (pixels > 1).all(axis=1) & (pixels < np.array([319, 239])).all(axis=1)
        ids = np.flatnonzero(inside)
        n = len(ids) + wrong
        pixels = np.vstack(
            [pixels[ids] + self.rng.normal(0, noise, (len(ids), 2)), self.rng.uniform(0, 239, (wrong, 2))]
        )
        flips = np.packbits(self.rng.random((len(ids), 256)) < 0.05, axis=1)
        other = self.rng.integers(0, 256, (wrong, 32), np.uint8)
        depth = np.concatenate([at[ids, 2], np.full(wrong, np.nan)]) if camera.bf > 0 else np.full(n, np.nan)
        features = Features(
            pixels=pixels, raw_pixels=pixels, octaves=np.zeros(n, np.int64), angles=np.zeros(n), responses=self.rng.random(n),
            descriptors=np.vstack([self.descriptors[ids] ^ flips, other]), sigmas=np.ones(n),
            right=pixels[:, 0] - camera.bf / depth if camera.bf > 0 else np.full(n, np.nan), depth=depth,
        )  # fmt: skip
        order = self.rng.permutation(n)
        features = Features(**{name: getattr(features, name)[order] for name in Features.__slots__})
        frame = Frame(
            number=number, stamp_ns=number, features=features, grid=feature_grid(features, camera), T_camera_map=T,
            points=np.full(n, -1, np.int64),
        )  # fmt: skip
        return frame, np.concatenate([ids, np.full(wrong, -1)])[order]

    def build(self, xs, camera=CAMERA):
        """The map that keyframes at places along x see; its points are the world's."""
        sparse_map = SparseMap(camera, SCALES)
        frames = [self.frame(i, pose(x), camera) for i, x in enumerate(xs)]
        blank = Frame(
            number=0, stamp_ns=0, features=frames[0][0].features, grid=frames[0][0].grid, points=frames[0][0].points
        )
        blank.T_camera_map = pose(xs[0])
        sparse_map.add_keyframe(blank, -1)
        first = np.arange(len(self.positions)) % len(blank.features)
        sparse_map.add_points(self.positions, 0, first)
        sparse_map.see(0, np.arange(sparse_map.seen.shape[1]), -1)
        sparse_map.see(0, np.arange(len(frames[0][1])), frames[0][1])
        for i, (frame, ids) in enumerate(frames[1:], 1):
            frame.points = ids.copy()
            sparse_map.add_keyframe(frame, i - 1)
        seen = sparse_map.points_of(np.arange(len(xs)))
        sparse_map.remove_points(np.setdiff1d(np.arange(len(self.positions)), seen))
        sparse_map.refresh_points(seen)
        return sparse_map


@pytest.mark.parametrize("camera", [CAMERA, MONO])
def test_a_frame_is_found_where_it_was_taken(camera):
    world = World(1)
    sparse_map = world.build((0.0, 0.3, 0.6, 1.5), camera)
    T = pose(0.4, 0.12)
    frame, ids = world.frame(9, T, camera)
    before = sparse_map.seen.copy(), frame.points.copy()
    found = relocalise(sparse_map, frame, [3, 1], SETTINGS)
    assert found.found
    assert found.reason == ""
    assert np.abs(found.T_camera_map - T).max() < 5e-3
    right = found.points >= 0
    assert found.num_held == right.sum() >= 100
    assert np.array_equal(found.points[right], ids[right])
    assert np.array_equal(sparse_map.seen, before[0])
    assert np.array_equal(frame.points, before[1])


def test_the_candidate_that_holds_most_wins_and_the_same_comes_again():
    world = World(2)
    sparse_map = world.build((0.0, 0.3, 2.4))
    sparse_map.see(2, np.arange(0, sparse_map.seen.shape[1], 2), -1)
    sparse_map.covisible = lambda keyframe: (np.empty(0, np.int64), np.empty(0, np.int64))  # each stands alone
    frame, _ = world.frame(9, pose(0.1))
    every = RelocalisationSettings(surely_held=10_000, least_held=20)
    held = [relocalise(sparse_map, frame, [k], every).num_held for k in (0, 1, 2)]
    assert held[2] < min(held[:2])
    one, two = (relocalise(sparse_map, frame, [2, 0, 1], every) for _ in range(2))
    assert one.num_held == max(held)
    assert one.keyframe == held.index(max(held))
    assert one.T_camera_map.tobytes() == two.T_camera_map.tobytes()


def test_what_is_not_in_the_map_is_refused_with_a_reason():
    world, other = World(3), World(4)
    sparse_map = world.build((0.0, 0.3))
    elsewhere, _ = other.frame(9, pose(0.0))
    missed = relocalise(sparse_map, elsewhere, [0, 1], SETTINGS)
    assert not missed.found
    assert missed.T_camera_map is None
    assert "of 2 keyframes none has 15 points that look like its features" in missed.reason
    assert relocalise(sparse_map, elsewhere, [], SETTINGS).reason == "no keyframe looks like it"


def test_too_few_points_that_hold_are_refused():
    world = World(5)
    sparse_map = world.build((0.0, 0.3))
    frame, ids = world.frame(9, pose(0.1))
    strict = RelocalisationSettings(least_held=10_000)
    missed = relocalise(sparse_map, frame, [0], strict)
    assert not missed.found
    assert 100 <= missed.num_held <= (ids >= 0).sum()
    assert f"none explains 10000 of its features (at most {missed.num_held})" in missed.reason


def test_repeated_texture_at_another_place_is_refused():
    """Half of the features look like points of the map, but no pose explains them."""
    world = World(6)
    sparse_map = world.build((0.0, 0.3))
    frame, ids = world.frame(9, pose(0.1))
    shuffled = frame.features.pixels[np.random.default_rng(0).permutation(len(ids))]
    frame.features.pixels[:] = shuffled
    frame.features.right[:] = np.nan
    missed = relocalise(sparse_map, frame, [0, 1], SETTINGS)
    assert not missed.found
    assert "none explains 50" in missed.reason


def test_keyframes_are_found_by_descriptors_alone():
    world = World(7)
    sparse_map = world.build((0.0, 0.3, 0.6, 4.0))
    frame, _ = world.frame(9, pose(3.8))
    assert alike(sparse_map, frame, SETTINGS)[0] == 3
    sparse_map.remove_keyframe(3)
    assert 3 not in alike(sparse_map, frame, SETTINGS)
    empty, _ = world.frame(9, pose(100.0), wrong=0)
    assert alike(sparse_map, empty, SETTINGS) == []
    assert not relocalise(sparse_map, empty, [0, 1], SETTINGS).found
