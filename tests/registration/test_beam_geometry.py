# SPDX-License-Identifier: MIT
"""When beams were measured, and where points lie after the motion during a sweep is taken out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.geometry import se2
from slamcli.measurements import LaserScan
from slamcli.registration.beams import moved, sweep_times, turned


def scan(increment, beams=4):
    return LaserScan(
        stamp_ns=0, frame_id="laser", angle_min_rad=0.0, angle_increment_rad=0.1, range_min_m=0.1, range_max_m=9.0,
        ranges_m=np.ones(beams, np.float32), time_increment_s=increment,
    )  # fmt: skip


def test_beams_are_measured_one_after_the_other_in_either_order():
    np.testing.assert_allclose(sweep_times(scan(0.01)), [0.0, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(sweep_times(scan(-0.01)), [0.03, 0.02, 0.01, 0.0])
    assert sweep_times(scan(0.01, 0)).shape == (0,)


def test_turned_vectors():
    vectors, angles = np.random.default_rng(1).normal(size=(9, 2)), np.linspace(-4, 4, 9)
    for vector, angle, found in zip(vectors, angles, turned(vectors, angles), strict=True):
        assert complex(*found) == pytest.approx(complex(*vector) * complex(math.cos(angle), math.sin(angle)))


def test_moved_points_are_each_seen_from_the_pose_at_its_time():
    rng = np.random.default_rng(2)
    points, times, twist = rng.normal(size=(20, 2)), rng.uniform(-0.1, 0.2, 20), np.array([0.7, -0.2, 1.3])
    found = moved(points, times, twist)
    for point, seconds, where in zip(points, times, found, strict=True):
        np.testing.assert_allclose(where, se2.transform_points(twist * seconds, [point])[0], atol=1e-12)
    np.testing.assert_array_equal(moved(points, times, np.zeros(3)), points)
