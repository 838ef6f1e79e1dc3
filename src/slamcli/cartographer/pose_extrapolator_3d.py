# SPDX-License-Identifier: MIT
"""Where the robot is before a scan is matched: the last pose, carried on by gyroscope, odometry or constant velocity."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.imu_track import ImuTrack
from slamcli.geometry import quaternion, se3
from slamcli.measurements import Odometry

LONGEST_COAST_NS = 1_000_000_000
"""A velocity holds no longer than this without a new pose."""
LEAP_M, LEAP_M_S2 = 0.5, 50.0
"""A step of odometry that is longer, and would need more acceleration than five times gravity, was not driven."""
VELOCITY_GAIN = 0.5
"""How much of a new velocity is believed: where a corridor leaves its length open, the noise of the last step would go on."""


class PoseExtrapolator3D:
    """Poses ``T_local_base`` at times around and after the last matched one.

    Rotation comes from the gyroscope where there is one, else from odometry, else from the last two poses; translation from
    odometry, else from the last two poses (constant velocity in the local frame).
    """

    def __init__(self, imu: ImuTrack) -> None:
        self.imu = imu
        self._stamp_ns: int | None = None
        self._T = np.eye(4)
        self._velocity = np.zeros(3)
        self._rate = np.zeros(3)
        self._odometry: deque[tuple[int, NDArray[np.float64]]] = deque()
        self._T_shifted = np.eye(4)  # what takes leaps out of odometry

    @property
    def stamp_ns(self) -> int | None:
        """Time of the last pose; None before the first."""
        return self._stamp_ns

    @property
    def T_local_base(self) -> NDArray[np.float64]:  # noqa: N802 - frames stand in its name
        """The last pose, float64 (4, 4)."""
        return self._T

    def add_odometry(self, sample: Odometry) -> None:
        """Take the next odometry pose; one that is not later than the one before is left out."""
        if self._odometry and sample.stamp_ns <= self._odometry[-1][0]:
            return
        T = self._T_shifted @ se3.from_position_quaternion(sample.position_m, quaternion.normalise(sample.quat_xyzw))
        if len(self._odometry) > 1 and (leap_m := self._leap(sample.stamp_ns, T)) > 0:
            driven = self._driven(sample.stamp_ns)
            self._T_shifted = driven @ se3.inverse(T) @ self._T_shifted
            T = driven
            if not self.imu.log.counts["leaps of odometry"]:
                self.imu.log.warn(
                    f"odometry leaps by {leap_m:.1f} m at {sample.stamp_ns / 1e9:.3f} s: it is followed as if it had not"
                )
            self.imu.log.counts["leaps of odometry"] += 1
        self._odometry.append((sample.stamp_ns, T))
        # What came since the last pose stays: it leads over a time in which the range sensor saw nothing.
        enough_ns = min(
            sample.stamp_ns - 2 * LONGEST_COAST_NS, sample.stamp_ns if self._stamp_ns is None else self._stamp_ns
        )
        while len(self._odometry) > 2 and self._odometry[1][0] < enough_ns:
            self._odometry.popleft()

    def _leap(self, stamp_ns: int, T: NDArray[np.float64]) -> float:
        """Return how far odometry moved, metres, if nothing can move like that; else 0."""
        (_, before), (last_ns, last) = self._odometry[-2], self._odometry[-1]
        dt, dt_before = (stamp_ns - last_ns) * 1e-9, (last_ns - self._odometry[-2][0]) * 1e-9
        moved, moved_before = np.linalg.norm(T[:3, 3] - last[:3, 3]), np.linalg.norm(last[:3, 3] - before[:3, 3])
        needed = (moved / dt - moved_before / dt_before) / dt
        return float(moved) if moved > LEAP_M and needed > LEAP_M_S2 else 0.0

    def _driven(self, stamp_ns: int) -> NDArray[np.float64]:
        """Return where the last motion of odometry leads to, (4, 4)."""
        (before_ns, before), (last_ns, last) = self._odometry[-2], self._odometry[-1]
        step, share = se3.inverse(before) @ last, (stamp_ns - last_ns) / (last_ns - before_ns)
        turn = from_rotation_vector(share * rotation_vectors(step[None, :3, :3]))
        return last @ se3.from_position_quaternion(share * step[:3, 3], turn[0])

    def add_pose(self, stamp_ns: int, T_local_base: NDArray[np.float64]) -> None:
        """Take a matched pose; velocities are those between it and the pose before."""
        if self._stamp_ns is not None and stamp_ns > self._stamp_ns:
            dt = (stamp_ns - self._stamp_ns) * 1e-9
            velocity = (T_local_base[:3, 3] - self._T[:3, 3]) / dt
            self._velocity = self._velocity + VELOCITY_GAIN * (velocity - self._velocity)
            self._rate = rotation_vector(self._T[:3, :3].T @ T_local_base[:3, :3]) / dt
        # Predictions are built on this pose, poses on predictions: rounding must not grow from one to the next.
        upright = quaternion.normalise(quaternion.from_matrix(T_local_base[:3, :3]))
        self._stamp_ns, self._T = stamp_ns, se3.from_position_quaternion(T_local_base[:3, 3], upright)
        self.imu.needed_since_ns = stamp_ns

    def poses(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return ``T_local_base`` float64 (K, 4, 4) at increasing times; before the last pose velocities run backwards."""
        if self._stamp_ns is None:
            return np.broadcast_to(self._T, (len(stamps_ns), 4, 4)).copy()
        wheels = self._by_odometry(stamps_ns)
        dt = np.asarray(
            np.clip(stamps_ns - self._stamp_ns, -LONGEST_COAST_NS, LONGEST_COAST_NS) * 1e-9, dtype=np.float64
        )
        if wheels is None:
            shifts = self._T[:3, 3] + dt[:, None] * self._velocity
            turns = self._constant_turns(dt)
        else:
            shifts, turns = wheels[:, :3, 3], self._T[:3, :3].T @ wheels[:, :3, :3]
        gyro = self.imu.rotations(self._stamp_ns, stamps_ns)
        if gyro is not None:
            after = stamps_ns >= self._stamp_ns
            turns = np.where(after[:, None, None], quaternion.to_matrix(gyro), self._constant_turns(dt))
        return se3.from_rotation_translation(self._T[:3, :3] @ turns, shifts)

    def turn_by_constant_rate(self, stamp_ns: int) -> NDArray[np.float64]:
        """Return the orientation (3, 3) that the last rotation, carried on, leads to."""
        dt = (stamp_ns - (stamp_ns if self._stamp_ns is None else self._stamp_ns)) * 1e-9
        return self._T[:3, :3] @ self._constant_turns(np.array([dt]))[0]

    def _constant_turns(self, dt: NDArray[np.float64]) -> NDArray[np.float64]:
        return quaternion.to_matrix(from_rotation_vector(dt[:, None] * self._rate))

    def _by_odometry(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64] | None:
        """Return the poses that odometry leads to from the last pose; None where it does not reach."""
        if len(self._odometry) < 2 or self._stamp_ns is None:
            return None
        times = np.array([t for t, _ in self._odometry], dtype=np.int64)
        if times[0] > self._stamp_ns or times[-1] < int(stamps_ns[-1]) - LONGEST_COAST_NS // 2:
            return None
        if np.diff(times[np.searchsorted(times, self._stamp_ns, side="right") - 1 :]).max(initial=0) > LONGEST_COAST_NS:
            return None
        track = np.array([T for _, T in self._odometry])
        wanted = np.concatenate([[self._stamp_ns], stamps_ns])
        after = np.clip(np.searchsorted(times, wanted, side="right"), 1, len(times) - 1)
        before = after - 1
        # Beyond the last sample its last motion goes on.
        fraction = (wanted - times[before]) / (times[after] - times[before])
        step = se3.inverse(track[before]) @ track[after]
        turn = from_rotation_vector(fraction[:, None] * rotation_vectors(step[:, :3, :3]))
        at = track[before] @ se3.from_position_quaternion(fraction[:, None] * step[:, :3, 3], turn)
        return self._T @ se3.inverse(at[0]) @ at[1:]


def rotation_vectors(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation vectors (N, 3), radians, of rotation matrices (N, 3, 3)."""
    quats = quaternion.from_matrix(rotations)
    sine = np.linalg.norm(quats[:, :3], axis=1)
    angle = 2.0 * np.arctan2(sine, quats[:, 3])
    return quats[:, :3] * np.where(sine > 1e-12, angle / np.where(sine > 1e-12, sine, 1.0), 2.0)[:, None]


def rotation_vector(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation vector (3,), radians, of a rotation matrix (3, 3)."""
    vector: NDArray[np.float64] = rotation_vectors(rotation[None])[0]
    return vector


def from_rotation_vector(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quaternions xyzw (N, 4) of rotation vectors (N, 3), radians."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    scale = np.where(angle > 1e-9, np.sin(angle / 2) / np.where(angle > 1e-9, angle, 1.0), 0.5)
    return np.concatenate([vectors * scale, np.cos(angle / 2)], axis=1)
