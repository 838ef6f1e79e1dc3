# SPDX-License-Identifier: MIT
"""What an IMU says between two scans: rotation from its gyroscope, the vertical from its accelerometer."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer import _sweep_kernels as kernels
from slamcli.measurements import ImuSample
from slamcli.runtime import RunLog

STANDARD_GRAVITY_M_S2 = 9.80665
KEPT_NS = 2_000_000_000
"""How long samples are kept: longer than the gap between two scans."""
LONGEST_KEPT_NS = 60_000_000_000
"""Where the range sensor sees nothing they are kept since then, but no longer than this."""
LONGEST_GAP_NS = 200_000_000
"""Over a longer time without a sample the gyroscope is not asked."""
BIAS_TIME_CONSTANT_S = 10.0
TRUSTED_TURN_RAD = 0.01
"""Below this disagreement per scan a gyroscope is never given up."""


class ImuTrack:
    """The last samples of one IMU, in the base frame, and what was learnt about its errors."""

    def __init__(self, gravity_time_constant_s: float, log: RunLog) -> None:
        self._constant_s, self.log = gravity_time_constant_s, log
        self._stamps: deque[int] = deque()
        self._rates: deque[NDArray[np.float64]] = deque()
        self._forces: deque[NDArray[np.float64]] = deque()
        self._force_scale: float | None = None
        self.bias_rad_s = np.zeros(3)
        self.has_gravity = False
        self.up_local = np.array([0.0, 0.0, 1.0])
        """float64 (3,), unit vector against gravity in the local frame."""
        self._disagreements = np.zeros(2)
        self._comparisons = 0
        self.trusted = True
        self.needed_since_ns = 0
        """Time of the last pose: rotations are asked for from there on."""

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, sample: ImuSample, T_base_imu: NDArray[np.float64]) -> None:
        """Take the next sample; one that is not finite, or not later than the one before, is left out and counted."""
        if not (np.isfinite(sample.angular_rad_s).all() and np.isfinite(sample.acceleration_m_s2).all()):
            self.log.counts["IMU samples that are not finite"] += 1
            return
        if self._stamps and sample.stamp_ns <= self._stamps[-1]:
            self.log.counts["IMU samples that are not later than the one before"] += 1
            return
        if self._stamps and sample.stamp_ns - self._stamps[-1] > LONGEST_GAP_NS:
            self.log.counts["gaps in the IMU"] += 1
        self._stamps.append(sample.stamp_ns)
        self._rates.append(T_base_imu[:3, :3] @ sample.angular_rad_s)
        self._forces.append(T_base_imu[:3, :3] @ sample.acceleration_m_s2)
        since = max(self.needed_since_ns, sample.stamp_ns - LONGEST_KEPT_NS)
        while self._stamps[0] < min(since, sample.stamp_ns - KEPT_NS):
            for samples in (self._stamps, self._rates, self._forces):
                samples.popleft()

    @property
    def last_stamp_ns(self) -> int | None:
        """Stamp of the last sample that was taken; None before the first."""
        return self._stamps[-1] if self._stamps else None

    def latest(self) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]:
        """Return stamp, angular velocity without bias and specific force of the last sample, base frame."""
        scale = self._force_scale or 1.0
        return self._stamps[-1], self._rates[-1] - self.bias_rad_s, self._forces[-1] * scale

    def up_at_start(self, begin_ns: int, end_ns: int) -> NDArray[np.float64] | None:
        """Return the unit vector (3,) against gravity in the base frame while the robot is believed to stand or roll slowly.

        The mean over the samples between the times; None, with a warning, if they do not feel gravity.
        """
        chosen = [f for t, f in zip(self._stamps, self._forces, strict=True) if begin_ns <= t <= end_ns]
        chosen = chosen or list(self._forces)
        if not chosen:
            return None
        mean = np.mean(chosen, axis=0)
        size = float(np.linalg.norm(mean))
        if 0.85 < size < 1.15:
            self._force_scale = STANDARD_GRAVITY_M_S2
            self.log.warn(f"the IMU feels {size:.2f} at the start: its accelerations are taken as multiples of gravity")
        elif not 7.0 < size < 13.0:
            self.log.warn(
                f"the IMU feels {size:.2f} m/s² at the start, not gravity: its gyroscope is used, and the start is"
                " taken as level"
            )
            return None
        self.has_gravity = True
        return mean / size

    def rotations(self, start_ns: int, ends_ns: NDArray[np.int64]) -> NDArray[np.float64] | None:
        """Return the rotations float64 (K, 4) from `start_ns` to each of `ends_ns` (increasing); None if it does not know."""
        if not self.trusted or not self._stamps:
            return None
        if self._stamps[0] > start_ns + LONGEST_GAP_NS or self._stamps[-1] < int(ends_ns[-1]) - LONGEST_GAP_NS:
            return None
        stamps = np.array(self._stamps, dtype=np.int64)
        seconds = (stamps - start_ns) * 1e-9
        out = np.empty((len(ends_ns), 4))
        kernels.integrate_rates(
            seconds, np.array(self._rates) - self.bias_rad_s, 0.0, np.maximum(ends_ns - start_ns, 0) * 1e-9, out
        )
        return out

    def learn(
        self,
        before_ns: int,
        now_ns: int,
        turn_error: NDArray[np.float64],
        turn_error_without: float,
        local_from_base: NDArray[np.float64],
    ) -> None:
        """Learn from a match: bias, direction of gravity, and whether the gyroscope can be believed at all.

        Parameters
        ----------
        turn_error
            float64 (3,), rotation vector from the predicted to the matched orientation, base frame, radians.
        turn_error_without
            How far off the prediction by constant velocity would have been, radians.
        local_from_base
            float64 (3, 3), matched orientation.
        """
        dt = (now_ns - before_ns) * 1e-9
        if dt <= 0.0 or not self._stamps:
            return
        gain = 1.0 - np.exp(-dt / BIAS_TIME_CONSTANT_S)
        # A gyroscope that is off by more than this is wrong in another way than by a bias.
        self.bias_rad_s = np.clip(self.bias_rad_s - gain * turn_error / dt, -0.2, 0.2)
        self._compare(float(np.linalg.norm(turn_error)), turn_error_without)
        if self.has_gravity:
            forces = [f for t, f in zip(self._stamps, self._forces, strict=True) if before_ns < t <= now_ns]
            if forces:
                up = local_from_base @ np.mean(forces, axis=0)
                self.up_local = self.up_local + (1.0 - np.exp(-dt / self._constant_s)) * (
                    up / max(float(np.linalg.norm(up)), 1e-9) - self.up_local
                )
                self.up_local /= np.linalg.norm(self.up_local)

    def _compare(self, with_gyro: float, without: float) -> None:
        """Give the gyroscope up where predictions without it have been much better for long."""
        self._comparisons += 1
        self._disagreements += 0.05 * (np.array([with_gyro, without]) - self._disagreements)
        error, plain = self._disagreements
        if self._comparisons >= 40 and error > TRUSTED_TURN_RAD and error > 3.0 * plain:
            self.trusted = False
            self.log.warn(
                f"the gyroscope disagrees with the scans by {error:.3f} rad per scan, constant velocity by {plain:.3f}:"
                " it is not used from here on (wrong axes, unit or clock?)"
            )
