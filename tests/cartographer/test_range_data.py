# SPDX-License-Identifier: MIT
"""Which readings of a sensor are returns, which are misses, and where they lie in the plane of the base."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.cartographer.parameters import TrajectoryBuilder2d
from slamcli.cartographer.range_data import RangeSensor, sweep_seconds
from slamcli.geometry import quaternion, se3
from slamcli.measurements import LaserScan, PointCloud


def scan(values, **changes):
    settings = {
        "stamp_ns": 1, "frame_id": "laser", "angle_min_rad": 0.0, "angle_increment_rad": math.pi / 2, "range_min_m": 0.1,
        "range_max_m": 20.0, "ranges_m": np.array(values, dtype=np.float32),
    }  # fmt: skip
    return LaserScan(**settings | changes)


def cloud(points, offset_ns=None):
    return PointCloud(
        stamp_ns=1, frame_id="lidar", points_m=np.array(points, np.float32),
        offset_ns=None if offset_ns is None else np.array(offset_ns, np.int64),
    )  # fmt: skip


def sensor(mount=None, no_return="ignore", **parameters):
    return RangeSensor(TrajectoryBuilder2d(**parameters), np.eye(4) if mount is None else mount, no_return)


def test_readings_outside_the_scanners_limits_are_dropped():
    found = sensor(max_range=10.0).range_data(scan([2.0, math.nan, math.inf, 25.0]))
    np.testing.assert_allclose(found.returns, [[2.0, 0.0]], atol=1e-6)
    assert found.misses.shape == (0, 2)
    found = sensor().range_data(scan([0.05, 0.0, -1.0, -math.inf]))
    assert found.returns.shape == found.misses.shape == (0, 2)
    assert sensor().range_data(scan([])).returns.shape == (0, 2)


def test_readings_beyond_max_range_are_misses_of_a_given_length():
    found = sensor(max_range=10.0, missing_data_ray_length=5.0).range_data(scan([2.0, 12.0, 10.0, 10.1]))
    np.testing.assert_allclose(found.returns, [[2.0, 0.0], [-10.0, 0.0]], atol=1e-5)
    np.testing.assert_allclose(found.misses, [[0.0, 5.0], [0.0, -5.0]], atol=1e-5)


def test_a_miss_is_no_longer_than_max_range():
    found = sensor(max_range=3.0, missing_data_ray_length=5.0).range_data(scan([12.0]))
    np.testing.assert_allclose(found.misses, [[3.0, 0.0]])


def test_min_range_and_the_scanners_own_minimum():
    assert len(sensor(min_range=0.5).range_data(scan([0.4, 0.5, 0.6])).returns) == 2
    assert len(sensor(min_range=0.0).range_data(scan([0.05, 0.1, 0.2])).returns) == 2


def test_no_return_is_free_space_if_the_user_says_so():
    found = sensor(no_return="free", missing_data_ray_length=4.0).range_data(scan([2.0, math.inf, 21.0, math.nan]))
    np.testing.assert_allclose(found.returns, [[2.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(found.misses, [[0.0, 4.0], [-4.0, 0.0]], atol=1e-6)


def test_the_mount_moves_turns_and_flips():
    mount = se3.from_position_quaternion([0.5, -0.2, 0.3], quaternion.from_yaw(math.pi / 2))
    found = sensor(mount).range_data(scan([1.0, 2.0]))
    np.testing.assert_allclose(found.start, [0.5, -0.2])
    np.testing.assert_allclose(found.returns, [[0.5, 0.8], [-1.5, -0.2]], atol=1e-6)
    flipped = se3.from_position_quaternion([0, 0, 0.3], quaternion.from_roll_pitch_yaw(math.pi, 0.0, 0.0))
    np.testing.assert_allclose(sensor(flipped).range_data(scan([1.0, 2.0])).returns, [[1, 0], [0, -2]], atol=1e-6)


def test_a_tilted_base_is_levelled():
    tilt = quaternion.from_roll_pitch_yaw(0.0, math.radians(20.0), 0.0)
    mount = se3.from_position_quaternion([0.0, 0.0, 0.5], quaternion.from_yaw(0.0))
    found = sensor(mount, min_z=-5.0).range_data(scan([2.0, 2.0]), tilt_xyzw=tilt)
    np.testing.assert_allclose(found.start, [0.5 * math.sin(math.radians(20.0)), 0.0], atol=1e-9)
    ahead = found.start + np.array([2.0 * math.cos(math.radians(20.0)), 0.0])
    np.testing.assert_allclose(found.returns, [ahead, found.start + np.array([0.0, 2.0])], atol=1e-6)


def test_points_below_and_above_the_slice_are_left_out():
    found = sensor(min_z=0.1, max_z=1.0).range_data(cloud([[2, 0, 0.05], [2, 0, 0.5], [2, 0, 1.5], [0, 0, 0]]))
    np.testing.assert_allclose(found.returns, [[2.0, 0.0]], atol=1e-6)


def test_clouds_have_returns_and_misses_along_their_rays():
    parameters = {"max_range": 10.0, "missing_data_ray_length": 5.0, "min_range": 1.0, "min_z": -9.0, "max_z": 9.0}
    found = sensor(**parameters).range_data(
        cloud([[3, 4, 0], [0.5, 0, 0], [0, 12, 16], [np.nan, 0, 0], [np.inf, 1, 0]])
    )
    np.testing.assert_allclose(found.returns, [[3, 4]], atol=1e-6)
    np.testing.assert_allclose(found.misses, [[0, 3]], atol=1e-6)


@pytest.mark.parametrize("reverse", [False, True])
def test_a_sweep_while_driving_is_put_right(reverse):
    twist = np.array([1.0, 0.0, 0.5])
    swept = scan([2.0, math.nan, 3.0, 1.0], time_increment_s=-0.1 if reverse else 0.1)
    found, still = sensor().range_data(swept, twist=twist), sensor().range_data(swept)
    times = np.array([3, 1, 0] if reverse else [0, 2, 3]) * 0.1
    for seconds, seen, where in zip(times, still.returns, found.returns, strict=True):
        c, s = math.cos(0.5 * seconds), math.sin(0.5 * seconds)
        np.testing.assert_allclose(where, np.array([[c, -s], [s, c]]) @ seen + [seconds, 0.0], atol=1e-9)
    points = cloud([[2, 0, 0], [0, 2, 0]], offset_ns=[0, 200_000_000])
    np.testing.assert_allclose(
        sensor().range_data(points, twist=np.array([1.0, 0, 0])).returns, [[2, 0], [0.2, 2]], atol=1e-6
    )


def test_a_fan_that_changes_is_followed():
    made = sensor()
    first = made.range_data(scan([1.0, 1.0])).returns
    made.range_data(scan([1.0, 1.0, 1.0], angle_min_rad=1.0))
    np.testing.assert_array_equal(made.range_data(scan([1.0, 1.0])).returns, first)


def test_the_length_of_a_sweep():
    assert sweep_seconds(scan([1, 2, 3], time_increment_s=-0.1)) == pytest.approx(0.2)
    assert sweep_seconds(scan([], time_increment_s=0.1)) == 0.0
    assert sweep_seconds(cloud([[1, 0, 0], [2, 0, 0]])) == 0.0
    assert sweep_seconds(cloud([[1, 0, 0], [2, 0, 0]], offset_ns=[-10, 90_000_000])) == pytest.approx(0.09, abs=1e-6)
    assert sweep_seconds(cloud(np.empty((0, 3)), offset_ns=[])) == 0.0


def test_returns_are_beams_of_scan_odometry():
    beams = sensor(max_range=10.0).range_data(scan([2.0, 12.0, 3.0])).as_beams()
    np.testing.assert_allclose(beams.points, [[2, 0], [-3, 0]], atol=1e-6)
    assert beams.ends is beams.points
    assert beams.hit.tolist() == [True, True]
    assert beams.start.shape == (1, 2)
