# SPDX-License-Identifier: MIT
"""Optimisation of a timed elastic band as a sparse nonlinear least-squares problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.teb import _band_kernels as band_kernels
from slamcli.navigation.teb import _obstacle_kernels as obstacle_kernels
from slamcli.navigation.teb.band import Band, band_along, resized
from slamcli.navigation.teb.obstacle_field import ObstacleField, obstacle_field, sample_costmap
from slamcli.navigation.teb.parameters import TebParameters
from slamcli.navigation.teb.robot_outline import robot_outline
from slamcli.navigation.teb.settings import settings_vector

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Costs:
    """What an optimised band costs, by kind; obstacles with the weight of the last round."""

    time: float
    obstacles: float
    via_points: float
    other: float


class BandOptimiser:
    """Optimises bands among the same obstacles, from the same start velocity.

    Parameters
    ----------
    start_twist
        float64 (3,): the robot's velocity now.
    turning
        +1 or -1 to prefer turning left or right at the start, 0 for neither (oscillation recovery).
    via_points
        float64 (V, 2).
    room_m
        Half of what the narrowest passage on the way leaves beside the robot: with ``min_obstacle_dist`` auto no more is
        kept, because obstacles that push from both sides keep a band out of a door.

    Notes
    -----
    As in the original each round first resizes the band and attaches obstacles anew, then takes a few steps of
    Levenberg-Marquardt, and the weight of obstacles grows from round to round. Solved here with the band structure of the
    normal equations, O(poses), in place of g2o, and with the residuals' analytic derivatives.

    References
    ----------
    Roesmann et al.: Trajectory modification considering dynamic constraints of autonomous robots, ROBOTIK 2012; Efficient
    trajectory optimization using a sparse model, ECMR 2013.
    """

    def __init__(
        self,
        parameters: TebParameters,
        obstacles: ObstacleField,
        *,
        start_twist: Array,
        turning: int = 0,
        via_points: Array | None = None,
        room_m: float = float("inf"),
    ) -> None:
        self._parameters = parameters
        self._obstacles = obstacles
        self._via_points = np.zeros((0, 2)) if via_points is None else via_points
        self._outline = robot_outline(parameters.footprint_model, obstacles.costmap)
        self._settings = settings_vector(parameters, self._outline, start_twist, turning, room_m)

    def optimise(self, band: Band, *, with_via_points: bool = True) -> tuple[Band, Costs]:
        """Return the band optimised, and what it costs; the band itself where ``optimization_activate`` is off."""
        trajectory, rounds = self._parameters.trajectory, self._parameters.optimisation
        costs = np.zeros(4)
        settings = self._settings.copy()
        fast = not self._parameters.obstacles.include_dynamic_obstacles
        for _ in range(rounds.no_outer_iterations if rounds.optimization_activate else 0):
            if trajectory.teb_autosize:
                band = resized(band, trajectory, once=fast)
            poses, dts = band.poses.copy(), band.dts.copy()
            starts, near = self._associate(poses)
            band_kernels.optimise(
                poses,
                dts,
                settings,
                self._outline.segments,
                self._outline.closed,
                self._obstacles.points,
                starts,
                near,
                self._moving(band),
                self._via(poses) if with_via_points else np.zeros((0, 3)),
                rounds.no_inner_iterations,
                costs,
            )
            band = Band(poses=poses, dts=dts)
            settings[band_kernels.W_OBSTACLE] *= rounds.weight_adapt_factor
        return band, Costs(time=costs[0], obstacles=costs[1], via_points=costs[2], other=costs[3])

    def _associate(self, poses: Array) -> tuple[Ints, Ints]:
        """Return which obstacles are attached to which pose, as the kernels take them."""
        rules, points = self._parameters.obstacles, self._obstacles.points
        starts = np.zeros(len(poses) + 1, dtype=np.int64)
        near = np.empty(max(1, len(poses) * len(points)), dtype=np.int64)
        if rules.legacy_obstacle_association:
            total = obstacle_kernels.associate_legacy(poses, points, rules.obstacle_poses_affected, starts, near)
        else:
            least = self._settings[band_kernels.MIN_DIST]
            force = max(
                least * rules.obstacle_association_force_inclusion_factor, self._settings[band_kernels.INFLATION]
            )
            total = obstacle_kernels.associate(
                poses,
                self._outline.segments,
                self._outline.closed,
                self._outline.radius_m,
                points,
                force,
                max(force, least * rules.obstacle_association_cutoff_factor),
                starts,
                near,
            )
        return starts, near[:total]

    def _moving(self, band: Band) -> Array:
        """Return where moving obstacles are when the band is at each of its poses: float64 (D * (N - 2), 4)."""
        discs = self._obstacles.discs
        if not len(discs):
            return np.zeros((0, 4))
        times = (
            band.times[1:-1] if self._parameters.obstacles.include_dynamic_obstacles else np.zeros(len(band.dts) - 1)
        )
        rows = np.empty((len(discs), len(times), 4))
        rows[:, :, 0] = np.arange(1, len(times) + 1)
        rows[:, :, 1:3] = discs[:, None, 0:2] + times[None, :, None] * discs[:, None, 3:5]
        rows[:, :, 3] = discs[:, None, 2]
        return rows.reshape(-1, 4)

    def _via(self, poses: Array) -> Array:
        """Return via-points with the pose each is attached to, the nearest one: float64 (V, 3)."""
        rows = np.zeros((len(self._via_points), 3))
        first = 0
        for row, point in zip(rows, self._via_points, strict=True):
            begin = min(first, len(poses) - 1)
            nearest = begin + int(((poses[begin:, :2] - point) ** 2).sum(axis=1).argmin())
            if self._parameters.trajectory.via_points_ordered:
                first = nearest + 2
            row[:] = min(max(nearest, 1), len(poses) - 2), *point
        return rows


def warm(costmap: CostWindow | None = None) -> None:
    """Compile the kernels of this module."""
    parameters = TebParameters()
    field = obstacle_field(costmap or sample_costmap(), np.zeros(3), behind_m=1.0)
    path = np.array([[0.0, 0.0], [0.7, 0.7]])
    band = band_along(path, np.zeros(3), np.array([0.7, 0.7, 0.0]), parameters)
    BandOptimiser(parameters, field, start_twist=np.zeros(3)).optimise(band)
    obstacle_kernels.associate_legacy(
        band.poses, field.points, 3, np.zeros(len(band.poses) + 1, dtype=np.int64), np.empty(1000, dtype=np.int64)
    )
