# SPDX-License-Identifier: MIT
"""Systematic errors of wheels: planted ones are found, slips and failed matches do not count, and they are taken out."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import se2
from slamcli.trajectory.wheel_calibration import WheelCalibration, calibrate
from slamcli.trajectory.wheel_odometry import WheelOdometry


def drive(count=1200, seed=0):
    """True motions between scans: straight on, with a turn every now and then."""
    rng = np.random.default_rng(seed)
    motions = np.column_stack([rng.uniform(0.05, 0.15, count), np.zeros(count), rng.normal(0, 0.002, count)])
    turning = (np.arange(count) // 25) % 4 == 3
    motions[turning, 0] *= 0.1
    motions[turning, 2] += 0.06 * rng.choice([-1, 1])
    return motions


def told_by(truth, planted, noise=0.0, seed=1):
    """What wheels with these errors say of true motions."""
    rng = np.random.default_rng(seed)
    ahead = truth[:, 0] / planted.scale
    turn = (truth[:, 2] - planted.turn_rad_m * ahead) / planted.turn_scale
    told = np.column_stack([ahead, truth[:, 1] / planted.scale, turn])
    return told + rng.normal(0, 1, told.shape) * [0.1 * noise, 0.02 * noise, 0.1 * noise]


def everything(count, good=True):
    return np.full(count, 0.01), np.full(count, good)


PLANTED = [WheelCalibration(1.05, 0.9, 0.01), WheelCalibration(0.92, 1.2, -0.03), WheelCalibration()]


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("planted", PLANTED)
def test_planted_errors_are_found(planted, noise):
    truth = drive()
    found = calibrate(told_by(truth, planted, noise), truth, *everything(len(truth)))
    assert found.scale == pytest.approx(planted.scale, abs=0.002 + 0.2 * noise)
    assert found.turn_scale == pytest.approx(planted.turn_scale, abs=0.002 + 0.2 * noise)
    assert found.turn_rad_m == pytest.approx(planted.turn_rad_m, abs=0.001 + 0.2 * noise)
    assert found.num_stretches > 100


def test_slips_and_failed_matches_do_not_count():
    truth, planted = drive(), PLANTED[0]
    told, (sigmas, trusted) = told_by(truth, planted), everything(1200)
    told[100:180, 0] *= 2.0  # spinning wheels
    told[400:480, 2] += 0.03
    seen = truth.copy()
    seen[::40], trusted[::40] = [1.0, 0.0, 1.0], False
    found = calibrate(told, seen, sigmas, trusted)
    assert found.scale == pytest.approx(planted.scale, abs=0.004)
    assert found.turn_scale == pytest.approx(planted.turn_scale, abs=0.02)
    assert found.turn_rad_m == pytest.approx(planted.turn_rad_m, abs=0.003)


def test_distances_count_where_the_scans_tell_them():
    truth, planted = drive(), PLANTED[0]
    told, (sigmas, trusted) = told_by(truth, planted), everything(1200)
    seen = truth.copy()
    corridor = np.arange(1200) % 500 < 150
    seen[corridor, 0] = told[corridor, 0]  # along a corridor scans believe the wheels
    sigmas[corridor] = 0.5
    assert calibrate(told, seen, sigmas, trusted).scale == pytest.approx(planted.scale, abs=0.004)


@pytest.mark.parametrize("count", [1, 5, 100])
def test_too_little_says_nothing(count):
    truth = drive()[:count]
    found = calibrate(told_by(truth, PLANTED[1]), truth, *everything(count))
    assert (found.scale, found.turn_rad_m) == (1.0, 0.0)
    nothing = calibrate(np.zeros((300, 3)), np.zeros((300, 3)), *everything(300))
    assert (nothing.scale, nothing.turn_scale, nothing.turn_rad_m) == (1.0, 1.0, 0.0)
    blind = calibrate(told_by(drive(), PLANTED[1]), drive(), *everything(1200, good=False))
    assert blind == WheelCalibration()


def test_absurd_errors_are_limited():
    truth = drive()
    found = calibrate(told_by(truth, WheelCalibration(1.9, 0.4, 0.0)), truth, *everything(1200))
    assert found.scale == 1.4
    assert found.turn_scale == 0.6


def test_odometry_is_freed_of_the_errors():
    truth, planted, start = drive(200), PLANTED[1], np.array([2.0, -1.0, 3.0])
    told = told_by(truth, planted)
    poses = {"true": [start], "told": [start]}
    for name, motions in (("true", truth), ("told", told)):
        for motion in motions[1:]:
            poses[name].append(se2.compose(poses[name][-1], motion))
    stamps = np.arange(200) * 100_000_000
    freed = planted.apply(WheelOdometry(stamps, np.array(poses["told"])))
    expected = np.array(poses["true"])
    assert np.hypot(*(np.array(poses["told"]) - expected)[:, :2].T).max() > 1.0
    np.testing.assert_allclose(freed.poses[:, :2], expected[:, :2], atol=1e-6)
    np.testing.assert_allclose(se2.wrap_angle(freed.poses[:, 2] - expected[:, 2]), 0.0, atol=1e-9)
    np.testing.assert_array_equal(freed.stamps_ns, stamps)
    same = WheelCalibration().apply(freed)
    np.testing.assert_allclose(same.poses, freed.poses, atol=1e-9)
    single = planted.apply(WheelOdometry(stamps[:1], start[None]))
    np.testing.assert_allclose(single.poses[0, :2], start[:2])
