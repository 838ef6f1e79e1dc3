# SPDX-License-Identifier: MIT
"""What comes of registering one place with another, by features or by scans."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3

Floats = NDArray[np.float64]
UNKNOWN_VARIANCE = 9999.0
"""m^2 and rad^2 of what was not found."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Registration:
    """How place b lies in place a, or why that is not known."""

    T_a_b: Floats | None
    """float64 (4, 4), pose of the base at b in the base at a; None: not found."""
    covariance: Floats
    """float64 (6, 6), translation (m) before rotation vector (rad), both along the axes of the base at a: the true motion has
    rotation Exp(phi) R and translation t + rho."""
    num_matches: int = 0
    """Features that look alike, or points that lie near each other, before the motion was known."""
    num_inliers: int = 0
    """Matches that the motion explains; where none was found the most that any had."""
    matches: NDArray[np.int64]
    """int64 (M, 2), rows of a's and of b's features, of the inliers; none for scans."""
    reason: str = ""
    """Why there is no motion, a sentence; empty where there is one."""


def refused(reason: str, *, num_matches: int = 0, num_inliers: int = 0) -> Registration:
    """Return what stands for a motion that was not found."""
    return Registration(
        T_a_b=None, covariance=UNKNOWN_VARIANCE * np.eye(6), num_matches=num_matches, num_inliers=num_inliers,
        matches=np.zeros((0, 2), np.int64), reason=reason,
    )  # fmt: skip


def inverted(found: Registration) -> Registration:
    """Return how a lies in b, from how b lies in a."""
    if found.T_a_b is None:
        return replace(found, matches=found.matches[:, ::-1])
    R, t = found.T_a_b[:3, :3], found.T_a_b[:3, 3]
    carry = np.zeros((6, 6))
    carry[:3, :3] = carry[3:, 3:] = -R.T
    carry[:3, 3:] = -R.T @ np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])
    return replace(
        found, T_a_b=se3.inverse(found.T_a_b), covariance=carry @ found.covariance @ carry.T,
        matches=np.ascontiguousarray(found.matches[:, ::-1]),
    )  # fmt: skip


def flat_motion(T_a_b: Floats) -> Floats:
    """Return the motion's x, y and yaw alone (Reg/Force3DoF), float64 (4, 4)."""
    c, s = T_a_b[0, 0], T_a_b[1, 0]
    norm = float(np.hypot(c, s))
    if norm == 0.0:  # turned over by a right angle: there is no yaw
        c, s, norm = 1.0, 0.0, 1.0
    out = np.eye(4)
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = c / norm, -s / norm, s / norm, c / norm
    out[:2, 3] = T_a_b[:2, 3]
    return out
