# SPDX-License-Identifier: MIT
"""IMU samples along known rides, noisy and biased on demand."""

from __future__ import annotations

import numpy as np
from spatial_worlds import Ride

from slamcli.measurements import ImuNoise
from slamcli.posegraph.imu_preintegration import InertialState
from slamcli.posegraph.imu_samples import ImuSamples

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


__all__ = ["GRAVITY", "NOISE", "Ride", "ride_samples", "ride_state"]
