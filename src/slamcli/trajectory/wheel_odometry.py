# SPDX-License-Identifier: MIT
"""Odometry at the times of scans, from clocks that jitter, lead or lag."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2

_STEP_NS = 1000
"""Distance between messages whose order is known and whose times are not, when their stamps ran backwards."""


def smooth_stamps(stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the strictly increasing stamps (N,) nearest to recorded ones whose order is right and whose clock jitters.

    Isotonic regression (pool adjacent violators); stamps that increase already come back as they are. Members of a pool
    keep their order at steps of a microsecond.
    """
    stamps = np.asarray(stamps_ns, dtype=np.int64)
    if len(stamps) < 2 or bool((np.diff(stamps) > 0).all()):
        return stamps.copy()
    base = int(stamps[0])
    means: list[float] = []
    sizes: list[int] = []
    for value in (stamps - base).tolist():
        mean, size = float(value), 1
        while means and means[-1] >= mean:
            mean, size = (means[-1] * sizes[-1] + mean * size) / (sizes[-1] + size), sizes[-1] + size
            means.pop()
            sizes.pop()
        means.append(mean)
        sizes.append(size)
    pooled = np.repeat(np.array(means), sizes).astype(np.int64)
    place = np.concatenate([np.arange(size) for size in sizes])
    smooth = pooled + place * _STEP_NS
    rank = np.arange(len(smooth)) * _STEP_NS
    return base + np.maximum.accumulate(smooth - rank) + rank  # pools may not run into each other


@dataclass(frozen=True, slots=True, eq=False)
class WheelOdometry:
    """What the wheels say: poses of the base in the odometry frame."""

    stamps_ns: NDArray[np.int64]
    """int64 (N,), strictly increasing, N >= 1."""
    poses: NDArray[np.float64]
    """float64 (N, 3), x, y in metres and yaw in radians."""

    def at(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return poses (M, 3) interpolated at stamps (M,); before the first and after the last the pose stands still."""
        base = self.stamps_ns[0]
        times, query = (self.stamps_ns - base).astype(np.float64), (stamps_ns - base).astype(np.float64)
        yaw = np.unwrap(self.poses[:, 2])
        columns = [np.interp(query, times, values) for values in (self.poses[:, 0], self.poses[:, 1], yaw)]
        return np.column_stack([columns[0], columns[1], se2.wrap_angle(columns[2])])
