# SPDX-License-Identifier: MIT
"""Points of a sweep put to where they were when it began (Odom/Deskewing), for a robot that moves on as it did."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]


def deskewed(points: Floats, seconds: Floats, T_begin_end: Floats, duration_s: float) -> Floats:
    """Return points float64 (N, 3), each seen by the base at its own time, as seen by the base when the sweep began.

    Parameters
    ----------
    points : float64 (N, 3), base frame at the point's time, metres.
    seconds : float64 (N,), each point's time after the beginning.
    T_begin_end : float64 (4, 4), motion of the base during `duration_s` > 0, at constant velocity.
    """
    rate = Rotation.from_matrix(T_begin_end[:3, :3]).as_rotvec() / duration_s
    angle = float(np.linalg.norm(rate)) * seconds
    moved = points + seconds[:, None] * (T_begin_end[:3, 3] / duration_s)
    if not angle.any():
        return moved
    axis = rate / float(np.linalg.norm(rate))
    across = np.cross(axis, points)
    twice = np.cross(axis, across)
    return moved + np.sin(angle)[:, None] * across + (1.0 - np.cos(angle))[:, None] * twice  # Rodrigues
