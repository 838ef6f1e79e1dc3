# SPDX-License-Identifier: MIT
"""What an IMU says about the motion between two times, with bias Jacobians and covariance, and the state that follows.

Forster, Carlone, Dellaert and Scaramuzza, "On-manifold preintegration for real-time visual-inertial odometry", T-RO 2017,
doi:10.1109/TRO.2016.2597321; biases walk within an interval as in gtsam's combined factor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import quaternion
from slamcli.measurements import ImuNoise
from slamcli.posegraph import _preintegration_kernels as kernels
from slamcli.posegraph.imu_samples import ImuSamples

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

POSITION_DENSITY = 1e-5
"""m/sqrt(s): what integration in steps may err by. It keeps covariances of one or two steps regular."""
WALK_FLOOR = 1e-9
"""Least density of a bias walk, for the same reason."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InertialState:
    """Where an IMU is, how fast it moves, and what its readings are off by."""

    T_map_imu: Floats
    """float64 (4, 4)."""
    velocity_map: Floats
    """float64 (3,), m/s."""
    biases: Floats
    """float64 (6,): gyroscope rad/s, accelerometer m/s^2; readings are truth plus bias."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Preintegration:
    """Motions over K intervals, each in the IMU's frame at its beginning, free of gravity and initial velocity."""

    begins_ns: Integers
    """int64 (K,)."""
    ends_ns: Integers
    """int64 (K,)."""
    biases: Floats
    """float64 (K, 6), gyroscope and accelerometer, that were taken off."""
    rotations: Floats
    """float64 (K, 3, 3), turn the frame at the end into that at the beginning."""
    velocities: Floats
    """float64 (K, 3), m/s."""
    positions: Floats
    """float64 (K, 3), m."""
    jacobians: Floats
    """float64 (K, 9, 6), derivatives of rotation (vector on the right), velocity and position by the biases."""
    covariances: Floats
    """float64 (K, 15, 15), of rotation (on the right), velocity, position (said minus true) and both biases
    (first minus second)."""
    gaps_s: Floats
    """float64 (K,), longest time without a sample in or around each interval."""

    def __len__(self) -> int:
        """Return the number of intervals."""
        return len(self.begins_ns)

    @property
    def seconds(self) -> Floats:
        """float64 (K,), lengths of the intervals."""
        return np.asarray((self.ends_ns - self.begins_ns) * 1e-9)


def preintegrate(
    samples: ImuSamples, begins_ns: Integers, ends_ns: Integers, biases: Floats, noise: ImuNoise
) -> Preintegration:
    """Return the motions over K intervals.

    Parameters
    ----------
    samples : N >= 1; between them, readings change linearly (the reading at an interval's border is interpolated);
        beyond the first and the last, those hold.
    begins_ns, ends_ns : int64 (K,), each end after its beginning.
    biases : float64 (K, 6) or (6,), gyroscope and accelerometer, to take off.
    noise : densities in continuous time; `frequency_hz` tells gaps from the usual period.

    Raises
    ------
    EstimationError
        If there is no sample, stamps do not increase, a value is not finite or an interval spans no time.

    Notes
    -----
    Rates and forces are constant within a step and forces act half way through its rotation (second order). Where samples
    are missing, the covariance grows with the change across the gap; what to do about `gaps_s` is the caller's choice.
    """
    begins, ends = (np.atleast_1d(np.ascontiguousarray(stamps, np.int64)) for stamps in (begins_ns, ends_ns))
    count = len(begins)
    off = np.ascontiguousarray(np.broadcast_to(np.asarray(biases, np.float64), (count, 6)))
    _check(samples, begins, ends, off)
    starts = np.maximum(np.searchsorted(samples.stamps_ns, begins, side="right") - 1, 0).astype(np.int64)
    densities = np.array(
        [
            noise.gyroscope, noise.accelerometer,
            max(noise.gyroscope_walk, WALK_FLOOR), max(noise.accelerometer_walk, WALK_FLOOR), POSITION_DENSITY,
        ]
    ) ** 2  # fmt: skip
    out = Preintegration(
        begins_ns=begins, ends_ns=ends, biases=off, rotations=np.empty((count, 3, 3)), velocities=np.empty((count, 3)),
        positions=np.empty((count, 3)), jacobians=np.empty((count, 9, 6)), covariances=np.empty((count, 15, 15)),
        gaps_s=np.empty(count),
    )  # fmt: skip
    kernels.preintegrate(
        np.ascontiguousarray(samples.stamps_ns, np.int64), np.ascontiguousarray(samples.angular_rad_s),
        np.ascontiguousarray(samples.acceleration_m_s2), begins, ends, starts, off, densities,
        round(1e9 / noise.frequency_hz), out.rotations, out.velocities, out.positions, out.jacobians, out.covariances,
        out.gaps_s,
    )  # fmt: skip
    return out


