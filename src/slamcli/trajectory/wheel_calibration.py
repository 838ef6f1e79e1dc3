# SPDX-License-Identifier: MIT
"""What wheels measure wrongly all the time, from how scans saw the robot move."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.trajectory.wheel_odometry import WheelOdometry

_MIN_STRETCHES, _MIN_TURNS = 40, 10
_STRETCH_M, _STRETCH_RAD = 0.5, 0.3
"""Steps are added up until the robot went or turned so far: over a single one the noise of the wheels hides their errors."""
_KEPT = 0.8
"""Share of the steps, those that agree best, on which each round of the fit rests: slipping wheels do not count."""
_ROUNDS = 5
_LIMITS = ((0.7, 1.4), (0.6, 1.6), (-0.2, 0.2))


@dataclass(frozen=True, slots=True)
class WheelCalibration:
    """Systematic errors of a differential drive: unequal and wrong wheel diameters, and a wrong wheel base [1]_.

    References
    ----------
    .. [1] J. Borenstein and L. Feng: Measurement and Correction of Systematic Odometry Errors in Mobile Robots, IEEE
       Transactions on Robotics and Automation 12(6), 1996, doi:10.1109/70.544770.
    """

    scale: float = 1.0
    """True distance over what the wheels say."""
    turn_scale: float = 1.0
    """True turn over what the wheels say."""
    turn_rad_m: float = 0.0
    """Turn that the wheels do not see, per metre that they say."""
    num_stretches: int = 0

    def apply(self, odometry: WheelOdometry) -> WheelOdometry:
        """Return the odometry without these errors, from the same first pose."""
        steps = se2.between(odometry.poses[:-1], odometry.poses[1:])
        mended = steps * self.scale
        mended[:, 2] = self.turn_scale * steps[:, 2] + self.turn_rad_m * steps[:, 0]
        return WheelOdometry(odometry.stamps_ns, se2.integrate(odometry.poses[0], mended))


def calibrate(
    wheels: NDArray[np.float64], scans: NDArray[np.float64], sigmas_m: NDArray[np.float64], trusted: NDArray[np.bool_]
) -> WheelCalibration:
    """Return the systematic errors that best explain the motions that scans saw.

    Parameters
    ----------
    wheels, scans : float64 (N, 3), motion between scans by either.
    sigmas_m : float64 (N,), how well the scans tell the distance ahead; the better half of the steps decides its scale.
    trusted : bool (N,), whether the scans matched.

    Returns
    -------
    The identity where fewer than 40 stretches of half a metre or 0.3 radians tell.
    """
    ends = _stretches(wheels, trusted)
    told, seen = (np.add.reduceat(motions, ends[:-1], axis=0) for motions in (wheels[: ends[-1]], scans[: ends[-1]]))
    whole = np.logical_and.reduceat(trusted[: ends[-1]], ends[:-1])
    worst = np.maximum.reduceat(sigmas_m[: ends[-1]], ends[:-1])
    ahead = whole & (np.abs(told[:, 0]) > 0.5 * _STRETCH_M)
    scale = np.ones(1)
    if ahead.sum() >= _MIN_STRETCHES:
        sharp = ahead & (worst <= np.median(worst[ahead]))
        scale = _fit(told[sharp, :1], seen[sharp, 0])
    turns = _turns(told[whole], seen[whole, 2])
    values = [float(np.clip(value, *limits)) for value, limits in zip((*scale, *turns), _LIMITS, strict=True)]
    return WheelCalibration(values[0], values[1], values[2], int(whole.sum()))


def _turns(told: NDArray[np.float64], seen: NDArray[np.float64]) -> tuple[float, float]:
    """Return the scale of turns and the turn per metre, each from the stretches that tell it: those with turns, and the others."""
    turning = np.abs(told[:, 2]) > 0.5 * _STRETCH_RAD
    scale, bend = 1.0, 0.0
    for _ in range(_ROUNDS):
        if turning.sum() >= _MIN_TURNS:
            scale = float(_fit(told[turning, 2:], seen[turning] - bend * told[turning, 0])[0])
        if (~turning).sum() >= _MIN_STRETCHES:
            bend = float(_fit(told[~turning, :1], seen[~turning] - scale * told[~turning, 2])[0])
    return scale, bend


def _stretches(wheels: NDArray[np.float64], trusted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return where stretches begin, int64 (K + 1,), the last one's end included; an untrusted step is a stretch of its own."""
    begins, distance, turn = [0], 0.0, 0.0
    for k, ((dx, dy, dyaw), good) in enumerate(zip(wheels.tolist(), trusted.tolist(), strict=True)):
        if not good and begins[-1] != k:
            begins.append(k)
        distance, turn = distance + math.hypot(dx, dy), turn + abs(dyaw)
        if not good or distance > _STRETCH_M or turn > _STRETCH_RAD:
            begins.append(k + 1)
            distance, turn = 0.0, 0.0
    return np.array(begins if len(begins) > 1 else [0, len(wheels)], dtype=np.int64)


def _fit(design: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least trimmed squares solution of ``design @ solution = seen``, by concentration steps."""
    kept = np.arange(len(seen))
    solution: NDArray[np.float64] = np.zeros(design.shape[1])
    for _ in range(_ROUNDS):
        normal = design[kept].T @ design[kept] + 1e-9 * np.eye(design.shape[1])
        solution = np.asarray(np.linalg.solve(normal, design[kept].T @ seen[kept]), dtype=np.float64)
        error = np.abs(design @ solution - seen)
        kept = np.sort(np.argsort(error, kind="stable")[: max(1, round(_KEPT * len(seen)))])
    return solution
