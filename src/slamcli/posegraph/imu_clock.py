# SPDX-License-Identifier: MIT
"""By how much an IMU's clock is off the camera's: rotations of both are laid on one another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import ImuNoise
from slamcli.posegraph.alignment_records import VisualPoses
from slamcli.posegraph.imu_preintegration import preintegrate
from slamcli.posegraph.imu_samples import ImuSamples

Floats = NDArray[np.float64]
_FARTHEST_S, _STEP_S = 0.06, 0.005


class ClockOffset(NamedTuple):
    """What rotations say about the clocks."""

    seconds: float
    """Added to the camera's stamps, this gives the IMU's."""
    sigma_s: float
    """Standard deviation; infinite where the turning is too steady to tell, or the best offset is beyond 60 ms."""
    gain: float
    """Share of the squared rotation errors that the offset takes away."""


def clock_offset(poses: VisualPoses, samples: ImuSamples, noise: ImuNoise) -> ClockOffset:
    """Return the offset at which the gyroscope's rotations between poses are nearest to the camera's.

    Notes
    -----
    The gyroscope's bias is taken out at every offset. Offsets are tried 5 ms apart, and a parabola is laid through the best.
    """
    offsets = np.arange(-_FARTHEST_S, _FARTHEST_S + 1e-9, _STEP_S)
    squares = np.array([_misfit(poses, samples, noise, float(offset)) for offset in offsets])
    best = int(squares.argmin())
    if best in {0, len(offsets) - 1}:
        return ClockOffset(float(offsets[best]), np.inf, 0.0)
    low, middle, high = squares[best - 1 : best + 2]
    curvature = (low - 2 * middle + high) / _STEP_S**2
    seconds = float(offsets[best] + 0.5 * _STEP_S * (low - high) / (low - 2 * middle + high))
    least = float(middle - 0.125 * (low - high) ** 2 / (low - 2 * middle + high))
    freedoms = max(3 * (len(poses.stamps_ns) - 1) - 4, 1)
    zero = float(squares[len(offsets) // 2])
    sigma = float(np.sqrt(2 * max(least, 0.0) / freedoms / curvature)) if curvature > 0 else np.inf
    return ClockOffset(seconds, sigma, 1 - least / zero if zero > 0 else 0.0)


def _misfit(poses: VisualPoses, samples: ImuSamples, noise: ImuNoise, offset_s: float) -> float:
    """Return the sum of squared rotation errors, with the bias that makes it least."""
    stamps = poses.stamps_ns + round(offset_s * 1e9)
    motions = preintegrate(samples, stamps[:-1], stamps[1:], np.zeros(6), noise)
    turns, _ = poses.lever()
    error = motions.rotations.transpose(0, 2, 1) @ turns[:-1].transpose(0, 2, 1) @ turns[1:]
    angles = 0.5 * np.stack(
        [error[:, 2, 1] - error[:, 1, 2], error[:, 0, 2] - error[:, 2, 0], error[:, 1, 0] - error[:, 0, 1]], axis=1
    )
    usable = motions.gaps_s <= 0.1
    rows, values = motions.jacobians[usable, :3, :3].reshape(-1, 3), angles[usable].ravel()
    if len(values) < 6:
        return np.inf
    bias = np.linalg.solve(rows.T @ rows + 1e-12 * np.eye(3), rows.T @ values)
    return float(((values - rows @ bias) ** 2).sum())
