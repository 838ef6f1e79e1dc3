# SPDX-License-Identifier: MIT
"""Stamps that jitter, odometry at the time of a scan, and the constant offset between two clocks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import isotonic_regression

from slamcli.geometry import se2
from slamcli.trajectory import time_offset
from slamcli.trajectory.wheel_odometry import WheelOdometry, smooth_stamps

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND


@given(st.lists(st.integers(-SECOND, SECOND), max_size=60))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_smooth_stamps_are_the_isotonic_regression(jitter):
    stamps = EPOCH + np.arange(len(jitter)) * (SECOND // 10) + np.array(jitter, dtype=np.int64)
    smooth = smooth_stamps(stamps)
    assert smooth.dtype == np.int64
    assert len(smooth) == len(stamps)
    assert (np.diff(smooth) > 0).all()
    if (np.diff(stamps) > 0).all():
        np.testing.assert_array_equal(smooth, stamps)
    elif len(stamps):
        twin = isotonic_regression((stamps - EPOCH).astype(float)).x
        np.testing.assert_allclose(smooth - EPOCH, twin, atol=1000 * len(stamps) + 1)
    np.testing.assert_array_equal(smooth_stamps(smooth), smooth)


def test_one_backward_stamp_moves_only_its_neighbours():
    stamps = EPOCH + np.arange(10) * SECOND
    stamps[5] -= 1_500_000_000  # 3.5 s instead of 5 s: between the third and the fourth
    smooth = smooth_stamps(stamps)
    moved = np.flatnonzero(smooth != stamps)
    assert moved.tolist() == [4, 5]
    np.testing.assert_allclose(smooth[4:6] - EPOCH, 3.75 * SECOND, atol=2000)


def test_equal_stamps_become_microseconds_apart():
    smooth = smooth_stamps(np.full(4, EPOCH))
    assert np.diff(smooth).tolist() == [1000, 1000, 1000]


def test_garbage_stamps_still_increase():
    stamps = np.array([0, EPOCH, 5, EPOCH + 1, 2**62], dtype=np.int64)
    assert (np.diff(smooth_stamps(stamps)) > 0).all()


def test_odometry_is_interpolated_over_the_wrap_and_stands_still_outside():
    wheels = WheelOdometry(EPOCH + np.array([0, 2, 3]) * SECOND, np.array([[0, 0, 3.0], [2, 1, -3.0], [2, 1, -2.9]]))
    query = EPOCH + (np.array([-5.0, 0.0, 0.5, 1.0, 2.5, 9.0]) * SECOND).astype(np.int64)
    turn = 2 * np.pi - 6.0
    expected = [
        [0, 0, 3.0], [0, 0, 3.0], [0.5, 0.25, 3.0 + turn / 4], [1, 0.5, 3.0 + turn / 2], [2, 1, -2.95], [2, 1, -2.9]
    ]  # fmt: skip
    found = wheels.at(query)
    np.testing.assert_allclose(found[:, :2], np.array(expected)[:, :2], atol=1e-12)
    np.testing.assert_allclose(se2.wrap_angle(found[:, 2] - np.array(expected)[:, 2]), 0.0, atol=1e-12)
    assert np.abs(found[:, 2]).max() <= np.pi
    single = WheelOdometry(np.array([EPOCH]), np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_array_equal(single.at(query), np.tile([1.0, 2.0, 3.0], (6, 1)))


def turning(offset_s=0.0, scale=1.0, noise=0.0, scans=400, slow=False):
    """Scans at 5 Hz and wheels at 20 Hz that see the same turns, the wheels' clock `offset_s` ahead."""
    rng = np.random.default_rng(7)
    stamps = EPOCH + (np.arange(scans) * 0.2 * SECOND).astype(np.int64)
    wheel_stamps = EPOCH + (np.arange(-40, scans * 4 + 40) * 0.05 * SECOND).astype(np.int64)

    def yaw(t):
        return 3.0 * np.sin(t * 0.1) + 0.5 * t if slow else 1.5 * np.sin(t * 0.9) + 0.6 * np.sin(t * 2.3 + 1)

    turns = np.diff(yaw((stamps - EPOCH) / SECOND)) + rng.normal(0, noise, scans - 1)
    heading = scale * yaw((wheel_stamps - EPOCH) / SECOND - offset_s)
    wheels = WheelOdometry(wheel_stamps, np.column_stack([np.zeros((len(heading), 2)), se2.wrap_angle(heading)]))
    return stamps, turns, np.ones(scans - 1, np.bool_), wheels


@pytest.mark.parametrize("offset", [-0.3, -0.1, -0.05, 0.04, 0.1, 0.3])
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_a_planted_offset_is_found(offset, noise):
    found = time_offset.estimate(*turning(offset, noise=noise))
    assert found.seconds == pytest.approx(offset, abs=0.006)
    assert found.error_after_rad < 0.85 * found.error_before_rad
    assert found.num_scans > 200


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.02])
def test_no_offset_is_found_where_there_is_none(noise):
    assert time_offset.estimate(*turning(0.0, noise=noise)).seconds == 0.0


@pytest.mark.parametrize("scale", [0.9, 1.05])
@pytest.mark.parametrize("slow", [False, True])
def test_wheels_that_turn_too_far_or_not_far_enough_are_no_offset(scale, slow):
    assert time_offset.estimate(*turning(0.0, scale=scale, slow=slow)).seconds == 0.0


def test_slip_and_failed_matches_do_not_count():
    stamps, turns, trusted, wheels = turning(0.1, noise=0.003)
    slipping = turns.copy()
    slipping[50:110] += 0.15  # the robot turns by more than the wheels say, for twelve seconds
    assert time_offset.estimate(stamps, slipping, trusted, wheels).seconds == pytest.approx(0.1, abs=0.01)
    failed = turns.copy()
    failed[::3] = 1.0
    trusted[::3] = False
    assert time_offset.estimate(stamps, failed, trusted, wheels).seconds == pytest.approx(0.1, abs=0.01)


def test_too_few_turns_say_nothing():
    stamps, turns, trusted, wheels = turning(0.2)
    straight = np.where(np.arange(len(turns)) < 30, turns, 0.0)
    found = time_offset.estimate(stamps, straight, trusted, wheels)
    assert found.seconds == 0.0
    assert found.num_scans <= 30
    assert time_offset.estimate(stamps[:1], turns[:0], trusted[:0], wheels).num_scans == 0
