# SPDX-License-Identifier: MIT
"""The motion model of gmapping: Gaussian noise that grows with the motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.gmapping.parameters import GmappingParameters


@dataclass(frozen=True, slots=True)
class MotionModel:
    """Noise ratios of ROS gmapping; see the parameters srr, srt, str and stt."""

    srr: float
    srt: float
    str_: float
    stt: float

    @classmethod
    def of(cls, parameters: GmappingParameters, factor: float = 1.0) -> MotionModel:
        """Return the model that the parameters ask for, with all ratios times `factor`."""
        p = parameters
        return cls(p.srr * factor, p.srt * factor, p.str_ * factor, p.stt * factor)

    def sigmas(self, motion: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return standard deviations (3,) of x, y in metres and yaw in radians for one motion (3,)."""
        dx, dy, turn = abs(motion[0]), abs(motion[1]), abs(motion[2])
        return np.array(
            [
                self.srr * dx + self.str_ * turn + 0.3 * self.srr * dy,
                self.srr * dy + self.str_ * turn + 0.3 * self.srr * dx,
                self.stt * turn + self.srt * math.hypot(dx, dy),
            ]
        )

    def sample(
        self, poses: NDArray[np.float64], motion: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return poses (N, 3) moved by the motion (3,) with noise drawn for each of them."""
        return se2.compose(poses, motion + rng.standard_normal(poses.shape) * self.sigmas(motion))