def _check(samples: ImuSamples, begins: Integers, ends: Integers, biases: Floats) -> None:
    if len(samples) == 0:
        raise EstimationError("there is no IMU sample to integrate")
    stamps = samples.stamps_ns
    if np.any(np.diff(stamps) <= 0):
        raise EstimationError(f"IMU samples do not increase in time at {stamps[1:][np.diff(stamps) <= 0][0]} ns")
    finite = np.isfinite(samples.angular_rad_s).all(axis=1) & np.isfinite(samples.acceleration_m_s2).all(axis=1)
    if not finite.all():
        raise EstimationError(f"the IMU sample at {stamps[~finite][0]} ns is not finite")
    if not np.isfinite(biases).all():
        raise EstimationError("a bias of the IMU is not finite")
    if np.any(ends <= begins):
        raise EstimationError(f"an interval of IMU samples spans no time, at {begins[ends <= begins][0]} ns")


def corrected(motions: Preintegration, biases: Floats) -> tuple[Floats, Floats, Floats]:
    """Return rotations (K, 3, 3), velocities (K, 3) and positions (K, 3) for other biases (K, 6), to first order.

    Good while biases move by less than some 0.05 rad/s and 0.5 m/s^2 over a second; then :func:`reintegrated`.
    """
    change = np.einsum("kij,kj->ki", motions.jacobians, biases - motions.biases)
    angle = np.linalg.norm(change[:, :3], axis=1, keepdims=True)
    half = 0.5 * np.sinc(angle / (2 * np.pi)) * change[:, :3]
    turns = quaternion.to_matrix(np.concatenate([half, np.cos(angle / 2)], axis=1))
    return motions.rotations @ turns, motions.velocities + change[:, 3:6], motions.positions + change[:, 6:]


def reintegrated(
    motions: Preintegration,
    samples: ImuSamples,
    biases: Floats,
    noise: ImuNoise,
    *,
    gyroscope_rad_s: float = 0.01,
    accelerometer_m_s2: float = 0.1,
) -> Preintegration:
    """Return the motions, those integrated anew whose biases (K, 6) moved by more than the two bounds."""
    moved = np.abs(biases - motions.biases)
    far = np.flatnonzero((moved[:, :3] > gyroscope_rad_s).any(axis=1) | (moved[:, 3:] > accelerometer_m_s2).any(axis=1))
    if len(far) == 0:
        return motions
    anew = preintegrate(samples, motions.begins_ns[far], motions.ends_ns[far], biases[far], noise)
    columns = {}
    for name in ("biases", "rotations", "velocities", "positions", "jacobians", "covariances", "gaps_s"):
        column = getattr(motions, name).copy()
        column[far] = getattr(anew, name)
        columns[name] = column
    return replace(motions, **columns)


def predict(state: InertialState, motion: Preintegration, gravity_map: Floats, row: int = 0) -> InertialState:
    """Return the state at the end of interval `row` from that at its beginning.

    Parameters
    ----------
    gravity_map : float64 (3,), m/s^2, pointing down: (0, 0, -9.81) where z is up.
    """
    one = Preintegration(**{name: getattr(motion, name)[row : row + 1] for name in Preintegration.__slots__})
    rotation, velocity, position = (values[0] for values in corrected(one, state.biases[None]))
    t, turn = float(one.seconds[0]), state.T_map_imu[:3, :3]
    T_map_imu = np.eye(4)
    T_map_imu[:3, :3] = quaternion.to_matrix(quaternion.from_matrix(turn @ rotation))  # stays a rotation
    T_map_imu[:3, 3] = state.T_map_imu[:3, 3] + t * state.velocity_map + 0.5 * t * t * gravity_map + turn @ position
    return InertialState(
        T_map_imu=T_map_imu, velocity_map=state.velocity_map + t * gravity_map + turn @ velocity, biases=state.biases
    )


def warm() -> None:
    """Compile the kernels of this module with two samples."""
    stamps = np.array([0, 5_000_000], np.int64)
    samples = ImuSamples(stamps_ns=stamps, angular_rad_s=np.zeros((2, 3)), acceleration_m_s2=np.zeros((2, 3)))
    preintegrate(samples, stamps[:1], stamps[1:], np.zeros(6), ImuNoise())
