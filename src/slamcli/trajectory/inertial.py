# SPDX-License-Identifier: MIT
"""Heading and tilt of a robot from its IMU: gyroscope integrated, gravity followed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import ImuSample
from slamcli.runtime import RunLog

_LONGEST_GAP_NS = 200_000_000
_MULTIPLES_OF_G = (0.85, 1.15)
_GRAVITY_LIMITS_M_S2 = (7.0, 13.0)
_FASTEST_RAD_S = 35.0
_LARGEST_TILT_DEG = 25.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InertialTrack:
    """What an IMU measured, in the base frame, with increasing stamps."""

    stamps_ns: NDArray[np.int64]
    """int64 (M,), M >= 2."""
    rates_rad_s: NDArray[np.float64]
    """float64 (M, 3)."""
    up: NDArray[np.float64]
    """float64 (M, 3), unit vector against gravity; (0, 0, 1) throughout where the IMU does not feel it."""
    has_gravity: bool
    is_level: bool = False
    """Whether the base is taken as level, as the IMU does not feel gravity or is mounted otherwise than is known."""

    def headings(self, stamps_ns: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the heading at stamps (N,), radians, not wrapped, from 0 at the first sample; and where it is known.

        The turning rate about the vertical is integrated by the trapezoidal rule. It is not known outside of the samples and
        in gaps of more than 0.2 s, over which the heading goes on at the rates at their ends.
        """
        rate = np.einsum("ij,ij->i", self.rates_rad_s, self.up)
        seconds = np.diff(self.stamps_ns) / 1e9
        heading = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * seconds)])
        after = np.clip(np.searchsorted(self.stamps_ns, stamps_ns), 1, len(self.stamps_ns) - 1)
        gap_ns = self.stamps_ns[after] - self.stamps_ns[after - 1]
        inside = (stamps_ns >= self.stamps_ns[0]) & (stamps_ns <= self.stamps_ns[-1])
        times = (self.stamps_ns - self.stamps_ns[0]).astype(np.float64)
        found = np.interp((stamps_ns - self.stamps_ns[0]).astype(np.float64), times, heading)
        return found, inside & (gap_ns <= _LONGEST_GAP_NS)

    def tilts(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the rotation (N, 4), xyzw, without heading, of the base into a frame whose z is up, at stamps (N,)."""
        if self.is_level:
            return np.tile([0.0, 0.0, 0.0, 1.0], (len(stamps_ns), 1))
        nearest = np.searchsorted(self.stamps_ns, stamps_ns)
        nearest = np.clip(nearest, 1, len(self.stamps_ns) - 1)
        earlier = stamps_ns - self.stamps_ns[nearest - 1] < self.stamps_ns[nearest] - stamps_ns
        return level_rotation(self.up[np.where(earlier, nearest - 1, nearest)])


def level_rotation(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest rotations (N, 4), xyzw, that turn unit vectors (N, 3) to (0, 0, 1)."""
    axis = np.column_stack([up[:, 1], -up[:, 0], np.zeros(len(up))])
    turned = np.column_stack([axis, 1.0 + up[:, 2]])
    # Upside down any axis in the plane will do.
    turned[np.linalg.norm(turned, axis=1) < 1e-9] = (1.0, 0.0, 0.0, 0.0)
    result: NDArray[np.float64] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return result


def inertial_track(
    samples: Sequence[ImuSample],
    T_base_sensor: Mapping[str, NDArray[np.float64]],
    gravity_time_constant_s: float,
    log: RunLog,
) -> InertialTrack | None:
    """Return the track of an IMU, None for fewer than two usable samples.

    Samples that are not finite or not later than the one before are left out, counted. Specific forces of about 1 are
    taken as multiples of gravity; where they are far from gravity the base is taken as level. Where gravity is typically more
    than 25° from the base's vertical the mount must be wrong: the turning rate about gravity is right even so, and the base
    is taken as level. All of that is warned of, and so are turning rates in what must be degrees.

    Parameters
    ----------
    samples
        In recorded order.
    T_base_sensor
        Mount of the IMU by topic, float64 (4, 4).
    gravity_time_constant_s
        Over which the accelerometer corrects the vertical that the gyroscope carries on.

    References
    ----------
    Mahony, Hamel and Pflimlin, IEEE TAC 2008, section III (complementary filter); Cartographer's imu_gravity_time_constant.
    """
    kept = _usable(samples, log)
    if len(kept) < 2:
        return None
    rotation = np.asarray(T_base_sensor.get(kept[0].topic, np.eye(4)))[:3, :3]
    stamps = np.array([sample.stamp_ns for sample in kept], dtype=np.int64)
    rates = np.array([sample.angular_rad_s for sample in kept]) @ rotation.T
    forces = np.array([sample.acceleration_m_s2 for sample in kept]) @ rotation.T
    fastest = float(np.abs(rates).max())
    if fastest > _FASTEST_RAD_S:
        log.warn(f"the IMU turns at up to {fastest:.3g} rad/s: its gyroscope seems to tell degrees per second")
    has_gravity = _feels_gravity(forces, log)
    if not has_gravity:
        up = np.tile([0.0, 0.0, 1.0], (len(kept), 1))
        return InertialTrack(stamps_ns=stamps, rates_rad_s=rates, up=up, has_gravity=False, is_level=True)
    up = _follow_gravity(stamps, rates, forces, gravity_time_constant_s)
    tilt = math.degrees(math.acos(min(1.0, max(-1.0, float(np.median(up[:, 2]))))))
    if tilt > _LARGEST_TILT_DEG:
        log.warn(
            f"gravity is {tilt:.0f}° from the vertical of the robot's frame: the IMU's mount is wrong (give it with --static-tf); "
            "its turning rate about gravity is used, and the robot is taken as level"
        )
    return InertialTrack(
        stamps_ns=stamps, rates_rad_s=rates, up=up, has_gravity=True, is_level=tilt > _LARGEST_TILT_DEG
    )


def _usable(samples: Sequence[ImuSample], log: RunLog) -> list[ImuSample]:
    kept: list[ImuSample] = []
    for sample in samples:
        if not (np.isfinite(sample.angular_rad_s).all() and np.isfinite(sample.acceleration_m_s2).all()):
            log.counts["IMU samples that are not finite"] += 1
        elif kept and sample.stamp_ns <= kept[-1].stamp_ns:
            log.counts["IMU samples that are not later than the one before"] += 1
        else:
            kept.append(sample)
    return kept


def _feels_gravity(forces: NDArray[np.float64], log: RunLog) -> bool:
    """Return whether the forces (M, 3) hold gravity, by the size of their median."""
    size = float(np.median(np.linalg.norm(forces, axis=1)))
    if _MULTIPLES_OF_G[0] < size < _MULTIPLES_OF_G[1]:
        log.warn(f"the IMU feels {size:.2f} typically: its accelerations are taken as multiples of gravity")
        return True
    if _GRAVITY_LIMITS_M_S2[0] < size < _GRAVITY_LIMITS_M_S2[1]:
        return True
    log.warn(
        f"the IMU feels {size:.3g} m/s² typically, not gravity: its gyroscope is used, and the robot is taken as level"
    )
    return False


def _follow_gravity(
    stamps_ns: NDArray[np.int64], rates: NDArray[np.float64], forces: NDArray[np.float64], constant_s: float
) -> NDArray[np.float64]:
    """Return the unit vectors (M, 3) against gravity in the base frame: turned by the gyroscope, drawn to the force.

    It starts at the mean force of the first time constant, or second if that is shorter.
    """
    first = stamps_ns - stamps_ns[0] <= round(min(constant_s, 1.0) * 1e9)
    x, y, z = (float(v) for v in forces[first].mean(axis=0))
    size = math.sqrt(x * x + y * y + z * z) or 1.0
    x, y, z = x / size, y / size, z / size
    up = np.empty((len(stamps_ns), 3))
    units = forces / np.maximum(np.linalg.norm(forces, axis=1, keepdims=True), 1e-9)
    steps = np.minimum(np.diff(stamps_ns, prepend=stamps_ns[0]) / 1e9, 1.0).tolist()
    gains = (1.0 - np.exp(-np.array(steps) / constant_s)).tolist()
    rows = zip(steps, gains, rates.tolist(), units.tolist(), strict=True)
    for k, (dt, gain, (p, q, r), (fx, fy, fz)) in enumerate(rows):
        # d(up)/dt = up x rate in the turning base.
        x, y, z = x + dt * (y * r - z * q), y + dt * (z * p - x * r), z + dt * (x * q - y * p)
        x, y, z = x + gain * (fx - x), y + gain * (fy - y), z + gain * (fz - z)
        size = math.sqrt(x * x + y * y + z * z) or 1.0
        x, y, z = x / size, y / size, z / size
        up[k] = x, y, z
    return up
