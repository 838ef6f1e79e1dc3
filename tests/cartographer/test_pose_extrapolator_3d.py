# SPDX-License-Identifier: MIT
"""Predictions from odometry alone do not come apart over many scans, nor leap with it."""

from __future__ import annotations

import numpy as np

from slamcli.cartographer.imu_track import ImuTrack
from slamcli.cartographer.pose_extrapolator_3d import PoseExtrapolator3D
from slamcli.geometry import quaternion
from slamcli.measurements import Odometry
from slamcli.runtime import RunLog


def test_rounding_does_not_grow_from_prediction_to_prediction():
    extrapolator = PoseExtrapolator3D(ImuTrack(10.0, RunLog()))
    extrapolator.add_pose(0, np.eye(4))
    for i in range(200):
        for k in range(2):
            stamp = (2 * i + k) * 50_000_000
            turned = quaternion.from_roll_pitch_yaw(0.1 * np.sin(stamp / 1e9), 0.02, 0.3 * stamp / 1e9)
            extrapolator.add_odometry(
                Odometry(
                    stamp_ns=stamp,
                    frame_id="odom",
                    child_frame_id="base_link",
                    quat_xyzw=turned,
                    position_m=np.array([0.5 * stamp / 1e9, 0.0, 0.0]),
                )
            )
        stamps = np.array([i * 100_000_000 + 20_000_000, i * 100_000_000 + 50_000_000])
        pose = extrapolator.poses(stamps)[-1]
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-14)
        extrapolator.add_pose(int(stamps[-1]), pose)


def test_a_leap_of_odometry_is_not_followed():
    log = RunLog()
    extrapolator = PoseExtrapolator3D(ImuTrack(10.0, log))
    extrapolator.add_pose(0, np.eye(4))
    for i in range(41):
        position = np.array([0.05 * i, 3.0 * (i >= 10) - 4.0 * (i >= 30), 0.0])
        extrapolator.add_odometry(
            Odometry(
                stamp_ns=i * 50_000_000,
                frame_id="odom",
                child_frame_id="base_link",
                position_m=position,
                quat_xyzw=np.array([0.0, 0, 0, 1]),
            )
        )
        extrapolator.add_pose(i * 50_000_000, extrapolator.poses(np.array([i * 50_000_000]))[-1])
    np.testing.assert_allclose(extrapolator.T_local_base[:3, 3], [2.0, 0.0, 0.0], atol=1e-9)
    assert log.counts["leaps of odometry"] == 2
    assert [w for w in log.warnings if "odometry leaps by 3.0 m at 0.500 s" in w]
