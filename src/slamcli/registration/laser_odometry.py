# SPDX-License-Identifier: MIT
"""The motion between scans of a whole recording, from wheels, gyroscope and the scans themselves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.registration.beams import Beams
from slamcli.registration.scan_odometry import Pose, ScanOdometry, ScanStep, between
from slamcli.runtime import RunLog
from slamcli.trajectory.bending import as_pose
from slamcli.trajectory.time_offset import TimeOffset, estimate
from slamcli.trajectory.wheel_calibration import WheelCalibration, calibrate
from slamcli.trajectory.wheel_odometry import WheelOdometry

_TURNING_SCANS = 400
"""Scans during which the robot turned that the estimate of the clock offset rests on, where there are that many."""
_TRUSTED_QUALITY = 0.5
_LONGEST_PERIOD_S = 1.0
"""Time between two scans over which the motion does not tell the velocity during a sweep."""
_SLIP_SIGMAS = 5.0
_CALIBRATIONS = 3

BeamsOf = Callable[[int, NDArray[np.float64] | None], Beams]
"""Gives the beams of a scan by its index, moved by the base's velocity (3,) during the sweep (None: as they are)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaserOdometry:
    """Scans of one recording with what is known of the motion between them."""

    stamps_ns: NDArray[np.int64]
    """int64 (N,), increasing."""
    beams: BeamsOf
    delta_m: float
    """Cell size of the local maps."""
    sweeps: bool
    """Whether beams are to be deskewed."""
    log: RunLog
    wheels: WheelOdometry | None = None
    yaws: NDArray[np.float64] | None = None
    """float64 (N,), heading by gyroscope, or None."""
    tangent: float = 1.0
    """See `ScanOdometry`."""

    def time_offset(self) -> TimeOffset:
        """Return the wheels' clock offset that the turns seen by the scans tell; hardly trusting the wheels while it is not known."""
        with self.log.stage("clock offset"):
            assert self.wheels is not None  # noqa: S101  (callers ask only where there are wheels)
            return self._offset_of(self.wheels, *self._align(0.0, enough_turns=_TURNING_SCANS))

    def calibrated(self, offset_s: float | None) -> tuple[LaserOdometry, TimeOffset, WheelCalibration]:
        """Return this with wheels freed of their systematic errors, the clock offset (estimated where None), and the errors."""
        assert self.wheels is not None  # noqa: S101  (callers ask only where there are wheels)
        with self.log.stage("clock offset"):
            motions, steps = self._align(offset_s or 0.0, enough_turns=_TURNING_SCANS)
            sigmas = np.array([_sigma_ahead(step) for step in steps])
            trusted = np.array([step.quality > _TRUSTED_QUALITY for step in steps])
            found, offset = WheelCalibration(), TimeOffset(offset_s or 0.0, 0.0, 0.0, 0)
            for _ in range(_CALIBRATIONS):  # wheels that turn too far seem to lead or lag
                if offset_s is None:
                    offset = self._offset_of(found.apply(self.wheels), motions, steps)
                poses = self.wheels.at(self.stamps_ns[: len(steps)] + round(offset.seconds * 1e9))
                told = np.vstack([np.zeros((1, 3)), se2.between(poses[:-1], poses[1:])])
                found = calibrate(told, motions[: len(steps)], sigmas, trusted)
        return replace(self, wheels=found.apply(self.wheels)), offset, found

    def _offset_of(self, wheels: WheelOdometry, motions: NDArray[np.float64], steps: list[ScanStep]) -> TimeOffset:
        count = len(steps)
        trusted = np.array([step.quality > _TRUSTED_QUALITY for step in steps])[1:]
        return estimate(self.stamps_ns[:count], motions[1:count, 2], trusted, wheels)

    def motions(self, offset_s: float) -> tuple[NDArray[np.float64], list[ScanStep]]:
        """Return the motion (N, 3) that leads to each scan from the one before, and how the scans were aligned."""
        with self.log.stage("scan odometry", (self.stamps_ns[-1] - self.stamps_ns[0]) / 1e9):
            motions, steps = self._align(offset_s)
        if self.wheels is not None:
            self._report_slip(steps)
        return motions, steps

    def twist(self, k: int, ahead: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the velocity (3,) during the sweep of scan k from the motion to the next one, `ahead` (1, 3) or (0, 3).

        None leaves the scan as it is.
        """
        if not self.sweeps or k + 1 >= len(self.stamps_ns):
            return None
        seconds = (self.stamps_ns[k + 1] - self.stamps_ns[k]) / 1e9
        return ahead[0] / seconds if 1e-3 < seconds < _LONGEST_PERIOD_S else None

    def _align(self, offset_s: float, enough_turns: int | None = None) -> tuple[NDArray[np.float64], list[ScanStep]]:
        """Align scans one after the other, all of them or until the robot has turned during `enough_turns` of them."""
        stamps = self.stamps_ns
        poses = None if self.wheels is None else self.wheels.at(stamps + round(offset_s * 1e9))
        odometry = ScanOdometry(self.delta_m, tangent=self.tangent)
        motions, steps = np.zeros((len(stamps), 3)), []
        turns, guess, last = 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for k in range(len(stamps)):
            before = odometry.pose
            guess = self._predict(k, poses, guess)
            ahead = guess if k + 1 == len(stamps) else self._predict(k + 1, poses, guess)
            if poses is None:
                ahead = self._mean(ahead, last)
            twist = self.twist(k, np.array([ahead]))
            known = poses is not None and enough_turns is None
            steps.append(odometry.step(self.beams(k, twist), guess, known=known))
            last, guess = guess, between(before, odometry.pose)
            motions[k] = guess
            turns += abs(guess[2]) > math.radians(1.5) and steps[-1].quality > _TRUSTED_QUALITY
            if enough_turns is not None and turns >= enough_turns:
                break
            if k % 64 == 0:
                self.log.progress.update((stamps[k] - stamps[0]) / 1e9)
        return motions, steps

    def _predict(self, k: int, poses: NDArray[np.float64] | None, last: Pose) -> Pose:
        """Return the motion to scan k: by wheels, else as the last one; the turn by gyroscope where there is one."""
        if k == 0:
            return 0.0, 0.0, 0.0
        motion = last if poses is None else between(as_pose(poses[k - 1]), as_pose(poses[k]))
        if self.yaws is None:
            return motion
        return motion[0], motion[1], math.remainder(float(self.yaws[k] - self.yaws[k - 1]), math.tau)

    def _mean(self, ahead: Pose, before: Pose) -> Pose:
        """Return the mean of two motions; a turn by gyroscope is left as it is.

        By what a motion is wrong the next sweep would be straightened wrongly: the motion to it is wrong to the other side then, and so on without
        end where sweeps take the whole period. With the mean it dies out.
        """
        turn = ahead[2] if self.yaws is not None else 0.5 * (ahead[2] + before[2])
        return 0.5 * (ahead[0] + before[0]), 0.5 * (ahead[1] + before[1]), turn

    def _report_slip(self, steps: list[ScanStep]) -> None:
        bad = [
            k for k, step in enumerate(steps) if step.disagreement > _SLIP_SIGMAS and step.quality > _TRUSTED_QUALITY
        ]
        self.log.counts["scans that disagree with the odometry"] += len(bad)
        if bad:
            stamp = self.stamps_ns[bad[0]]
            self.log.warn(
                f"scans and odometry disagree beyond the motion model at {len(bad)} of {len(steps)} scans, first at {stamp / 1e9:.3f} s "
                f"(slipping wheels, or clocks that differ); the scans were believed"
            )


def _sigma_ahead(step: ScanStep) -> float:
    """Return how well the points tell the distance ahead, metres; infinite where they were not matched."""
    if step.information is None:
        return math.inf
    return math.sqrt(float(np.linalg.inv(step.information + 1e-6 * np.eye(3))[0, 0]))


def tells_sweep(stamps_ns: NDArray[np.int64], sweep_s: float, log: RunLog) -> bool:
    """Return whether beams can be deskewed: their times are there (`sweep_s` from first to last) and fit between two scans."""
    if sweep_s == 0.0 or len(stamps_ns) < 2:
        return False
    period_s = float(np.median(np.diff(stamps_ns))) / 1e9
    if sweep_s > 1.1 * period_s:
        log.warn(
            f"scans are {period_s:.3f} s apart, but by their time_increment a sweep takes {sweep_s:.3f} s: the robot's motion "
            "during a sweep is not corrected"
        )
        return False
    return True
