# SPDX-License-Identifier: MIT
"""Heading and tilt from the IMU of a recording in the plane, with what is wrong with that IMU said aloud."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slamcli.mapper import Setup
from slamcli.measurements import ImuSample
from slamcli.trajectory.attitude import GRAVITY_RANGE_M_S2, Attitude, track_attitude

__all__ = ["Attitude", "attitude_of"]

_MOST_TURN_RAD_S = 35.0


def attitude_of(samples: Sequence[ImuSample], setup: Setup, time_constant_s: float) -> Attitude | None:
    """Return the attitude of the base, or None where the samples cannot be those of an IMU on a robot."""
    log = setup.log
    mounts = [setup.T_base_sensor.get(sample.topic, np.eye(4))[:3, :3] for sample in samples]
    rates = np.array([mount @ sample.angular_rad_s for mount, sample in zip(mounts, samples, strict=True)])
    forces = np.array([mount @ sample.acceleration_m_s2 for mount, sample in zip(mounts, samples, strict=True)])
    good = np.isfinite(rates).all(axis=1) & np.isfinite(forces).all(axis=1)
    if not good.all():
        log.warn(f"{int((~good).sum())} of {len(good)} IMU samples are not finite: they are left out")
    if good.sum() < 2 or float(np.abs(rates[good]).max()) > _MOST_TURN_RAD_S:
        log.warn("the IMU tells no turning rates of a robot (are they degrees per second?): it is not used")
        return None
    stamps = [sample.stamp_ns for sample, ok in zip(samples, good, strict=True) if ok]
    attitude = track_attitude(stamps, rates[good], forces[good], time_constant_s)
    if not attitude.has_gravity:
        low, high = GRAVITY_RANGE_M_S2
        log.warn(
            f"the IMU feels {attitude.mean_force_m_s2:.2f} m/s^2 on average, not gravity ({low:g} to {high:g}): "
            "its turning rate is used, its tilt is not"
        )
    if attitude.num_gaps:
        log.warn(f"the IMU is silent for more than half a second {attitude.num_gaps} times")
    return attitude
