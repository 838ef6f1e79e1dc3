# SPDX-License-Identifier: MIT
"""A camera with an IMU that wanders through the round room, and the session that follows it."""

from __future__ import annotations

import math

import numpy as np
from loop_world import SCALES, World
from scipy.spatial.transform import Rotation

from slamcli.measurements import ImuNoise, ImuSample
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.inertial_state import Imu
from slamcli.orbslam3.keyframe_rules import KeyframeSettings
from slamcli.orbslam3.local_mapping import MappingSettings
from slamcli.orbslam3.session import Session, SessionSettings
from slamcli.orbslam3.tracking import TrackingSettings
from slamcli.vision.matching import feature_grid

RATE_HZ, IMU_HZ = 15, 200
NOISE = ImuNoise()
BIASES = np.array([0.005, -0.008, 0.004, 0.06, -0.08, 0.05])
T_CAMERA_IMU = np.eye(4)
T_CAMERA_IMU[:3, :3] = Rotation.from_rotvec([0.2, -0.4, 1.0]).as_matrix()
T_CAMERA_IMU[:3, 3] = [0.04, 0.06, -0.03]


def pose(t, *, still=False):
    """Pose of the camera in the room (4, 4) at a time."""
    t = 0.0 if still else t
    turn = 0.3 * t + 0.15 * np.sin(1.3 * t)
    radius = 1.8 + 0.3 * np.sin(1.7 * t)
    c, s = np.cos(turn), np.sin(turn)
    out = np.eye(4)
    ahead = np.stack([[s, -c, 0.0], [0.0, 0.0, -1.0], [c, s, 0.0]], axis=1)
    wobble = Rotation.from_rotvec([0.1 * np.sin(1.9 * t), 0.08 * np.sin(1.1 * t), 0.12 * np.sin(1.5 * t)])
    out[:3, :3] = ahead @ wobble.as_matrix()
    out[:3, 3] = [radius * c, radius * s, 0.35 * np.sin(2.1 * t)]
    return out


def reading(t, rng, *, still=False):
    """What the IMU says at a time: rates and forces (6,)."""
    step = 1e-3
    before, now, after = (pose(t + d, still=still) @ T_CAMERA_IMU for d in (-step, 0.0, step))
    rate = Rotation.from_matrix(before[:3, :3].T @ after[:3, :3]).as_rotvec() / (2 * step)
    pull = (after[:3, 3] - 2 * now[:3, 3] + before[:3, 3]) / step**2
    force = now[:3, :3].T @ (pull + np.array([0.0, 0.0, 9.80665]))
    white = np.repeat([NOISE.gyroscope, NOISE.accelerometer], 3) * np.sqrt(IMU_HZ)
    return np.concatenate([rate, force]) + BIASES + rng.normal(size=6) * white


def settings(stereo, **more):
    close_m = 8.0 if stereo else math.inf
    return SessionSettings(
        tracking=TrackingSettings(motion_radius=15.0, local_radius=3.0),
        keyframes=KeyframeSettings(share=0.75 if stereo else 0.9, close_m=close_m),
        mapping=MappingSettings(
            num_neighbours=10 if stereo else 20, close_m=close_m, least_observations=3 if stereo else 2
        ),
        close_m=close_m, farthest_m=math.inf, least_start=100, **more,
    )  # fmt: skip


def travel(
    seconds, *, stereo, inertial=True, still=False, blind=(0.0, 0.0), clock_s=0.0, factors=(1.0, 1.0), seed=0, **more
):
    """A session at its end, with the true poses of all frames (N, 4, 4).

    The IMU's clock is ahead by `clock_s`, and its rates and forces come `factors` times as large.
    """
    world = World(stereo=stereo, focal_error=0.0, count=2000, seed=seed)
    imu = Imu(T_camera_imu=T_CAMERA_IMU, given_noise=NOISE, fixed_scale=stereo) if inertial else None
    session, rng, truth, fed = (
        Session(world.camera, SCALES, settings(stereo, **more), imu=imu),
        np.random.default_rng(seed),
        [],
        0,
    )
    for number in range(round(seconds * RATE_HZ)):
        t = number / RATE_HZ
        while imu is not None and (fed - 1) / IMU_HZ <= t:
            values = reading(fed / IMU_HZ - clock_s, rng, still=still) * np.repeat(factors, 3)
            imu.buffer.add(
                ImuSample(
                    stamp_ns=round(fed / IMU_HZ * 1e9), frame_id="imu", angular_rad_s=values[:3],
                    acceleration_m_s2=values[3:],
                )
            )  # fmt: skip
            fed += 1
        T_world_camera = pose(t, still=still)
        truth.append(T_world_camera)
        features, _ = world.look(np.linalg.inv(T_world_camera))
        if blind[0] <= t < blind[1]:
            features = type(features)(**{name: getattr(features, name)[:0] for name in features.__slots__})
        session.take(
            Frame(
                number=number, stamp_ns=round(t * 1e9), features=features, grid=feature_grid(features, world.camera),
                points=np.full(len(features), -1),
            )
        )  # fmt: skip
    session.finish()
    return session, np.array(truth)


def position_errors(session, truth, *, with_scale=False):
    """Errors (N,) of the keyframes' positions after alignment, the scale that it took, and the map's rotation (3, 3)."""
    sparse_map = session.map
    living = sparse_map.living_keyframes
    found, true = sparse_map.centres[living], truth[sparse_map.frame_number[living], :3, 3]
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, d, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    turn = u @ sign @ vt
    scale = float((d * np.diag(sign)).sum() / (a**2).sum())
    return np.linalg.norm(b - (scale if with_scale else 1.0) * a @ turn.T, axis=1), scale, turn
