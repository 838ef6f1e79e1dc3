# SPDX-License-Identifier: MIT
"""The Madgwick filter: level when at rest, turns with the gyroscope, learns a bias."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.geometry import quaternion
from slamcli.trajectory.madgwick import MadgwickFilter

STEP_NS = 5_000_000


def up_of(filtered: MadgwickFilter) -> np.ndarray:
    """Return the direction of up in the IMU."""
    return quaternion.to_matrix(filtered.quat_xyzw)[2]


def test_the_first_sample_says_which_way_is_up() -> None:
    filtered = MadgwickFilter(0.1)
    filtered.step(0, (0.0, 0.0, 0.0), (0.0, -9.81 * math.sin(0.3), 9.81 * math.cos(0.3)))
    np.testing.assert_allclose(up_of(filtered), [0.0, -math.sin(0.3), math.cos(0.3)], atol=1e-12)


def test_turns_are_those_of_the_gyroscope() -> None:
    filtered = MadgwickFilter(0.1)
    for k in range(401):  # a turn of 1 rad about z in 2 s
        filtered.step(k * STEP_NS, (0.0, 0.0, 0.5), (0.0, 0.0, 9.81))
    assert quaternion.yaw(filtered.quat_xyzw) == pytest.approx(1.0, abs=1e-4)
    np.testing.assert_allclose(up_of(filtered), [0.0, 0.0, 1.0], atol=1e-6)


def test_a_rolling_imu_keeps_up() -> None:
    rng = np.random.default_rng(3)
    filtered = MadgwickFilter(0.05)
    for k in range(2000):
        t = k * STEP_NS / 1e9
        roll = 0.4 * math.sin(t)
        force = 9.81 * np.array([0.0, math.sin(roll), math.cos(roll)]) + rng.normal(0.0, 0.3, 3)
        filtered.step(k * STEP_NS, (0.4 * math.cos(t), 0.0, 0.0), force.tolist())
    expected = [0.0, math.sin(roll), math.cos(roll)]
    assert math.acos(min(1.0, float(up_of(filtered) @ expected))) < 0.01


def test_the_accelerometer_pulls_back_at_the_rate_of_the_gain() -> None:
    filtered = MadgwickFilter(0.1)
    filtered.step(0, (0.0, 0.0, 0.0), (0.0, 9.81 * math.sin(0.5), 9.81 * math.cos(0.5)))
    for k in range(1, 401):  # 2 s of nearly 0.2 rad/s
        filtered.step(k * STEP_NS, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81))
    left = math.acos(min(1.0, float(up_of(filtered)[2])))
    assert left == pytest.approx(0.5 - 2.0 * 2 * 0.1, abs=0.03)


def test_a_bias_is_learnt() -> None:
    with_bias, without = MadgwickFilter(0.05, 0.02), MadgwickFilter(0.05)
    for k in range(8000):
        for filtered in (with_bias, without):
            filtered.step(k * STEP_NS, (0.08, 0.0, 0.0), (0.0, 0.0, 9.81))
    tilts = [math.acos(min(1.0, float(up_of(filtered)[2]))) for filtered in (with_bias, without)]
    assert tilts[0] < 0.03
    assert tilts[1] > 3 * tilts[0]


def test_gaps_and_repeated_stamps() -> None:
    filtered = MadgwickFilter(0.1)
    filtered.step(0, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81))
    filtered.step(0, (9.0, 0.0, 0.0), (9.81, 0.0, 0.0))
    np.testing.assert_allclose(up_of(filtered), [0.0, 0.0, 1.0], atol=1e-12)
    filtered.step(10_000_000_000, (9.0, 0.0, 0.0), (9.81, 0.0, 0.0))
    np.testing.assert_allclose(up_of(filtered), [1.0, 0.0, 0.0], atol=1e-12)
    filtered.step(10_005_000_000, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(up_of(filtered), [1.0, 0.0, 0.0], atol=1e-9)
