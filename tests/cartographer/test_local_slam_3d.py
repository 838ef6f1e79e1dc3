# SPDX-License-Identifier: MIT
"""Local SLAM in space: unwarping, prediction, the IMU's track, submaps, and drives through a small hall."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from lidar_room import Drive, Lidar, hall, imu_samples

from slamcli.cartographer.imu_track import ImuTrack
from slamcli.cartographer.local_slam_3d import LocalSlam3D, upright_rotation
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.cartographer.pose_extrapolator_3d import PoseExtrapolator3D, from_rotation_vector, rotation_vectors
from slamcli.cartographer.submaps_3d import ActiveSubmaps3D, ScanForSubmaps
from slamcli.cartographer.sweep_3d import assemble, corrected
from slamcli.geometry import quaternion, se3
from slamcli.measurements import ImuSample, Odometry, PointCloud
from slamcli.posegraph import Id
from slamcli.runtime import RunLog

SECOND = 1_000_000_000


def parameters(ext=None, **builder):
    p = CartographerParameters()
    return dataclasses.replace(
        p,
        trajectory_builder_3d=dataclasses.replace(p.trajectory_builder_3d, **builder),
        slamcli_3d=dataclasses.replace(p.slamcli_3d, **(ext or {})),
    )


def pose(x, y, z, roll=0.0, pitch=0.0, yaw=0.0):
    return se3.from_position_quaternion([x, y, z], quaternion.from_roll_pitch_yaw(roll, pitch, yaw))


def imu(stamp_ns, rate=(0.0, 0.0, 0.0), force=(0.0, 0.0, 9.8)):
    return ImuSample(stamp_ns=stamp_ns, frame_id="imu", angular_rad_s=np.array(rate), acceleration_m_s2=np.array(force))


# Sweeps


def test_unwarping_equals_a_naive_twin():
    rng = np.random.default_rng(0)
    points = rng.normal(0, 5, (300, 3)).astype(np.float32)
    offsets = rng.integers(0, 100_000_000, 300)
    offsets[:2] = 0, 100_000_000
    cloud = PointCloud(stamp_ns=SECOND, frame_id="l", points_m=points, offset_ns=offsets)
    sweep = assemble([(cloud, np.eye(4))], 0.0, 100.0, 0.0)
    T0, T1 = pose(1, 2, 0.5, 0.02, -0.01, 0.3), pose(1.4, 2.1, 0.52, 0.0, 0.01, 0.5)
    share = (sweep.knots_ns() - SECOND) / 1e8
    quats = quaternion.slerp(
        np.repeat(quaternion.from_matrix(T0[:3, :3])[None], len(share), 0),
        np.repeat(quaternion.from_matrix(T1[:3, :3])[None], len(share), 0),
        share,
    )
    poses = se3.from_position_quaternion(T0[:3, 3] + share[:, None] * (T1[:3, 3] - T0[:3, 3]), quats)
    naive = []
    for p, o in zip(points.astype(float), offsets, strict=True):
        q = quaternion.slerp(quaternion.from_matrix(T0[:3, :3]), quaternion.from_matrix(T1[:3, :3]), o / 1e8)
        at = T0[:3, 3] + o / 1e8 * (T1[:3, 3] - T0[:3, 3])
        naive.append(T1[:3, :3].T @ (quaternion.to_matrix(q) @ p + at - T1[:3, 3]))
    np.testing.assert_allclose(sweep.unwarped(poses), naive, atol=1e-4)
    rows = np.array([5, 9], dtype=np.int64)
    np.testing.assert_allclose(sweep.unwarped(poses, rows), np.array(naive)[rows], atol=1e-4)


def test_points_out_of_range_and_broken_ones_are_left_out():
    points = np.array([[0.5, 0, 0], [5, 0, 0], [np.nan, 1, 1], [0, 90, 0], [np.inf, 0, 0]], dtype=np.float32)
    cloud = PointCloud(stamp_ns=7, frame_id="l", points_m=points, intensities=np.arange(5, dtype=np.float32))
    sweep = assemble([(cloud, pose(0, 0, 1))], 1.0, 60.0, 0.15)
    np.testing.assert_allclose(sweep.points_m, [[5, 0, 1]])
    assert sweep.intensities.tolist() == [1.0]
    assert (sweep.begin_ns, sweep.end_ns) == (7, 7)


def test_a_correction_grows_with_time_from_the_pose_before():
    knots = np.linspace(0, 100, 5).astype(np.int64)
    predicted = np.array([pose(t / 100, 0, 0) for t in knots])
    fixed = corrected(predicted, knots, 0, pose(1.2, 0.1, 0, yaw=0.08))
    np.testing.assert_allclose(fixed[0], predicted[0], atol=1e-12)
    np.testing.assert_allclose(fixed[-1], pose(1.2, 0.1, 0, yaw=0.08), atol=1e-12)
    np.testing.assert_allclose(fixed[2], pose(0.6, 0.05, 0, yaw=0.04), atol=1e-12)


# Prediction


def test_constant_velocity_odometry_and_gyroscope_predict():
    track = ImuTrack(10.0, RunLog())
    extrapolator = PoseExtrapolator3D(track)
    for k in range(8):
        extrapolator.add_pose(k * SECOND // 10, pose(0.1 * k, 0, 0, yaw=0.02 * k))
    ahead = extrapolator.poses(np.array([8, 9], dtype=np.int64) * (SECOND // 10))
    np.testing.assert_allclose(ahead[1], pose(0.9, 0, 0, yaw=0.18), atol=2e-3)
    for t in range(110):
        track.add(imu(t * SECOND // 100, rate=(0, 0, 1.0)), np.eye(4))
    turned = extrapolator.poses(np.array([SECOND], dtype=np.int64))[0]
    assert float(quaternion.yaw(quaternion.from_matrix(turned[:3, :3]))) == pytest.approx(0.14 + 0.3, abs=1e-6)
    for k in range(12):
        extrapolator.add_odometry(
            Odometry(
                stamp_ns=k * SECOND // 10,
                frame_id="odom",
                position_m=np.array([5.0, 0.05 * k, 0.0]),
                quat_xyzw=quaternion.from_yaw(1.0),
            )
        )
    wheels = extrapolator.poses(np.array([SECOND], dtype=np.int64))[0]
    step = 0.15 * np.array([math.cos(0.14 - 1.0 + math.pi / 2), math.sin(0.14 - 1.0 + math.pi / 2)])
    np.testing.assert_allclose(wheels[:2, 3], [0.7 + step[0], step[1]], atol=1e-6)


def test_integrating_rates_equals_a_naive_twin():
    rng = np.random.default_rng(1)
    track = ImuTrack(10.0, RunLog())
    stamps, rates = np.arange(60) * 10_000_000, rng.normal(0, 1, (60, 3))
    for t, w in zip(stamps, rates, strict=True):
        track.add(imu(int(t), rate=w), np.eye(4))
    ends = np.array([123_000_000, 300_000_000, 580_000_000])
    found = track.rotations(105_000_000, ends)
    R, expected, now = np.eye(3), [], 105_000_000
    for t in range(105_000_000, 580_000_001, 1_000_000):
        if t > now:
            w = rates[int(np.argmin(np.abs(stamps - (t - 500_000))))]
            R = R @ quaternion.to_matrix(from_rotation_vector(w[None] * 1e-3))[0]
        if t in ends:
            expected.append(R)
    np.testing.assert_allclose(quaternion.to_matrix(found), expected, atol=1e-9)
    assert track.rotations(105_000_000, np.array([2 * SECOND])) is None, "no samples there"


def test_the_gyroscope_leads_over_a_long_time_without_points():
    track = ImuTrack(10.0, RunLog())
    extrapolator = PoseExtrapolator3D(track)
    extrapolator.add_pose(SECOND, np.eye(4))
    for t in range(801):
        track.add(imu(t * SECOND // 100, rate=(0, 0, 0.2)), np.eye(4))
    turned = extrapolator.poses(np.array([8 * SECOND], dtype=np.int64))[0]
    assert float(quaternion.yaw(quaternion.from_matrix(turned[:3, :3]))) == pytest.approx(1.4, abs=1e-9)


def test_rotation_vectors_go_there_and_back():
    vectors = np.random.default_rng(2).normal(0, 0.6, (50, 3))
    np.testing.assert_allclose(
        rotation_vectors(quaternion.to_matrix(from_rotation_vector(vectors))), vectors, atol=1e-9
    )
    np.testing.assert_allclose(rotation_vectors(np.eye(3)[None]), 0.0, atol=1e-15)


# The IMU's track


def test_gravity_levels_the_start_and_its_absence_is_said():
    R = pose(0, 0, 0, 0.1, -0.2, 0.0)[:3, :3]
    for scale, has, word in (
        (9.8, True, None),
        (1.0, True, "multiples of gravity"),
        (0.01, False, "not gravity"),
        (30.0, False, "not gravity"),
    ):
        log = RunLog()
        track = ImuTrack(10.0, log)
        for k in range(20):
            track.add(imu(k * 10_000_000, force=R.T @ [0, 0, scale]), np.eye(4))
        up = track.up_at_start(0, SECOND)
        assert track.has_gravity is has
        assert (up is not None) is has
        if has:
            np.testing.assert_allclose(upright_rotation(up), R, atol=1e-9)
        assert (word is None and not log.warnings) or word in log.warnings[0]


def test_a_bias_is_learnt_and_a_wrong_gyroscope_given_up():
    log = RunLog()
    track = ImuTrack(10.0, log)
    for k in range(4000):
        track.add(imu(k * 10_000_000, rate=(0.0, 0.0, 0.05)), np.eye(4))
        if k % 10 == 9:
            error = track.bias_rad_s * 0.1 - np.array([0.0, 0.0, 0.05]) * 0.1
            track.learn((k - 9) * 10_000_000, (k + 1) * 10_000_000, error, 0.0, np.eye(3))
    assert track.bias_rad_s[2] == pytest.approx(0.05, abs=2e-3)
    assert track.trusted
    for k in range(100):
        track.learn(k * SECOND, (k + 1) * SECOND, np.array([0.0, 0.3, 0.0]), 0.01, np.eye(3))
    assert not track.trusted
    assert any("gyroscope disagrees" in warning for warning in log.warnings)
    assert track.rotations(39 * SECOND, np.array([39 * SECOND + 1])) is None


def test_broken_and_repeated_imu_samples_are_counted():
    log = RunLog()
    track = ImuTrack(10.0, log)
    for sample in (imu(0), imu(0), imu(SECOND, rate=(np.nan, 0, 0)), imu(SECOND)):
        track.add(sample, np.eye(4))
    assert len(track) == 2
    assert log.counts == {
        "IMU samples that are not later than the one before": 1, "IMU samples that are not finite": 1, "gaps in the IMU": 1,
    }  # fmt: skip


# Submaps


def test_two_submaps_overlap_by_half():
    settings = dataclasses.replace(CartographerParameters().trajectory_builder_3d.submaps, num_range_data=3)
    submaps = ActiveSubmaps3D(0, settings, 12)
    done, into = [], []
    for k in range(13):
        scan = ScanForSubmaps(
            node=Id(0, k), T_local_base=pose(k, 0, 0), points_m=np.array([[2.0, 0, 0], [30.0, 0, 0]]), origin_m=np.zeros(3),
            rotational_histogram=np.ones(12, dtype=np.float32), local_from_gravity=np.eye(3),
        )  # fmt: skip
        active, finished = submaps.insert(scan)
        into.append([submap.id.number for submap in active])
        done += [finished] if finished else []
    assert into == [[0]] * 3 + [[0, 1]] * 3 + [[1, 2]] * 3 + [[2, 3]] * 3 + [[3, 4]]
    assert [(s.id.number, s.num_range_data, [n.number for n in s.nodes]) for s in done] == [
        (k, 6, list(range(3 * k, 3 * k + 6))) for k in range(3)
    ]
    np.testing.assert_allclose(done[1].T_local_submap, pose(3, 0, 0))
    assert done[0].high_resolution.indices[:, 0].max() == 70, "2 m ahead of x = 5, in cells of 0.1 m; 30 m is too far"
    assert done[0].low_resolution.indices[:, 0].max() == 78
    assert done[0].rotational_histogram.tolist() == [6.0] * 12
    assert [s.finished for s in submaps.rest()] == [False, False]


# Drives


def drive_through(p, *, with_imu, seconds=9.0, lidar=None, drop=(), gyro_bias=(0.01, -0.02, 0.015)):
    rng = np.random.default_rng(5)
    world, a = hall(1), np.linspace(0, 1.5 * np.pi, 80)
    drive = Drive(np.column_stack([8 * np.cos(a), 5 * np.sin(a)]), speed=1.5, rest=1.0)
    lidar = lidar or Lidar(16, 240)
    times = np.arange(0.0, seconds, 0.1)
    samples = imu_samples(drive, 0.0, seconds + 0.2, rng, gyro_bias=gyro_bias) if with_imu else []
    log = RunLog()
    slam = LocalSlam3D(p, 0, log, expect_imu=with_imu)
    steps, k = [], 0
    builder = p.trajectory_builder_3d
    for n, t in enumerate(times):
        cloud = lidar.sweep(world, drive, t, rng)
        while k < len(samples) and samples[k].stamp_ns <= cloud.stamp_ns + 100_000_000:
            slam.imu.add(samples[k], np.eye(4))
            k += 1
        if n in drop:
            cloud = dataclasses.replace(
                cloud, points_m=np.full((4, 3), np.nan, dtype=np.float32), offset_ns=None, intensities=None
            )
        steps.append(
            slam.add_sweep(
                assemble([(cloud, lidar.T_base_lidar)], builder.min_range, builder.max_range, builder.voxel_filter_size)
            )
        )
    found = np.array([step.cloud_poses[0] for step in steps])
    true = drive.poses(times)
    off = se3.inverse(se3.inverse(true[0]) @ true) @ se3.inverse(found[0]) @ found
    return np.linalg.norm(off[:, :3, 3], axis=1), slam, log, steps


@pytest.mark.parametrize(("matcher", "bound_m"), [("surfel", 0.03), ("grid", 0.35)])
def test_a_drive_with_an_imu_is_followed(matcher, bound_m):
    errors, slam, log, steps = drive_through(parameters({"scan_matcher": matcher}), with_imu=True)
    assert errors.max() < bound_m
    assert log.warnings == []
    if matcher == "surfel":
        np.testing.assert_allclose(slam.imu.bias_rad_s, [0.01, -0.02, 0.015], atol=0.012)
        assert slam.imu.up_local[2] > 0.9999
    assert sum(step.node is not None for step in steps) > 60


def test_a_drive_without_an_imu_is_followed_and_said():
    errors, _, log, _ = drive_through(parameters(), with_imu=False)
    assert errors.max() < 0.05
    assert "there is no IMU" in log.warnings[0]


def test_empty_and_broken_clouds_are_bridged():
    errors, _, log, steps = drive_through(parameters(), with_imu=True, drop=(30, 31, 32, 60))
    assert log.counts["sweeps with too few points within range"] == 4
    assert math.isnan(steps[31].score)
    assert np.delete(errors, [30, 31, 32, 33, 60, 61]).max() < 0.05
    assert errors.max() < 0.3
