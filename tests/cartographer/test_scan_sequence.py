# SPDX-License-Identifier: MIT
"""What a recording tells of the motion between scans: wheels, gyroscope, scans, or nothing; clocks and mounts."""

from __future__ import annotations

import numpy as np
import pytest
from ring_world import drive, gyroscope, odometry, recorded, scan, stamps_of, wheels

from slamcli.cartographer.parameters import TrajectoryBuilder2d
from slamcli.cartographer.parameters.trajectory_builder_2d import ScanOdometry2d
from slamcli.cartographer.scan_sequence import ScanSequence
from slamcli.errors import DataError, UsageError
from slamcli.geometry import se2
from slamcli.mapper import Setup
from slamcli.runtime import RunLog

POSES = drive(count=60, turns=0.2)
STAMPS = stamps_of(60)
TRUE = np.vstack([np.zeros(3), se2.between(POSES[:-1], POSES[1:])])
OFF = ScanOdometry2d(enabled=False)


def sequence(measurements, scan_odometry=None, log=None, **local):
    mounts = {"T_base_laser": {"/scan": np.eye(4)}, "T_base_sensor": {"/imu": np.eye(4)}}
    p = TrajectoryBuilder2d(scan_odometry=scan_odometry or ScanOdometry2d(), **local)
    made = ScanSequence(p, Setup(log=log or RunLog(), **mounts))
    for measurement in measurements:
        made.add(measurement)
    return made


@pytest.mark.parametrize("gyro", [False, True])
def test_wheels_tell_the_motion_and_a_gyroscope_the_turns(gyro):
    imu = gyroscope(STAMPS, POSES, bias=0.0) if gyro else []
    told = wheels(POSES, scale=1.1, turn=1.2)
    found = sequence(recorded(POSES, told=told, imu=imu), OFF).prepare()
    expected = TRUE * np.array([1.1, 1.1, 1.0 if gyro else 1.2])
    np.testing.assert_allclose(found.motions[:, :2], expected[:, :2], atol=1e-9)
    np.testing.assert_allclose(found.motions[1:-1, 2], expected[1:-1, 2], atol=0.02 if gyro else 1e-9)
    assert found.motions[:, 2].sum() == pytest.approx(expected[:, 2].sum(), abs=0.01)
    assert not found.extrapolated
    assert found.calibration is None
    assert found.steps == []
    assert not found.slack_m.any()


def test_a_given_offset_moves_the_wheels():
    told = wheels(POSES, 1.0, 1.0)
    o = ScanOdometry2d(enabled=False, time_offset="0.1")
    found = sequence(recorded(POSES, told=told), o).prepare()
    np.testing.assert_allclose(found.motions[1:-1], TRUE[2:], atol=1e-9)  # 0.1 s is one scan
    with pytest.raises(UsageError, match="not so far apart"):
        sequence(recorded(POSES, told=told), ScanOdometry2d(time_offset="1e10")).prepare()


@pytest.mark.parametrize("gyro", [False, True])
def test_nothing_tells_the_motion(gyro):
    imu = gyroscope(STAMPS, POSES, bias=0.0) if gyro else []
    found = sequence(recorded(POSES, imu=imu), OFF).prepare()
    assert found.extrapolated
    assert found.turns_told == gyro
    np.testing.assert_array_equal(found.motions[:, :2], 0.0)
    assert found.motions[:, 2].sum() == pytest.approx(TRUE[:, 2].sum() if gyro else 0.0, abs=0.02)


def test_an_imu_that_is_not_to_be_used_tells_nothing():
    found = sequence(recorded(POSES, imu=gyroscope(STAMPS, POSES)), OFF, use_imu_data=False).prepare()
    assert not found.turns_told
    np.testing.assert_array_equal(found.motions, 0.0)


def test_scans_tell_the_motion_and_where_they_do_not_there_is_slack():
    found = sequence(recorded(POSES, told=wheels(POSES, 1.05, 1.0, seed=2), blind=range(30, 40))).prepare()
    seen = np.r_[1:30, 42:60]
    np.testing.assert_allclose(found.motions[seen], TRUE[seen], atol=0.05)
    assert np.all(found.slack_m[30:40] > 0.02)
    assert not found.slack_m[np.r_[2:30, 42:60]].any()
    assert len(found.steps) == 60


def test_scans_that_come_before_their_stamps_are_put_in_order():
    stamps = STAMPS.copy()
    stamps[[20, 21]] = stamps[[21, 20]]
    made = sequence(recorded(POSES, stamps, told=wheels(POSES, 1.0, 1.0)), OFF)
    made.prepare()
    assert np.all(np.diff(made.stamps_ns) > 0)
    assert made.recorded_stamps_ns == stamps.tolist()


def test_what_is_missing_is_said():
    with pytest.raises(DataError, match="no scan was read: name the topic with --scan-topic"):
        sequence([odometry(STAMPS[0], POSES[0])]).prepare()
    with pytest.raises(UsageError, match="the mount of the sensor on topic '/other' is unknown"):
        sequence([scan(POSES[0], STAMPS[0], topic="/other")])
