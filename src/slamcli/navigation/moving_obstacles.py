# SPDX-License-Identifier: MIT
"""What moves around the robot: scan points that no wall of the map explains, gathered and followed from scan to scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_GAP_M = 0.35
"""Neighbouring points farther apart belong to two things: the legs of one person do not."""
_LARGEST_M = 1.0
"""What is larger is furniture, which the costmap keeps the robot away from."""
_REACH_M = 0.6
_FORGET_S = 0.6
_POSITION_SHARE, _VELOCITY_SHARE = 0.5, 0.15
_FASTEST_M_S = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class MovingObstacles:
    """Things that may move, as they are believed to be at `time_s`."""

    time_s: float
    centres: Array
    """float64 (M, 2), metres, odom."""
    velocities: Array
    """float64 (M, 2), m/s, odom."""
    radii: Array
    """float64 (M,), metres, of what was seen."""
    seen_s: Array
    """float64 (M,), when each was last seen."""

    @classmethod
    def none(cls) -> MovingObstacles:
        """Return an empty set."""
        return cls(0.0, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0))


def follow(before: MovingObstacles, points: Array, time_s: float) -> MovingObstacles:
    """Return the moving things after a scan.

    Each thing of the scan goes to the nearest one that was expected within 0.6 m, whose position and velocity an
    alpha-beta filter (Kalata 1984) corrects; what was not seen for 0.6 s is forgotten.

    Parameters
    ----------
    before
        What was known.
    points
        float64 (N, 2), metres, odom, in the order of beams: end points that no wall explains.
    time_s
        When the scan was taken.
    """
    seen, radii = gather(points)
    elapsed = max(time_s - before.time_s, 1e-3)
    expected = before.centres + before.velocities * elapsed
    centres, velocities, sizes, times = list(expected), list(before.velocities), list(before.radii), list(before.seen_s)
    free = np.ones(len(expected), dtype=np.bool_)
    for centre, radius in zip(seen, radii, strict=True):
        apart = np.where(free, np.hypot(*(expected - centre).T), np.inf) if len(expected) else np.zeros(0)
        nearest = int(np.argmin(apart)) if len(apart) else -1
        if nearest >= 0 and apart[nearest] < _REACH_M:
            free[nearest] = False
            off = centre - expected[nearest]
            velocity = before.velocities[nearest] + _VELOCITY_SHARE / elapsed * off
            speed = float(np.hypot(*velocity))
            centres[nearest] = expected[nearest] + _POSITION_SHARE * off
            velocities[nearest] = velocity * min(1.0, _FASTEST_M_S / max(speed, 1e-9))
            sizes[nearest], times[nearest] = radius, time_s
        else:
            centres.append(centre)
            velocities.append(np.zeros(2))
            sizes.append(radius)
            times.append(time_s)
    keep = np.array(times) > time_s - _FORGET_S
    return MovingObstacles(
        time_s,
        np.array(centres).reshape(-1, 2)[keep],
        np.array(velocities).reshape(-1, 2)[keep],
        np.array(sizes)[keep],
        np.array(times)[keep],
    )


def gather(points: Array) -> tuple[Array, Array]:
    """Return centres (M, 2) and radii (M,) of what points (N, 2) in the order of beams belong to; large things are left out."""
    if len(points) == 0:
        return np.zeros((0, 2)), np.zeros(0)
    breaks = np.flatnonzero(np.hypot(*np.diff(points, axis=0).T) > _GAP_M) + 1
    groups = np.split(points, breaks)
    if len(groups) > 1 and np.hypot(*(groups[0][0] - groups[-1][-1])) <= _GAP_M:  # the scan begins in the midst of it
        groups = [np.concatenate([groups[-1], groups[0]]), *groups[1:-1]]
    middles = [(group.min(axis=0) + group.max(axis=0)) / 2.0 for group in groups]
    radii = [float(np.hypot(*(group - middle).T).max()) for group, middle in zip(groups, middles, strict=True)]
    small = [i for i, radius in enumerate(radii) if 2.0 * radius <= _LARGEST_M]
    return np.array([middles[i] for i in small]).reshape(-1, 2), np.array([radii[i] for i in small])
