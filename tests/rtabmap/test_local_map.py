# SPDX-License-Identifier: MIT
"""The points that odometry tracks, and their upkeep."""

from __future__ import annotations

import numpy as np
import pytest
from odometry_world import CAMERA, T_BASE_CAMERA, World, pose

from slamcli.geometry import se3
from slamcli.rtabmap.local_map import LocalMap
from slamcli.rtabmap.map_adjustment import _age, adjust_newest
from slamcli.rtabmap.map_upkeep import insert_keyframe, keep_last_keyframe
from slamcli.rtabmap.odometry_settings import OdometrySettings

WORLD = World(count=8000, seed=3)
SETTINGS = OdometrySettings(scales=(1.0,))


def seen_twice(shift_m: float = 0.1) -> LocalMap:
    """A map of two keyframes, the second of which lies `shift_m` beside where it was taken."""
    local_map = LocalMap(CAMERA, (1.0,))
    first, second = pose(0.0, 0.0, 0.0), pose(0.1, 0.0, 0.02)
    one, other = WORLD.features(first, noise_px=0.0, most=400), WORLD.features(second, noise_px=0.0, most=400, seed=1)
    points = np.full(len(one), -1, dtype=np.int64)
    insert_keyframe(local_map, one, None, se3.inverse(first @ T_BASE_CAMERA), points, 0, SETTINGS, T_BASE_CAMERA)  # type: ignore[arg-type]
    wrong = second.copy()
    wrong[1, 3] += shift_m
    distances = np.bitwise_count(other.descriptors[:, None] ^ one.descriptors[None]).sum(axis=2)
    nearest = distances.argmin(axis=1)
    same = distances.min(axis=1) < 20
    local_map.add_keyframe(other, None, se3.inverse(wrong @ T_BASE_CAMERA), np.where(same, nearest, -1))
    return local_map


def test_ages_of_views_count_later_ones_of_the_same_point() -> None:
    points = np.array([4, 2, 4, 4, 2, 7])
    naive = [int((points[row + 1 :] == point).sum()) for row, point in enumerate(points)]
    np.testing.assert_array_equal(_age(points), naive)


def test_adjustment_puts_a_wrong_keyframe_right() -> None:
    local_map = seen_twice()
    adjust_newest(local_map, 10)
    T = se3.inverse(local_map.keyframes[1].T_camera_odom) @ se3.inverse(T_BASE_CAMERA)
    np.testing.assert_allclose(T[:3, 3], [0.1, 0.0, 0.0], atol=0.01)


def test_motion_in_the_image_is_that_of_shared_points() -> None:
    local_map = seen_twice()
    first, second = local_map.keyframes
    naive = [
        np.linalg.norm(second.features.pixels[there] - first.features.pixels[np.flatnonzero(first.points == point)[0]])
        for there, point in enumerate(second.points)
        if point >= 0
    ]
    assert first.mean_motion(second.features, second.points) == pytest.approx(np.mean(naive))
    assert first.mean_motion(second.features, np.full(len(second.points), -1)) == np.inf


def test_points_go_with_the_keyframes_that_saw_them() -> None:
    local_map = seen_twice()
    before, shared = len(local_map), int(np.count_nonzero(local_map.keyframes[1].points >= 0))
    assert 100 < shared < before
    positions = local_map.positions[local_map.keyframes[1].points[local_map.keyframes[1].points >= 0]]
    keep_last_keyframe(local_map, 1)
    assert len(local_map) == shared
    np.testing.assert_array_equal(
        local_map.positions[local_map.keyframes[0].points[local_map.keyframes[0].points >= 0]], positions
    )
