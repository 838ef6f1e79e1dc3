# SPDX-License-Identifier: MIT
"""A clock offset and wheels that turn too far, each of which looks a little like the other."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import se2
from slamcli.trajectory.time_offset import estimate
from slamcli.trajectory.wheel_calibration import WheelCalibration, calibrate
from slamcli.trajectory.wheel_odometry import WheelOdometry

SECOND = 1_000_000_000


def odometry_of(motions, period_s=0.1):
    poses = [np.array([3.0, -1.0, 0.7])]
    for motion in motions:
        poses.append(se2.compose(poses[-1], motion))
    stamps = 1000 * SECOND + np.round(np.arange(len(poses)) * period_s * SECOND).astype(np.int64)
    return WheelOdometry(stamps, np.array(poses))


@pytest.mark.parametrize("offset_s", [-0.14, 0.0, 0.2])
def test_an_offset_and_a_wrong_turn_scale_are_told_apart(offset_s):
    # One by one, each looks like a little of the other where the rate of turning changes slowly.
    period_s, time = 0.1, np.arange(1500) * 0.1
    rate = 0.5 * np.sin(0.6 * time) + 0.3 * np.sin(1.7 * time + 1.0)
    true = np.column_stack([np.full(len(time), 0.05), np.zeros(len(time)), rate * period_s])
    odometry = odometry_of(true * np.array([1.0, 1.0, 1 / 1.12]), period_s)
    stamps = odometry.stamps_ns[20:-20]
    seen_at = odometry_of(true, period_s).at(stamps + round(offset_s * 1e9))
    seen = se2.between(seen_at[:-1], seen_at[1:])
    trusted, found, offset = np.ones(len(seen), bool), WheelCalibration(), 0.0
    for _ in range(3):
        offset = estimate(stamps, seen[:, 2], trusted, found.apply(odometry)).seconds
        poses = odometry.at(stamps + round(offset * 1e9))
        found = calibrate(se2.between(poses[:-1], poses[1:]), seen, np.full(len(seen), 0.01), trusted)
    assert offset == pytest.approx(offset_s, abs=0.01)
    assert found.turn_scale == pytest.approx(1.12, abs=0.01)
