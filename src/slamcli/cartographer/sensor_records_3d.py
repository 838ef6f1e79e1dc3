# SPDX-License-Identifier: MIT
"""What is kept of the IMU, odometry and GPS for the optimisation and for a saved state."""

from __future__ import annotations

from array import array

import numpy as np

from slamcli.cartographer.imu_track import ImuTrack
from slamcli.cartographer.pose_graph_3d import FixRecord, ImuRecord
from slamcli.measurements import ImuSample, StampedPose

BIN_NS = 9_000_000
"""Samples of an IMU that are closer than this are averaged: what turns within it is not told apart by any pose."""


class ImuLog:
    """Samples in the base frame without the gyroscope's bias, at most about 100 per second: 56 bytes each."""

    def __init__(self, frame_id: str) -> None:
        self._frame_id = frame_id
        self._stamps: array[int] = array("q")
        self._numbers: array[float] = array("d")
        self._begin_ns: int | None = None
        self._sum = np.zeros(6)
        self._count = 0
        self._last_ns = 0

    def add(self, track: ImuTrack) -> None:
        """Take the track's last sample."""
        stamp, rate, force = track.latest()
        if self._begin_ns is not None and stamp - self._begin_ns >= BIN_NS:
            self._close()
        if self._begin_ns is None:
            self._begin_ns = stamp
        self._sum += np.concatenate([rate, force])
        self._count, self._last_ns = self._count + 1, stamp

    def _close(self) -> None:
        if self._count and self._begin_ns is not None:
            # Of equal weights the middle: a sample holds around its stamp.
            self._stamps.append((self._begin_ns + self._last_ns) // 2)
            self._numbers.extend(self._sum / self._count)
        self._begin_ns, self._count = None, 0
        self._sum[:] = 0.0

    def record(self, *, has_gravity: bool) -> ImuRecord | None:
        """Return all samples; None if there were none."""
        self._close()
        if not self._stamps:
            return None
        numbers = np.array(self._numbers).reshape(-1, 6)
        return ImuRecord(
            stamps_ns=np.array(self._stamps, dtype=np.int64),
            rates_rad_s=numbers[:, :3].copy(),
            forces_m_s2=numbers[:, 3:].copy(),
            has_gravity=has_gravity,
        )

    def samples(self) -> tuple[ImuSample, ...]:
        """Return all samples as a state holds them."""
        record = self.record(has_gravity=True)
        if record is None:
            return ()
        rows = zip(record.stamps_ns, record.rates_rad_s, record.forces_m_s2, strict=True)
        return tuple(
            ImuSample(stamp_ns=int(t), frame_id=self._frame_id, angular_rad_s=w, acceleration_m_s2=f)
            for t, w, f in rows
        )


def imu_record_of(samples: tuple[ImuSample, ...]) -> ImuRecord | None:
    """Return the samples of a loaded trajectory; None if there are none or they do not feel gravity."""
    if len(samples) < 2:
        return None
    forces = np.array([s.acceleration_m_s2 for s in samples])
    size = float(np.linalg.norm(forces.mean(axis=0)))
    stamps = np.array([s.stamp_ns for s in samples], dtype=np.int64)
    later = np.concatenate([[True], np.diff(stamps) > 0])
    rates = np.array([s.angular_rad_s for s in samples])
    return ImuRecord(
        stamps_ns=stamps[later], rates_rad_s=rates[later], forces_m_s2=forces[later], has_gravity=7.0 < size < 13.0
    )


def fix_record_of(poses: list[StampedPose], lever_base_m: np.ndarray) -> FixRecord | None:
    """Return fixed-frame poses in the order of time; None if there are fewer than two."""
    in_time = sorted(poses, key=lambda pose: pose.stamp_ns)
    stamps = np.array([pose.stamp_ns for pose in in_time], dtype=np.int64)
    if len(stamps) < 2:
        return None
    later = np.concatenate([[True], np.diff(stamps) > 0])
    return FixRecord(
        stamps_ns=stamps[later],
        positions_m=np.array([pose.position_m for pose in in_time])[later],
        lever_base_m=lever_base_m,
    )
