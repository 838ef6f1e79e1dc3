# SPDX-License-Identifier: MIT
"""What wheels measure wrongly all the time, from how scans saw the robot move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.trajectory.wheel_odometry import WheelOdometry

_MIN_STEPS = 100
_MIN_MOTION_M = 0.02
_MIN_DISTANCE_M = 5.0
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
    num_steps: int = 0

    def apply(self, odometry: WheelOdometry) -> WheelOdometry:
        """Return the odometry without these errors, from the same first pose."""
        steps = se2.between(odometry.poses[:-1], odometry.poses[1:])
        yaw = np.cumsum(np.concatenate([odometry.poses[:1, 2], self.turn_scale * steps[:, 2] + self.turn_rad_m * steps[:, 0]]))
        c, s = np.cos(yaw[:-1]), np.sin(yaw[:-1])
        x = odometry.poses[0, 0] + np.concatenate([[0.0], np.cumsum(self.scale * (c * steps[:, 0] - s * steps[:, 1]))])
        y = odometry.poses[0, 1] + np.concatenate([[0.0], np.cumsum(self.scale * (s * steps[:, 0] + c * steps[:, 1]))])
        return WheelOdometry(odometry.stamps_ns, np.column_stack([x, y, se2.wrap_angle(yaw)]))


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
    The identity where fewer than 100 steps or 5 metres tell.
    """
    moving = trusted & (np.abs(wheels[:, 0]) > _MIN_MOTION_M)
    if moving.sum() < _MIN_STEPS or np.abs(wheels[moving, 0]).sum() < _MIN_DISTANCE_M:
        return WheelCalibration()
    sharp = moving & (sigmas_m <= np.median(sigmas_m[moving]))
    scale = _fit(wheels[sharp, :1], scans[sharp, 0])
    turning = trusted & ((np.abs(wheels[:, 0]) > _MIN_MOTION_M) | (np.abs(wheels[:, 2]) > _MIN_MOTION_M))
    turns = _fit(wheels[turning][:, [2, 0]], se2.wrap_angle(scans[turning, 2]))
    values = [float(np.clip(value, *limits)) for value, limits in zip((*scale, *turns), _LIMITS, strict=True)]
    return WheelCalibration(*values, num_steps=int(moving.sum()))


def _fit(design: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least trimmed squares solution of ``design @ solution = seen``, by concentration steps."""
    kept = np.arange(len(seen))
    solution = np.zeros(design.shape[1])
    for _ in range(_ROUNDS):
        normal = design[kept].T @ design[kept] + 1e-9 * np.eye(design.shape[1])
        solution = np.linalg.solve(normal, design[kept].T @ seen[kept])
        error = np.abs(design @ solution - seen)
        kept = np.sort(np.argsort(error, kind="stable")[: max(1, round(_KEPT * len(seen)))])
    return solution
