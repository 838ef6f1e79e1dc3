# SPDX-License-Identifier: MIT
"""Motion to the next scan where nothing measures it: as fast as before (Hess et al., ICRA 2016, IV)."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2


class ConstantVelocity2d:
    """Velocities over the last poses that were found, kept over a gap.

    The position goes on in a straight line in the local frame while the heading turns, as in the original.
    """

    def __init__(self, queue_s: float) -> None:
        """Velocities are taken over `queue_s` seconds, and over two poses at least."""
        self._queue_s = queue_s
        self._poses: deque[tuple[int, NDArray[np.float64]]] = deque()
        self._velocity = np.zeros(3)

    def add(self, stamp_ns: int, pose: NDArray[np.float64]) -> None:
        """Take a pose (3,) that was found; the oldest that is not needed to span the queue's duration is dropped."""
        self._poses.append((stamp_ns, pose))
        while len(self._poses) > 2 and (stamp_ns - self._poses[1][0]) / 1e9 >= self._queue_s:
            self._poses.popleft()
        first_ns, first = self._poses[0]
        seconds = (stamp_ns - first_ns) / 1e9
        if seconds > 0.0 and seconds >= self._queue_s:
            moved = pose - first
            self._velocity = np.append(moved[:2], se2.wrap_angle(moved[2])) / seconds

    def motions(self, stamps_ns: NDArray[np.int64], turns: NDArray[np.float64] | None) -> NDArray[np.float64]:
        """Return the motions (K, 3) between the last pose and stamps (K,), each seen from where the one before led.

        `turns` (K,), radians, are those that a gyroscope measured; without, the heading turns as fast as before.
        """
        last_ns, pose = self._poses[-1] if self._poses else (stamps_ns[0], np.zeros(3))
        seconds = np.diff(stamps_ns, prepend=last_ns) / 1e9
        turns = self._velocity[2] * seconds if turns is None else turns
        yaws = pose[2] + np.concatenate([[0.0], np.cumsum(turns)[:-1]])
        c, s = np.cos(yaws), np.sin(yaws)
        x, y = self._velocity[:2, None] * seconds
        return np.column_stack([c * x + s * y, c * y - s * x, turns])
