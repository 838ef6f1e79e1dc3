# SPDX-License-Identifier: MIT
"""Motion that goes on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3


def part_of(T: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Return a share (also more than one) of a small motion."""
    shift, quat_xyzw = se3.to_position_quaternion(T)
    angle = 2.0 * np.arctan2(np.linalg.norm(quat_xyzw[:3]), quat_xyzw[3])
    axis = quat_xyzw[:3] / max(float(np.linalg.norm(quat_xyzw[:3])), 1e-12)
    turned = np.concatenate([axis * np.sin(0.5 * share * angle), [np.cos(0.5 * share * angle)]])
    return se3.from_position_quaternion(share * shift, turned)
