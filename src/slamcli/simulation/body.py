# SPDX-License-Identifier: MIT
"""The body of a simulated robot, and how far it is from things."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.footprint import parse_footprint
from slamcli.simulation import _plant_kernels
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.walls import Walls

Array = NDArray[np.float64]


class Body:
    """The polygon of `robot.footprint`, or the disc of `robot.radius`."""

    def __init__(self, parameters: SimulationParameters) -> None:
        """Raise ConfigError if `robot.footprint` is no outline."""
        corners = parse_footprint(parameters.robot_footprint)
        self.outline: Array = np.array(corners) if corners else np.zeros((1, 2))
        """float64 (N, 2), metres, base_link; one point for a disc."""
        self.radius_m = 0.0 if corners else parameters.robot_radius
        """Of what is around the outline."""
        self.around_m = float(np.hypot(self.outline[:, 0], self.outline[:, 1]).max()) + self.radius_m
        """From base_link to the farthest point."""
        self._placed = np.empty_like(self.outline)

    def wall_gap(self, pose: Array, walls: Walls, reach_m: float) -> float:
        """Return the distance to the nearest wall at `pose` (3,), at most `reach_m`; 0 or less where they overlap."""
        x, y, yaw = pose.tolist()
        return float(
            _plant_kernels.wall_gap(
                self.outline, self.radius_m, x, y, yaw, walls.field, walls.frame, walls.shapes, reach_m, self._placed
            )
        )

    def mover_gap(self, pose: Array, movers: Array) -> float:
        """Return the same to the nearest rounded box of `movers` (M, 9); inf without any."""
        x, y, yaw = pose.tolist()
        return float(_plant_kernels.mover_gap(self.outline, self.radius_m, x, y, yaw, movers, self._placed))
