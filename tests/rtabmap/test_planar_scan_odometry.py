# SPDX-License-Identifier: MIT
"""Odometry from planar scans of a whole recording: with wheels, without, with clocks that differ, and bad mounts."""

from __future__ import annotations

import numpy as np
import pytest
from scan_worlds import furnished_room, laser_scan

from slamcli.errors import CalibrationError, DataError, UsageError
from slamcli.geometry import quaternion, se2, se3
from slamcli.measurements import LaserScan, Odometry, PointCloud
from slamcli.registration.scan_odometry import ScanStep
from slamcli.rtabmap.scan_odometry import PlanarScanOdometry, ScanOdometrySettings, ScanTrack, beams_of, step_covariance
from slamcli.runtime import RunLog

PERIOD_NS = 200_000_000
MOUNTS = {"/scan": np.eye(4), "/cloud": np.eye(4)}


def path(seconds: np.ndarray) -> np.ndarray:
    """Around in the room, turning to and fro."""
    return np.column_stack(
        [3.8 + 0.9 * np.sin(0.25 * seconds), 3.0 + 0.6 * np.sin(0.4 * seconds), 0.8 * np.sin(0.5 * seconds)]
    )


def wheels(stamp_ns: int, ahead_s: float = 0.0, stretch: float = 1.0) -> Odometry:
    x, y, yaw = path(np.array([stamp_ns / 1e9 - ahead_s]))[0] * [stretch, stretch, 1.0]
    quat = quaternion.from_yaw(np.array(yaw))
    return Odometry(
        stamp_ns=stamp_ns, frame_id="odom", child_frame_id="base", position_m=np.array([x, y, 0.0]), quat_xyzw=quat, topic="/odom"
    )  # fmt: skip


