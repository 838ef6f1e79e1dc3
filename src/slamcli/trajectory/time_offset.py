# SPDX-License-Identifier: MIT
"""The constant offset between the clocks of laser and odometry, from how both saw the robot turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.trajectory.wheel_odometry import WheelOdometry

_RANGE_S, _COARSE_S, _FINE_S = 0.6, 0.02, 0.0025
_MIN_TURN_RAD = 0.02
_MIN_SCANS = 40
_MIN_GAIN = 0.15
_SCALES = (0.7, 1.4)
"""Bounds of how much more or less than the wheels say a robot may turn."""


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """What was found; `seconds` is added to a scan's stamp before the odometry is looked up."""

    seconds: float
    error_before_rad: float
    """Typical difference between turns seen by laser and odometry without the offset."""
    error_after_rad: float
    num_scans: int
    """Number of scans during which the robot turned."""


def estimate(
    stamps_ns: NDArray[np.int64], turns_rad: NDArray[np.float64], trusted: NDArray[np.bool_], odometry: WheelOdometry
) -> TimeOffset:
    """Return the offset at which the odometry's turns agree best with those that scan matching saw.

    The error of an offset is the mean of the smaller three quarters of the absolute differences over all scans during
    which the robot turned: slipping wheels and failed matches do not count. An offset that gains less than 15 %, or one
    that rests on fewer than 40 turning scans, is none; so is one that gains nothing any more once the odometry's turns
    are scaled by their median ratio: wheels that turn a few percent too far seem to lead or lag where the rate of
    turning changes slowly.

    Parameters
    ----------
    stamps_ns : int64 (N,), increasing stamps of scans.
    turns_rad : float64 (N - 1,), rotation from each scan to the next as the laser saw it.
    trusted : bool (N - 1,), whether that match was good.
    """
    usable = trusted & (np.diff(stamps_ns) < 2_000_000_000)
    moving = usable & (np.abs(turns_rad) > _MIN_TURN_RAD)
    count, seen = int(moving.sum()), turns_rad[moving]
    if count < _MIN_SCANS:
        return TimeOffset(0.0, 0.0, 0.0, count)

    def error(seconds: float, *, scaled: bool = False) -> float:
        told = se2.wrap_angle(np.diff(odometry.at(stamps_ns + round(seconds * 1e9))[:, 2]))[moving]
        turned = np.abs(told) > 0.5 * _MIN_TURN_RAD
        if scaled and turned.any():
            told = told * np.clip(np.median(seen[turned] / told[turned]), *_SCALES)
        size = np.sort(np.abs(se2.wrap_angle(told - seen)))
        return float(size[: max(1, (3 * count) // 4)].mean())

    before = error(0.0)
    coarse = np.arange(-_RANGE_S, _RANGE_S + _COARSE_S / 2, _COARSE_S)
    best = float(coarse[int(np.argmin([error(s) for s in coarse]))])
    fine = best + np.arange(-_COARSE_S, _COARSE_S + _FINE_S / 2, _FINE_S)
    errors = [error(s) for s in fine]
    after, best = min(errors), float(fine[int(np.argmin(errors))])
    gains = after <= (1 - _MIN_GAIN) * before
    if not gains or error(best, scaled=True) > (1 - _MIN_GAIN) * error(0.0, scaled=True):
        return TimeOffset(0.0, before, before, count)
    return TimeOffset(round(best, 4), before, after, count)
