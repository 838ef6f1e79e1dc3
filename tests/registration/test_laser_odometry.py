# SPDX-License-Identifier: MIT
"""The motion of a whole recording from scans and wheels: clocks that differ, slips, sweeps."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import se2
from slamcli.registration.beams import Beams
from slamcli.registration.laser_odometry import LaserOdometry, tells_sweep
from slamcli.runtime import RunLog
from slamcli.trajectory.wheel_calibration import WheelCalibration
from slamcli.trajectory.wheel_odometry import WheelOdometry

PERIOD_NS = 100_000_000
WALLS = [
    ((-3, -2), (4, -2)),
    ((4, -2), (4, 1)),
    ((4, 1), (2, 1.5)),
    ((2, 1.5), (2, 3)),
    ((2, 3), (-3, 3)),
    ((-3, 3), (-3, -2)),
]
SCENE = np.concatenate([np.linspace(a, b, 60, endpoint=False) for a, b in WALLS])


def path(seconds):
    """True poses (N, 3) at times: to and fro, turning all the while."""
    t = np.asarray(seconds, float)
    return np.column_stack(
        [0.8 * np.sin(0.4 * t), 0.5 * np.sin(0.3 * t + 0.5), 0.9 * np.sin(0.7 * t) + 0.4 * np.sin(1.9 * t)]
    )


def beams_of(poses):
    def beams(k, twist):
        if twist is not None:
            raise AssertionError("these scans have no sweep")
        points = se2.transform_points(se2.inverse(poses[k]), SCENE)
        hit = np.ones(len(points), np.bool_)
        return Beams(points, np.empty((0, 2)), np.zeros((1, 2)), points, hit)

    return beams


def odometry(count, wheels=None, sweeps=False):
    stamps = np.arange(count) * PERIOD_NS
    poses = path(stamps / 1e9)
    made = LaserOdometry(
        stamps_ns=stamps, beams=beams_of(poses), delta_m=0.05, sweeps=sweeps, log=RunLog(), wheels=wheels
    )
    return made, poses


def wheels_of(count, ahead_s=0.0, slip=None):
    stamps = np.arange(-40, 4 * count + 40) * (PERIOD_NS // 4)
    poses = path(stamps / 1e9 - ahead_s)
    if slip is not None:
        poses[stamps > slip * PERIOD_NS, 0] += 0.5
    return WheelOdometry(stamps, poses)


def assert_motions(found, poses, translation=0.03, rotation=0.02):
    expected = se2.between(poses[:-1], poses[1:])
    assert np.hypot(*(found[1:] - expected)[:, :2].T).max() < translation
    assert np.abs(se2.wrap_angle(found[1:, 2] - expected[:, 2])).max() < rotation
    np.testing.assert_array_equal(found[0], 0.0)


def test_motions_with_wheels_and_without():
    for wheels in (None, wheels_of(60)):
        laser, poses = odometry(60, wheels)
        motions, steps = laser.motions(0.0)
        assert_motions(motions, poses)
        assert len(steps) == 60
        assert laser.log.warnings == []


def test_the_gyroscope_tells_the_turns():
    laser, poses = odometry(40)
    spinning = poses.copy()
    spinning[:, 2] += 0.5 * np.arange(40)  # 5 rad/s: no scan matching finds that without a prediction
    fast = LaserOdometry(
        stamps_ns=laser.stamps_ns, beams=beams_of(spinning), delta_m=0.05, sweeps=False, log=RunLog(),
        yaws=se2.wrap_angle(spinning[:, 2] + 1.0),
    )  # fmt: skip
    assert_motions(fast.motions(0.0)[0], spinning)


@pytest.mark.parametrize("ahead", [-0.15, 0.2])
def test_a_planted_clock_offset_is_found(ahead):
    laser, poses = odometry(160, wheels_of(160, ahead))
    offset = laser.time_offset()
    assert offset.seconds == pytest.approx(ahead, abs=0.015)
    motions, _ = laser.motions(offset.seconds)
    assert_motions(motions, poses)


def test_wheels_are_freed_of_their_errors_and_their_clock():
    wheels = WheelCalibration(1 / 1.06, 1 / 0.9, 0.0).apply(wheels_of(400, 0.15))
    laser, poses = odometry(400, wheels)
    freed, offset, found = laser.calibrated(None)
    assert offset.seconds == pytest.approx(0.15, abs=0.02)
    assert found.turn_scale == pytest.approx(0.9, abs=0.02)
    assert freed.wheels is not None
    turned = np.abs(se2.wrap_angle(np.diff(freed.wheels.at(laser.stamps_ns + round(offset.seconds * 1e9))[:, 2])))
    assert turned.sum() == pytest.approx(np.abs(se2.wrap_angle(np.diff(poses[:, 2]))).sum(), rel=0.03)
    assert laser.calibrated(0.15)[1].seconds == 0.15
    assert_motions(freed.motions(offset.seconds)[0], poses)


def test_slips_are_counted_and_said():
    laser, poses = odometry(60, wheels_of(60, slip=29.5))
    motions, _ = laser.motions(0.0)
    assert_motions(motions, poses)
    assert laser.log.counts["scans that disagree with the odometry"] == 1
    assert laser.log.warnings[0].startswith(
        "scans and odometry disagree beyond the motion model at 1 of 60 scans, first at 3.0"
    )


def test_the_velocity_during_a_sweep():
    laser, _ = odometry(4, sweeps=True)
    ahead = np.array([[0.02, 0.0, -0.01]])
    np.testing.assert_allclose(laser.twist(1, ahead), [0.2, 0.0, -0.1])
    assert laser.twist(3, np.empty((0, 3))) is None  # the last scan: nothing tells what comes
    assert odometry(4, sweeps=False)[0].twist(1, ahead) is None
    slow = LaserOdometry(
        stamps_ns=np.array([0, 5_000_000_000]), beams=laser.beams, delta_m=0.05, sweeps=True, log=RunLog()
    )
    assert slow.twist(0, ahead) is None


def test_a_sweep_must_fit_between_two_scans():
    stamps, log = np.arange(10) * PERIOD_NS, RunLog()
    assert tells_sweep(stamps, 0.08, log)
    assert not tells_sweep(stamps, 0.0, log)
    assert not tells_sweep(stamps[:1], 0.08, log)
    assert log.warnings == []
    assert not tells_sweep(stamps, 0.2, log)
    assert "scans are 0.100 s apart" in log.warnings[0]