def solved(
    count: int = 60, *, with_wheels: bool = True, ahead_s: float = 0.0, stretch: float = 1.0
) -> tuple[PlanarScanOdometry, ScanTrack, RunLog, np.ndarray]:
    log, rng = RunLog(), np.random.default_rng(1)
    odometry = PlanarScanOdometry(ScanOdometrySettings(), MOUNTS, log)
    stamps = np.arange(count) * PERIOD_NS
    for stamp in stamps.tolist():
        if with_wheels:
            for quarter in range(4):
                odometry.add(wheels(stamp - PERIOD_NS + (quarter + 1) * PERIOD_NS // 4, ahead_s, stretch))
        odometry.add(laser_scan(furnished_room(), path(np.array([stamp / 1e9]))[0], stamp, rng))
    true = path(stamps / 1e9)
    return odometry, odometry.solve(), log, se2.between(true[0], true)


def errors(track: ScanTrack, true: np.ndarray) -> tuple[float, float]:
    poses = np.array([step.T_odom_base for step in track.steps])
    off = se2.between(true, se3.to_se2(poses))
    return float(np.hypot(off[:, 0], off[:, 1]).max()), float(np.abs(off[:, 2]).max())


@pytest.mark.parametrize("with_wheels", [True, False])
def test_every_scan_has_a_pose_near_the_truth(with_wheels: bool) -> None:
    odometry, track, _, true = solved(with_wheels=with_wheels)
    assert len(track.steps) == len(odometry) == 60
    far, turned = errors(track, true)
    assert far < 0.04
    assert turned < 0.012
    assert track.num_lost == 0
    assert track.recorded_ns.tolist() == [step.stamp_ns for step in track.steps]
    assert not track.steps[0].covariance.any()
    assert all(np.linalg.eigvalsh(step.covariance)[0] > 0.0 for step in track.steps[1:])
    assert all(step.num_inliers > 0.5 * step.num_features for step in track.steps[1:])


def test_clocks_that_differ_and_wheels_that_measure_too_far_are_noticed() -> None:
    _, track, log, true = solved(ahead_s=0.3, stretch=1.05)
    assert errors(track, true)[0] < 0.04
    assert any("laser and odometry clocks differ" in note for note in log.notes)


def test_two_runs_give_the_same_bytes() -> None:
    first, second = (solved(30)[1] for _ in range(2))
    for a, b in zip(first.steps, second.steps, strict=True):
        assert a.T_odom_base is not None
        assert b.T_odom_base is not None
        assert a.T_odom_base.tobytes() == b.T_odom_base.tobytes()
        assert a.covariance.tobytes() == b.covariance.tobytes()


def test_clouds_of_a_planar_scanner_are_scans_too() -> None:
    rng, log = np.random.default_rng(1), RunLog()
    odometry = PlanarScanOdometry(ScanOdometrySettings(), MOUNTS, log)
    stamps = np.arange(20) * PERIOD_NS
    for stamp in stamps.tolist():
        scan = laser_scan(furnished_room(), path(np.array([stamp / 1e9]))[0], stamp, rng)
        hit = np.isfinite(scan.ranges_m)
        flat = np.column_stack([np.cos(scan.angles_rad), np.sin(scan.angles_rad), np.zeros(scan.num_beams)])
        points = (flat * scan.ranges_m[:, None])[hit].astype(np.float32)
        odometry.add(
            PointCloud(
                stamp_ns=stamp,
                frame_id="laser",
                points_m=points,
                topic="/cloud",
                offset_ns=np.zeros(len(points), np.int64),
            )
        )
    track = odometry.solve()
    true = path(stamps / 1e9)
    assert errors(track, se2.between(true[0], true))[0] < 0.04
    assert odometry.scan(3, track).planar


def test_scans_come_back_in_the_base_frame() -> None:
    odometry, track, _, _ = solved(3)
    scan = odometry.scan(2, track)
    beams = beams_of(scan)
    assert scan.planar
    assert len(beams.points) == len(scan.points) == int(beams.hit.sum())
    np.testing.assert_allclose(beams.points, scan.points[:, :2])


def test_covariances_follow_what_scans_and_wheels_tell() -> None:
    motion = np.array([0.2, 0.0, 0.0])
    along_wall = ScanStep((0.2, 0.0, 0.0), 0.9, 0.0, False, np.diag([0.0, 1e6, 1e6]))
    by_wheels = step_covariance(motion, along_wall, known=True)
    alone = step_covariance(motion, along_wall, known=False)
    assert by_wheels[0, 0] == pytest.approx(0.025**2, rel=0.1)
    assert alone[0, 0] == pytest.approx(0.2**2, rel=0.1)
    assert by_wheels[1, 1] < 0.01**2
    lost = step_covariance(motion, ScanStep((0.2, 0.0, 0.0), 0.1, 0.0, False, np.diag([1e6] * 3)), known=True)
    assert lost[1, 1] == pytest.approx(0.025**2, rel=0.1)


def test_what_cannot_be_used_is_refused() -> None:
    log = RunLog()
    with pytest.raises(DataError, match="no laser scan was read"):
        PlanarScanOdometry(ScanOdometrySettings(), MOUNTS, log).solve()
    scan = laser_scan(furnished_room(), np.array([3.0, 3.0, 0.0]), 0, np.random.default_rng(0))
    with pytest.raises(UsageError, match="mount of the laser on topic '/scan' is unknown"):
        PlanarScanOdometry(ScanOdometrySettings(), {}, log).add(scan)
    tilted = np.eye(4)
    tilted[:3, :3] = quaternion.to_matrix(quaternion.from_roll_pitch_yaw(0.0, 0.3, 0.0))
    with pytest.raises(CalibrationError, match=r"tilted by 17\.2 degrees"):
        PlanarScanOdometry(ScanOdometrySettings(), {"/scan": tilted}, log).add(scan)


def test_a_scan_that_sees_nothing_is_led_on_by_the_wheels() -> None:
    log, rng = RunLog(), np.random.default_rng(1)
    odometry = PlanarScanOdometry(ScanOdometrySettings(), MOUNTS, log)
    for k in range(12):
        stamp = k * PERIOD_NS
        odometry.add(wheels(stamp))
        scan = laser_scan(furnished_room(), path(np.array([stamp / 1e9]))[0], stamp, rng)
        if k == 7:
            blind = np.full(scan.num_beams, np.inf, np.float32)
            scan = LaserScan(
                stamp_ns=stamp, frame_id="laser", angle_min_rad=scan.angle_min_rad,
                angle_increment_rad=scan.angle_increment_rad, range_min_m=0.05, range_max_m=20.0, ranges_m=blind, topic="/scan",
            )  # fmt: skip
        odometry.add(scan)
    track = odometry.solve()
    assert track.num_lost == 1
    assert log.counts["scans that fitted nowhere"] == 1
    assert track.steps[7].T_odom_base is not None
    assert track.steps[7].covariance[0, 0] > track.steps[6].covariance[0, 0]
