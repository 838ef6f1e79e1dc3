# SPDX-License-Identifier: MIT
"""How particles move when odometry tells that the robot did: amcl's four models."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.localization import _motion_kernels as kernels
from slamcli.localization.amcl_parameters import AmclParameters

_SHORTEST_WAY_M = 0.01
"""Below it the direction of a motion says nothing, as in amcl."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MotionModel:
    """Noise of odometry that grows with the motion.

    References
    ----------
    Thrun, Burgard, Fox: Probabilistic Robotics, 2005, table 5.6 (sample_motion_model_odometry); `omni` is amcl's own.
    """

    kind: str
    """diff, omni, diff-corrected or omni-corrected."""
    alphas: tuple[float, float, float, float, float]

    @classmethod
    def of(cls, parameters: AmclParameters) -> MotionModel:
        """Return the model that the parameters ask for."""
        p = parameters
        return cls(p.odom_model_type, (p.odom_alpha1, p.odom_alpha2, p.odom_alpha3, p.odom_alpha4, p.odom_alpha5))

    def move(self, poses: Array, motion: Array, rng: np.random.Generator) -> None:
        """Move `poses` (N, 3) in place by a motion (3,), seen from the pose before it, with noise drawn for each."""
        noise = rng.standard_normal(poses.shape)
        if self.kind.startswith("omni"):
            kernels.move_sideways(poses, _bearing_way_turn(motion), self.sideways_sigmas(motion), noise)
        else:
            kernels.move_turning(poses, turn_way_turn(motion), self.turning_sigmas(motion), noise)

    def turning_sigmas(self, motion: Array) -> Array:
        """Return standard deviations (3,) of first turn, way and second turn of a motion (3,); diff models.

        Turns count from the nearer of ahead and behind, so that a robot that drives backwards has not turned by half a turn.
        """
        first, way, second = turn_way_turn(motion)
        a1, a2, a3, a4, _ = self.alphas
        first, second = _folded(first), _folded(second)
        return self._deviations(
            a1 * first**2 + a2 * way**2, a3 * way**2 + a4 * (first**2 + second**2), a1 * second**2 + a2 * way**2
        )

    def sideways_sigmas(self, motion: Array) -> Array:
        """Return standard deviations (3,) along, across and about of a motion (3,); omni models."""
        _, way, turn = _bearing_way_turn(motion)
        a1, a2, a3, a4, a5 = self.alphas
        return self._deviations(a3 * way**2 + a1 * turn**2, a1 * turn**2 + a5 * way**2, a4 * turn**2 + a2 * way**2)

    def _deviations(self, *variances: float) -> Array:
        # amcl's first models pass what is meant as variance where a standard deviation belongs; kept, its users tuned to that.
        return np.sqrt(variances) if self.kind.endswith("-corrected") else np.array(variances)


def turn_way_turn(motion: Array) -> Array:
    """Return (3,) first turn, way and second turn that make up a motion (3,)."""
    way = math.hypot(motion[0], motion[1])
    first = math.atan2(motion[1], motion[0]) if way >= _SHORTEST_WAY_M else 0.0
    return np.array([first, way, float(se2.wrap_angle(motion[2] - first))])


def _bearing_way_turn(motion: Array) -> Array:
    return np.array([math.atan2(motion[1], motion[0]), math.hypot(motion[0], motion[1]), motion[2]])


def _folded(turn: float) -> float:
    turn = abs(turn)
    return min(turn, math.pi - turn)


def warm() -> None:
    """Compile the kernels of this module."""
    rng = np.random.default_rng(0)
    for kind in ("diff", "omni"):
        MotionModel(kind, (0.2, 0.2, 0.2, 0.2, 0.2)).move(np.zeros((1, 3)), np.ones(3), rng)
