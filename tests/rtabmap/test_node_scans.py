# SPDX-License-Identifier: MIT
"""What a node keeps of a sweep: where its points were when it began."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import quaternion, se3
from slamcli.measurements import LaserScan, PointCloud
from slamcli.rtabmap.node_scans import node_scan, sweep_ns

MOUNT = se3.from_position_quaternion(np.array([0.2, 0.0, 0.5]), quaternion.from_yaw(0.3))


def turned(x: float, yaw: float) -> np.ndarray:
    return se3.from_position_quaternion(np.array([x, 0.02, 0.0]), quaternion.from_yaw(yaw))


def carried(points_base: np.ndarray, shares: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Return points, by a naive loop, where they are seen from the base at the beginning of the motion."""
    position, quat = se3.to_position_quaternion(motion)
    out = []
    for point, share in zip(points_base, shares, strict=True):
        q = quaternion.slerp(np.array([0.0, 0.0, 0.0, 1.0]), quat, share)
        out.append(quaternion.to_matrix(q) @ point + share * position)
    return np.array(out)


def test_a_planar_sweep_is_moved_to_its_beginning() -> None:
    scan = LaserScan(
        stamp_ns=0, frame_id="l", angle_min_rad=-1.5, angle_increment_rad=0.3, range_min_m=0.1, range_max_m=10.0,
        ranges_m=np.linspace(1.0, 4.0, 11, dtype=np.float32), time_increment_s=0.01,
    )  # fmt: skip
    assert sweep_ns(scan) == 100_000_000
    still = node_scan(scan, MOUNT)
    motion = turned(0.06, 0.1)
    found = node_scan(scan, MOUNT, T_begin_end=motion)
    expected = carried(still.points.astype(np.float64), np.arange(11) / 10, motion)
    np.testing.assert_allclose(found.points, expected, atol=1e-5)
    assert found.planar
    np.testing.assert_array_equal(node_scan(scan, MOUNT, T_begin_end=np.eye(4)).points, still.points)


def test_a_cloud_is_moved_by_the_time_of_each_point() -> None:
    points = np.random.default_rng(1).uniform(-5.0, 5.0, (40, 3)).astype(np.float32)
    offsets = np.linspace(0, 100_000_000, 40).astype(np.int64)
    cloud = PointCloud(stamp_ns=0, frame_id="l", points_m=points, offset_ns=offsets)
    assert sweep_ns(cloud) == 100_000_000
    motion = turned(0.1, -0.2)
    still, found = node_scan(cloud, MOUNT), node_scan(cloud, MOUNT, T_begin_end=motion)
    np.testing.assert_allclose(found.points, carried(still.points.astype(np.float64), offsets / 1e8, motion), atol=1e-5)
    timeless = PointCloud(stamp_ns=0, frame_id="l", points_m=points)
    np.testing.assert_array_equal(node_scan(timeless, MOUNT, T_begin_end=motion).points, still.points)


@pytest.mark.parametrize(("height", "planar"), [(0.0, True), (0.2, False)])
def test_a_cloud_of_a_planar_scanner_is_known(height: float, planar: bool) -> None:
    points = np.column_stack([np.linspace(1, 2, 5), np.ones(5), np.linspace(0.0, height, 5)]).astype(np.float32)
    assert node_scan(PointCloud(stamp_ns=0, frame_id="l", points_m=points), MOUNT).planar is planar
