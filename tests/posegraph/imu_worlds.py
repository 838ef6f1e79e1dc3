# SPDX-License-Identifier: MIT
"""IMU samples along known rides, noisy and biased on demand."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from spatial_worlds import Ride

from slamcli.measurements import ImuNoise
from slamcli.posegraph.imu_preintegration import InertialState
from slamcli.posegraph.imu_samples import ImuSamples
from slamcli.posegraph.inertial_alignment import VisualPoses

GRAVITY = np.array([0.0, 0.0, -9.80665])
NOISE = ImuNoise()


def ride_samples(ride, begin_s, end_s, rate_hz=200.0, *, noise=None, biases=None, seed=0):
    """Samples of `ride` and the biases (N, 6) in them; `noise` adds white noise and lets `biases` walk."""
    t = np.arange(round(begin_s * rate_hz), round(end_s * rate_hz) + 1) / rate_hz
    values = np.concatenate(ride.imu(t), axis=1)
    off = np.tile(np.zeros(6) if biases is None else biases, (len(t), 1))
    if noise is not None:
        rng = np.random.default_rng(seed)
        white = np.repeat([noise.gyroscope, noise.accelerometer], 3) * np.sqrt(rate_hz)
        walk = np.repeat([noise.gyroscope_walk, noise.accelerometer_walk], 3) / np.sqrt(rate_hz)
        off = off + np.cumsum(rng.normal(size=values.shape) * walk, axis=0)
        values = values + rng.normal(size=values.shape) * white
    values = values + off
    stamps = np.round(t * 1e9).astype(np.int64)
    return ImuSamples(stamps_ns=stamps, angular_rad_s=values[:, :3], acceleration_m_s2=values[:, 3:]), off


def ride_state(ride, t, biases=None):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = ride.rotation(t).as_matrix(), ride.position(t)
    step = 1e-5
    velocity = (ride.position(t + step) - ride.position(t - step)) / (2 * step)
    return InertialState(
        T_map_imu=pose, velocity_map=velocity, biases=np.zeros(6) if biases is None else np.asarray(biases)
    )


T_CAMERA_IMU = np.eye(4)
T_CAMERA_IMU[:3, :3] = Rotation.from_rotvec([0.3, -1.2, 0.5]).as_matrix()
T_CAMERA_IMU[:3, 3] = [0.05, -0.03, 0.08]


def camera_ride(seconds, seed, *, begin=1.0, noise=NOISE, still=False, position_m=2e-3, rotation_rad=5e-4, scale=2.5):
    """Poses of a camera in a turned map of units `scale` metres long, samples, gravity in that map and the mean biases."""
    rng, ride = np.random.default_rng(seed), Ride()
    biases = np.concatenate([rng.normal(size=3) * 0.02, rng.normal(size=3) * 0.1])
    samples, off = ride_samples(ride, begin - 0.5, begin + seconds + 0.5, noise=noise, biases=biases, seed=seed)
    t = begin + np.arange(0, seconds + 1e-9, 0.25)
    if still:  # the same, as if time stood still at the beginning
        t_felt = np.full_like(t, begin)
        rest = np.concatenate([np.zeros(3), ride.rotation(begin).inv().apply([0.0, 0.0, 9.80665])])
        felt = off + rest + rng.normal(size=off.shape) * np.repeat([2.4e-3, 2.8e-2], 3)
        samples = ImuSamples(stamps_ns=samples.stamps_ns, angular_rad_s=felt[:, :3], acceleration_m_s2=felt[:, 3:])
    else:
        t_felt = t
    turned = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    rotations = ride.rotation(t_felt).as_matrix() @ T_CAMERA_IMU[:3, :3].T
    positions = (ride.position(t_felt) - rotations @ T_CAMERA_IMU[:3, 3]) @ turned.T
    shaken = Rotation.from_rotvec(rng.normal(size=(len(t), 3)) * rotation_rad).as_matrix()
    poses = VisualPoses(
        stamps_ns=np.round(t * 1e9).astype(np.int64),
        rotations=turned @ rotations @ shaken,
        positions=(positions + rng.normal(size=positions.shape) * position_m) / scale,
        T_camera_imu=T_CAMERA_IMU,
    )
    return poses, samples, turned @ GRAVITY, off.mean(axis=0)


__all__ = ["GRAVITY", "NOISE", "T_CAMERA_IMU", "Ride", "camera_ride", "ride_samples", "ride_state"]
