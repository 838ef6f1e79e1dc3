# SPDX-License-Identifier: MIT
"""Heading and tilt from the IMU of a recording in the plane, with what is wrong with that IMU said aloud."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion
from slamcli.mapper import Setup
from slamcli.measurements import ImuSample
from slamcli.runtime import RunLog
from slamcli.trajectory.attitude import GRAVITY_RANGE_M_S2, Attitude, level_rotation, track_attitude

__all__ = ["Attitude", "attitude_of"]

_MOST_TURN_RAD_S = 35.0
_MULTIPLES_OF_G = (0.85, 1.15)
_LARGEST_TILT_DEG = 25.0
GRAVITY_M_S2 = 9.80665


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
    rates, forces = _mended(rates[good], forces[good], log)
    attitude = track_attitude(stamps, rates, forces, time_constant_s)
    if not attitude.has_gravity:
        low, high = GRAVITY_RANGE_M_S2
        log.warn(
            f"the IMU feels {attitude.mean_force_m_s2:.2f} m/s^2 on average, not gravity ({low:g} to {high:g}): "
            "its turning rate is used, its tilt is not"
        )
    if attitude.num_gaps:
        log.warn(f"the IMU is silent for more than half a second {attitude.num_gaps} times")
    return attitude


def _mended(
    rates: NDArray[np.float64], forces: NDArray[np.float64], log: RunLog
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rates and forces (N, 3) in m/s² where they are multiples of gravity, and level where the mount cannot be right."""
    middle = np.median(forces, axis=0)
    size = float(np.linalg.norm(middle))
    if _MULTIPLES_OF_G[0] < size < _MULTIPLES_OF_G[1]:
        log.warn(f"the IMU feels {size:.2f} typically: its accelerations are taken as multiples of gravity")
        forces, size = forces * GRAVITY_M_S2, size * GRAVITY_M_S2
        middle = middle * GRAVITY_M_S2
    if not GRAVITY_RANGE_M_S2[0] < size < GRAVITY_RANGE_M_S2[1]:
        return rates, forces
    tilt_deg = math.degrees(math.acos(float(np.clip(middle[2] / size, -1.0, 1.0))))
    if tilt_deg <= _LARGEST_TILT_DEG:
        return rates, forces
    log.warn(
        f"gravity is {tilt_deg:.0f}° from the vertical of the robot's frame: the IMU's mount is wrong (give it with --static-tf); "
        "its turning rate about gravity is used"
    )
    level = quaternion.to_matrix(level_rotation(middle / size))
    return rates @ level.T, forces @ level.T
