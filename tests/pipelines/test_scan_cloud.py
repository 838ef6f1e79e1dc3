# SPDX-License-Identifier: MIT
"""A planar scan as points, and points as a planar scan."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.measurements import LaserScan
from slamcli.pipelines.scan_cloud import cloud_of, scan_of


def test_there_and_back() -> None:
    ranges = 3.0 + np.sin(np.arange(360) / 20.0)
    ranges[40:50] = np.inf
    scan = LaserScan(
        stamp_ns=5, frame_id="l", angle_min_rad=-np.pi, angle_increment_rad=np.radians(1.0), range_min_m=0.1, range_max_m=10.0,
        ranges_m=ranges.astype(np.float32),
    )  # fmt: skip
    points = cloud_of(scan).points_m[:, :2].astype(np.float64)
    back = scan_of(points, stamp_ns=5, frame_id="l", topic="/scan", range_max_m=10.0)
    assert np.isfinite(back.ranges_m).sum() == 350
    again = cloud_of(back).points_m[:, :2]
    order = np.argsort(np.arctan2(points[:, 1], points[:, 0]))
    again = again[np.argsort(np.arctan2(again[:, 1], again[:, 0]))]
    # A sixteenth of a degree at 4 m.
    assert np.linalg.norm(again - points[order], axis=1).max() < 4.0 * np.radians(1.0 / 16) + 1e-6
    np.testing.assert_allclose(np.hypot(*again.T), np.hypot(*points[order].T), rtol=1e-6)
    assert (back.stamp_ns, back.topic, back.range_max_m) == (5, "/scan", 10.0)


def test_the_nearer_of_two_in_one_direction_and_no_points_at_all() -> None:
    both = np.array([[2.0, 0.0], [1.0, 0.0], [0.0, 3.0]])
    found = scan_of(both, stamp_ns=0, frame_id="l", topic="/s", range_max_m=0.0)
    np.testing.assert_allclose(np.sort(found.ranges_m[np.isfinite(found.ranges_m)]), [1.0, 3.0])
    assert found.range_max_m == 4.0
    empty = scan_of(np.zeros((0, 2)), stamp_ns=0, frame_id="l", topic="/s", range_max_m=8.0)
    assert not np.isfinite(empty.ranges_m).any()
    assert empty.num_beams == 1


@pytest.mark.parametrize("clockwise", [False, True])
def test_a_sweep_keeps_its_times(clockwise: bool) -> None:
    scan = LaserScan(
        stamp_ns=5, frame_id="l", angle_min_rad=2.0, angle_increment_rad=0.01, range_min_m=0.1, range_max_m=10.0,
        ranges_m=np.linspace(2.0, 3.0, 201, dtype=np.float32), time_increment_s=-5e-4 if clockwise else 5e-4,
    )  # fmt: skip
    cloud = cloud_of(scan)  # across the cut at half a turn
    back = cloud_of(
        scan_of(cloud.points_m[:, :2].astype(np.float64), stamp_ns=5, frame_id="l", topic="", offset_ns=cloud.offset_ns)
    )
    np.testing.assert_allclose(back.points_m, cloud.points_m, atol=3e-3)
    assert cloud.offset_ns is not None
    assert back.offset_ns is not None
    np.testing.assert_allclose(back.offset_ns, cloud.offset_ns, atol=100_000)
