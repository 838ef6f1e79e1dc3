# SPDX-License-Identifier: MIT
"""Odometry from clouds in space, and the front that feeds it: rooms with truth, sweeps, losses, given odometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from slamcli.errors import DataError, UsageError
from slamcli.geometry import se3
from slamcli.geometry.motion import part_of
from slamcli.mapper import Setup
from slamcli.measurements import Odometry, PointCloud
from slamcli.parameters import as_dict, resolve
from slamcli.rtabmap.cloud_odometry import CloudOdometry, CloudOdometrySettings
from slamcli.rtabmap.inputs import _SWEEPS
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.range_front import RangeFront
from slamcli.runtime import RunLog

Floats = NDArray[np.float64]
PERIOD_NS = 100_000_000
STEP = se3.from_rotation_translation(
    Rotation.from_rotvec([0.002, -0.001, 0.02]).as_matrix(), np.array([0.06, 0.01, 0.002])
)


def room() -> Floats:
    """Points of the sides of a room of 8 x 6 x 3 m and of a box in it, seen from its middle."""
    rng = np.random.default_rng(7)
    parts = []
    for axis in range(3):
        for end in (0.0, 1.0):
            points = rng.uniform(0.0, 1.0, (2500, 3)) * [8.0, 6.0, 3.0]
            points[:, axis] = end * [8.0, 6.0, 3.0][axis]
            parts.append(points)
    parts.append(rng.uniform(0.0, 1.0, (800, 3)) * [1.0, 1.5, 0.0] + [5.5, 1.0, 1.0])
    return np.vstack(parts) - [3.5, 2.8, 1.3]


ROOM = room()


def parameters(**native: object) -> RtabmapParameters:
    chosen = {"Reg/Strategy": 1, **_SWEEPS} | {name.replace("_", "/"): value for name, value in native.items()}
    return resolve(RtabmapParameters, as_dict(RtabmapParameters()), {"slamcli.odometry": "scan"} | chosen)


def truth(count: int) -> list[Floats]:
    poses = [np.eye(4)]
    for _ in range(count - 1):
        poses.append(poses[-1] @ STEP)
    return poses


def cloud(T: Floats, stamp_ns: int, seed: int, *, sweeping: bool = False) -> PointCloud:
    """Some points of the room as seen from a pose; with `sweeping` over 90 ms in which the base moves on."""
    rng = np.random.default_rng(seed)
    points = ROOM[rng.permutation(len(ROOM))[:5000]] + rng.normal(0.0, 0.01, (5000, 3))
    offsets = np.linspace(0, 90_000_000, 5000).astype(np.int64)
    if sweeping:
        for part in np.array_split(np.arange(5000), 50):
            then = T @ part_of(STEP, float(offsets[part].mean()) / PERIOD_NS)
            points[part] = (points[part] - then[:3, 3]) @ then[:3, :3]
    else:
        points = (points - T[:3, 3]) @ T[:3, :3]
    return PointCloud(
        stamp_ns=stamp_ns, frame_id="lidar", points_m=points.astype(np.float32), offset_ns=offsets if sweeping else None,
        topic="/points",
    )  # fmt: skip


def farthest(steps: list, poses: list[Floats]) -> float:
    return max(float(np.linalg.norm(s.T_odom_base[:3, 3] - T[:3, 3])) for s, T in zip(steps, poses, strict=True))


def run(count: int = 12, **native: object) -> tuple[list, list[Floats], CloudOdometry]:
    odometry = CloudOdometry(CloudOdometrySettings.of(parameters(**native)))
    poses = truth(count)
    steps = [odometry.step(cloud(T, k * PERIOD_NS, k), np.eye(4))[0] for k, T in enumerate(poses)]
    return steps, poses, odometry


def test_clouds_of_a_room_are_followed() -> None:
    steps, poses, odometry = run()
    assert farthest(steps, poses) < 0.02
    assert odometry.num_lost == 0
    assert steps[0].keyframe
    assert not steps[0].began_anew
    assert 1 < sum(step.keyframe for step in steps) < len(steps)
    for step in steps:
        assert np.allclose(step.T_odom_base[:3, :3] @ step.T_odom_base[:3, :3].T, np.eye(3), atol=1e-12)
    assert all(np.linalg.eigvalsh(step.covariance)[0] > 0.0 for step in steps[1:])


def test_sweeps_are_freed_of_the_motion() -> None:
    poses = truth(2)
    still = cloud(poses[1], PERIOD_NS, 1).points_m
    apart = {}
    for deskewing in (True, False):
        odometry = CloudOdometry(CloudOdometrySettings.of(parameters(Odom_Deskewing=deskewing)))
        odometry.step(cloud(poses[0], 0, 0), np.eye(4))
        scan = odometry.step(cloud(poses[1], PERIOD_NS, 1, sweeping=True), np.eye(4), STEP)[1]
        apart[deskewing] = float(np.linalg.norm(scan.points - still, axis=1).max())
    assert apart[True] < 0.003
    assert apart[False] > 0.05


def test_two_runs_give_the_same_bytes() -> None:
    first, second = (run(6)[0] for _ in range(2))
    assert all(a.T_odom_base.tobytes() == b.T_odom_base.tobytes() for a, b in zip(first, second, strict=True))


def test_clouds_that_fit_nowhere_are_lost_and_odometry_begins_anew() -> None:
    odometry = CloudOdometry(CloudOdometrySettings.of(parameters(Odom_ResetCountdown=2)))
    poses = truth(6)
    for k in range(3):
        odometry.step(cloud(poses[k], k * PERIOD_NS, k), np.eye(4))
    far = poses[2].copy()
    far[:3, 3] += [40.0, 40.0, 0.0]
    lost = odometry.step(cloud(far, 3 * PERIOD_NS, 3), np.eye(4), np.eye(4))[0]
    assert lost.T_odom_base is None
    again = odometry.step(cloud(far, 4 * PERIOD_NS, 4), np.eye(4), np.eye(4))[0]
    assert again.began_anew
    assert again.T_odom_base is not None
    assert (odometry.num_lost, odometry.num_resets) == (1, 1)
    few = replace(cloud(far, 5 * PERIOD_NS, 5), points_m=np.zeros((2, 3), np.float32))
    assert odometry.step(few, np.eye(4), np.eye(4))[0].T_odom_base is None


def wheels(T: Floats, stamp_ns: int) -> Odometry:
    position, quat = se3.to_position_quaternion(T)
    return Odometry(
        stamp_ns=stamp_ns, frame_id="odom", child_frame_id="base", position_m=position, quat_xyzw=quat, topic="/odom"
    )


@pytest.mark.parametrize("source", ["scan", "recording"])
def test_the_front_waits_for_the_odometry_of_a_cloud(source: str) -> None:
    setup = Setup(T_base_laser={"/points": np.eye(4)}, log=RunLog())
    front = RangeFront(parameters(**{"slamcli.odometry": source}), setup)
    poses, moments = truth(5), []
    assert list(front.take(wheels(poses[0], 0))) == []
    for k, T in enumerate(poses):
        if k:
            assert list(front.take(cloud(T, k * PERIOD_NS, k))) == []
            moments += list(front.take(wheels(T, k * PERIOD_NS)))
    moments += list(front.finish())
    assert [moment.step.stamp_ns for moment in moments] == [k * PERIOD_NS for k in range(1, 5)]
    first = moments[0].step.T_odom_base
    for k, moment in enumerate(moments):
        expected = se3.inverse(poses[1]) @ poses[k + 1]
        assert np.abs(se3.inverse(first) @ moment.step.T_odom_base - expected).max() < 0.02
        assert not moment.scan.planar


def test_the_front_refuses_what_it_cannot_use() -> None:
    setup = Setup(T_base_laser={}, log=RunLog())
    with pytest.raises(UsageError, match="aligns clouds in space"):
        RangeFront(parameters(Reg_Force3DoF=True), setup)
    front = RangeFront(parameters(), setup)
    with pytest.raises(UsageError, match="mount of the sensor on topic '/points' is unknown"):
        list(front.take(cloud(np.eye(4), 0, 0)))
    assert "no cloud" in front.why_nothing()
    assert "covers no scan" in RangeFront(parameters(**{"slamcli.odometry": "recording"}), setup).why_nothing()
    with pytest.raises(DataError, match="no cameras"):
        front.images(replace_nothing())


def replace_nothing():
    """Something with a stamp."""

    class Prepared:
        stamp_ns = 5

    return Prepared()
