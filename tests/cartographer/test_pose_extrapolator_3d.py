# SPDX-License-Identifier: MIT
"""Predictions from odometry alone do not come apart over many scans."""

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
