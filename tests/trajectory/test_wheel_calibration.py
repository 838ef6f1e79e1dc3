# SPDX-License-Identifier: MIT
"""Systematic errors of wheels are found from how scans saw the robot move, and taken out; a clock offset beside them."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import se2
from slamcli.trajectory.time_offset import estimate
from slamcli.trajectory.wheel_calibration import WheelCalibration, calibrate
from slamcli.trajectory.wheel_odometry import WheelOdometry

TRUE = WheelCalibration(scale=0.97, turn_scale=1.12, turn_rad_m=0.02)
SECOND = 1_000_000_000


def steps(count=3000, seed=0):
    """Motions (N, 3) that wheels say: 6 cm each, turning now and then."""
    rng = np.random.default_rng(seed)
    turns = np.repeat(rng.choice([-0.08, 0.0, 0.0, 0.08], count // 30 + 1), 30)[:count]
    return np.column_stack([np.full(count, 0.06), rng.normal(0, 0.001, count), turns + rng.normal(0, 0.002, count)])


def seen_by(wheels, true, noise=0.0, seed=1):
    """Motions as they truly are under those errors."""
    turn = true.turn_scale * wheels[:, 2] + true.turn_rad_m * wheels[:, 0]
    seen = np.column_stack([true.scale * wheels[:, :2], turn])
    return seen + np.random.default_rng(seed).normal(0, 1, seen.shape) * noise * np.array([1.0, 1.0, 0.3])


def fit(wheels, seen, trusted=None):
    return calibrate(
        wheels, seen, np.full(len(wheels), 0.01), np.ones(len(wheels), bool) if trusted is None else trusted
    )


def test_known_errors_are_recovered():
    wheels = steps()
    found = fit(wheels, seen_by(wheels, TRUE, noise=0.004))
    assert found.scale == pytest.approx(TRUE.scale, abs=0.005)
    assert found.turn_scale == pytest.approx(TRUE.turn_scale, abs=0.005)
    assert found.turn_rad_m == pytest.approx(TRUE.turn_rad_m, abs=0.002)
    assert found.num_stretches > 300


def test_slipping_wheels_and_bad_matches_do_not_count():
    wheels = steps()
    seen, trusted = seen_by(wheels, TRUE, noise=0.004), np.ones(len(wheels), bool)
    seen[500:700] *= 0.3  # wheels that slip
    seen[1200:1300], trusted[1200:1300] = 5.0, False
    found = fit(wheels, seen, trusted)
    assert found.scale == pytest.approx(TRUE.scale, abs=0.005)
    assert found.turn_scale == pytest.approx(TRUE.turn_scale, abs=0.01)
    assert found.turn_rad_m == pytest.approx(TRUE.turn_rad_m, abs=0.004)


@pytest.mark.parametrize("case", ["short", "still", "untrusted", "one step"])
def test_too_little_tells_nothing(case):
    wheels = {"short": steps(60), "still": np.zeros((500, 3)), "untrusted": steps(), "one step": steps(30)[:1]}[case]
    trusted = np.full(len(wheels), case != "untrusted")
    found = fit(wheels, seen_by(wheels, TRUE), trusted)
    assert (found.scale, found.turn_scale, found.turn_rad_m) == (1.0, 1.0, 0.0)


def test_nonsense_is_bounded():
    wheels = steps()
    found = fit(wheels, seen_by(wheels, WheelCalibration(scale=3.0, turn_scale=-2.0, turn_rad_m=1.0)))
    assert (found.scale, found.turn_scale, found.turn_rad_m) == (1.4, 0.6, 0.2)


def odometry_of(motions, period_s=0.1):
    poses = [np.array([3.0, -1.0, 0.7])]
    for motion in motions:
        poses.append(se2.compose(poses[-1], motion))
    stamps = 1000 * SECOND + np.round(np.arange(len(poses)) * period_s * SECOND).astype(np.int64)
    return WheelOdometry(stamps, np.array(poses))


def test_applied_to_odometry_the_true_motions_come_out():
    wheels = steps(300)
    odometry = odometry_of(wheels)
    mended = TRUE.apply(odometry)
    np.testing.assert_allclose(mended.poses[0], odometry.poses[0], atol=1e-12)
    np.testing.assert_array_equal(mended.stamps_ns, odometry.stamps_ns)
    moved = se2.between(mended.poses[:-1], mended.poses[1:])
    np.testing.assert_allclose(moved[:, 2], seen_by(wheels, TRUE)[:, 2], atol=1e-9)
    np.testing.assert_allclose(np.hypot(moved[:, 0], moved[:, 1]), TRUE.scale * np.hypot(*wheels[:, :2].T), atol=1e-9)
    same = WheelCalibration().apply(odometry)
    np.testing.assert_allclose(same.poses, odometry.poses, atol=1e-9)


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
        found = fit(se2.between(poses[:-1], poses[1:]), seen)
    assert offset == pytest.approx(offset_s, abs=0.01)
    assert found.turn_scale == pytest.approx(1.12, abs=0.01)
