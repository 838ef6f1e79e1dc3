# SPDX-License-Identifier: MIT
"""What sampled motions cost: DWAPlannerROS' critics on the local costmap."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation import _dwa_kernels as kernels
from slamcli.navigation import _map_grid_kernels as grid_kernels
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import INSCRIBED
from slamcli.navigation.dwa_parameters import DwaParameters
from slamcli.navigation.local_planner import NoCommandError

Scaling = Literal["noetic", "kinetic"]
CRITICS = ("oscillation", "obstacle", "goal_front", "alignment", "path", "goal", "twirling")
REASONS = {
    int(kernels.OSCILLATES): "would go back and forth",
    int(kernels.OBSTACLE): "hit an obstacle",
    int(kernels.BLOCKED): "lead into an obstacle",
    int(kernels.UNREACHABLE): "have no way to the goal",
    int(kernels.OFF_MAP): "leave the costmap",
    int(kernels.NOT_SAMPLED): "are too slow or too fast",
    int(kernels.PRUNED): "cost more than the best one",
}
"""Why a motion is out, by its total."""
_WITHIN = 0.97
_REACTION_S = 0.15
_LEAST_WAY_M = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScoredMotions:
    """Sampled motions and what each critic says."""

    samples: NDArray[np.float64]
    """float64 (S, 3): vx, vy m/s and turn rad/s that were sampled."""
    commands: NDArray[np.float64]
    """float64 (S, 3): what the robot would be sent; differs from the sample without use_dwa."""
    costs: NDArray[np.float64]
    """float64 (S, 7), in the order of CRITICS, weighted."""
    totals: NDArray[np.float64]
    """float64 (S,): the sum, or a negative number for a motion that is out (REASONS)."""
    chosen: int
    """Row of the cheapest motion; -1 if all are out."""

    def refusals(self) -> str:
        """Return how many motions are out, and why."""
        rows = self.totals[self.totals < 0].astype(np.int64)
        counts = sorted(((int((rows == code).sum()), text) for code, text in REASONS.items()), reverse=True)
        return ", ".join(f"{count} {text}" for count, text in counts if count)


class DwaScoring:
    """Scores motions on one costmap and plan at a time; keeps its work space.

    Parameters
    ----------
    parameters
        Weights and switches.
    scaling
        ``noetic`` weighs cells of distance by resolution * bias and costs by occdist_scale; ``kinetic`` (before release
        1.16) by half of that and by resolution * occdist_scale.
    """

    def __init__(self, parameters: DwaParameters, scaling: Scaling) -> None:
        self._parameters = parameters
        self._scaling = scaling
        self._acc = np.array([parameters.acc_lim_x, parameters.acc_lim_y, parameters.acc_lim_theta])
        self._rollout = np.array([parameters.sim_time, parameters.sim_granularity, parameters.angular_sim_granularity])
        self._limits = np.array([parameters.min_vel_trans, parameters.max_vel_trans, parameters.min_vel_theta])
        growth = parameters.max_scaling_factor if parameters.scale_footprint else 0.0
        self._growth = np.array([parameters.scaling_speed, growth, 1.0])
        speed = max(parameters.max_vel_trans, math.hypot(parameters.max_vel_x, parameters.max_vel_y)) + 1e-3
        steps = max(speed / parameters.sim_granularity, parameters.max_vel_theta / parameters.angular_sim_granularity)
        self._points = np.zeros((math.ceil(parameters.sim_time * steps) + 2, 5))
        self._shape = (0, 0)

    def prepare(
        self, pose: NDArray[np.float64], plan: NDArray[np.float64], costmap: CostWindow, *, ends: bool = False
    ) -> None:
        """Grow distances from the plan (N, 3) and its end over the costmap; poses in the costmap's frame.

        `ends` tells that the robot is to stop at the plan's end, and motions are not looked at beyond it.

        Raises
        ------
        NoCommandError
            If no pose of the plan is on a known cell of the costmap, or the plan is blocked close ahead.
        """
        self._fit(costmap)
        self._costmap = costmap
        radius = _WITHIN * self._parameters.xy_goal_tolerance if ends and self._parameters.stop_at_goal else -1.0
        self._goal = np.array([plan[-1, 0], plan[-1, 1], radius, _REACTION_S])
        parameters = self._parameters
        radius_m = costmap.circumscribed_radius_m
        self._growth[2] = 1.0 + parameters.footprint_margin / radius_m if radius_m > 0.0 else 1.0
        radius_m *= float(self._growth[2] * (1.0 + self._growth[1]))
        self._reach = math.ceil(radius_m / costmap.resolution_m) + 1
        grid_kernels.box_maximum(costmap.costs, self._reach, self._rows, self._around)
        self._find_open_cells(pose, costmap)
        offset = plan[-1, :2] - pose[:2]
        nose = plan.copy()
        angle = math.atan2(offset[1], offset[0])
        nose[-1, :2] += parameters.forward_point_distance * np.array([math.cos(angle), math.sin(angle)])
        targets = self._plan_cells(plan, costmap)
        if not len(targets):
            raise NoCommandError("no pose of the plan is on a known cell of the local costmap")
        self._spread(1, targets)
        self._spread(2, self._local_goal(targets))
        if parameters.free_local_goal and self._is_cut_off():
            ahead = self._way_to_block(targets)
            self._spread(2, ahead)
            self._spread(0, ahead)
        else:
            self._spread(0, self._local_goal(self._plan_cells(nose, costmap)))
        near = parameters.forward_point_distance**2 * parameters.cheat_factor
        self._scales = self._weights(costmap.resolution_m, aligned=float(offset @ offset) > near)

    def score(
        self,
        pose: NDArray[np.float64],
        twist: NDArray[np.float64],
        samples: NDArray[np.float64],
        forbidden: int = 0,
        *,
        every: bool = False,
    ) -> ScoredMotions:
        """Return what motions at `samples`, float64 (S, 3), cost from a pose (3,) at a measured twist (3,).

        Costs of motions that cannot be the cheapest are not finished unless `every` asks for it.
        """
        commands = np.zeros_like(samples)
        table = np.zeros((len(samples), len(CRITICS) + 1))
        chosen = self._run(pose, twist, samples, forbidden, commands, table, prune=not every)
        return ScoredMotions(
            samples=samples, commands=commands, costs=table[:, :-1], totals=table[:, -1], chosen=int(chosen)
        )

    def motion(
        self, pose: NDArray[np.float64], twist: NDArray[np.float64], sample: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the poses (N, 3) of a motion."""
        count = kernels.roll_out(
            pose, twist, sample, self._acc, self._rollout, self._goal, not self._parameters.use_dwa, self._points
        )
        return self._points[:count, :3].copy()

    def _run(
        self,
        pose: NDArray[np.float64],
        twist: NDArray[np.float64],
        samples: NDArray[np.float64],
        forbidden: int,
        commands: NDArray[np.float64],
        table: NDArray[np.float64],
        *,
        prune: bool,
    ) -> int:
        parameters, costmap = self._parameters, self._costmap
        is_round = costmap.circumscribed_radius_m - costmap.inscribed_radius_m <= costmap.resolution_m
        switches = np.array(
            [
                not parameters.use_dwa,
                parameters.sum_scores,
                parameters.escape,
                parameters.soft_nose,
                parameters.turn_in_place and is_round,
                prune,
            ]
        )
        return int(
            kernels.score(
                samples,
                pose,
                twist,
                self._acc,
                self._rollout,
                self._goal,
                self._limits,
                forbidden,
                costmap.costs,
                self._around,
                self._reach,
                costmap.footprint,
                self._grids,
                np.array(costmap.origin_m),
                costmap.resolution_m,
                self._scales,
                parameters.forward_point_distance,
                self._growth,
                switches,
                self._points,
                commands,
                table,
            )
        )

    def _fit(self, costmap: CostWindow) -> None:
        """Make room for a costmap of another size."""
        if self._shape != costmap.costs.shape:
            height, width = self._shape = costmap.costs.shape
            self._grids = np.zeros((3, height, width), dtype=np.int64)
            self._queue = np.zeros(height * width, dtype=np.int64)
            self._open, self._flat = (np.zeros((height + 2) * (width + 2), dtype=np.int64) for _ in range(2))
            self._rows = np.zeros((height, width), dtype=np.uint8)
            self._around = np.zeros((height, width), dtype=np.uint8)
            self._cells = np.zeros(4 * (height + width), dtype=np.int64)

    def _find_open_cells(self, pose: NDArray[np.float64], costmap: CostWindow) -> None:
        """Note what can be passed; with `escape` inflation around the robot does not block its way."""
        (x, y), resolution = costmap.origin_m, costmap.resolution_m
        row, column = math.floor((pose[1] - y) / resolution), math.floor((pose[0] - x) / resolution)
        self._robot = (row, column)
        radius = costmap.inscribed_radius_m / resolution + 1.0 if self._parameters.escape else -1.0
        grid_kernels.open_cells(costmap.costs, row, column, radius, self._open)

    def _plan_cells(self, plan: NDArray[np.float64], costmap: CostWindow) -> NDArray[np.int64]:
        x, y = costmap.origin_m
        while True:
            count = grid_kernels.plan_cells(costmap.costs, plan, x, y, costmap.resolution_m, self._cells)
            if count >= 0:
                return self._cells[:count].copy()
            self._cells = np.zeros(4 * len(self._cells), dtype=np.int64)

    def _local_goal(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the last cell, or with free_local_goal the last that is free if there is one."""
        if self._parameters.free_local_goal and len(cells):
            free = np.flatnonzero(self._costmap.costs.reshape(-1)[cells] < INSCRIBED)
            if len(free):
                return cells[free[-1] : free[-1] + 1]
        return cells[-1:]

    def _is_cut_off(self) -> bool:
        """Whether no way leads from the robot, on a cell that can be passed, to the local goal."""
        (row, column), (height, width) = self._robot, self._shape
        if not (0 <= row < height and 0 <= column < width):
            return False
        is_open = self._open[(row + 1) * (width + 2) + column + 1] > 0
        return bool(is_open and self._grids[2][row, column] >= height * width)

    def _way_to_block(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the last cell of the plan, (1,), that a way leads to.

        Raises
        ------
        NoCommandError
            If it is less than half a metre away: then it is time for another plan.
        """
        width = self._shape[1]
        self._spread(2, np.array([self._robot[0] * width + self._robot[1]]))
        steps = self._grids[2].reshape(-1)[cells]
        near = np.flatnonzero((steps < self._grids[2].size) & (self._costmap.costs.reshape(-1)[cells] < INSCRIBED))
        way_m = float(steps[near[-1]]) * self._costmap.resolution_m if len(near) else 0.0
        if way_m < _LEAST_WAY_M and not (len(near) and self._is_at_goal(int(cells[near[-1]]))):
            raise NoCommandError(f"the plan is blocked {way_m:.2f} m ahead")
        return cells[near[-1] : near[-1] + 1]

    def _is_at_goal(self, cell: int) -> bool:
        """Whether a cell is within the tolerance of a goal that the robot is to stop at."""
        (x, y), resolution = self._costmap.origin_m, self._costmap.resolution_m
        row, column = divmod(cell, self._shape[1])
        offset = math.hypot(
            x + (column + 0.5) * resolution - self._goal[0], y + (row + 0.5) * resolution - self._goal[1]
        )
        return bool(offset <= self._goal[2])

    def _spread(self, place: int, targets: NDArray[np.int64]) -> None:
        height, width = self._shape
        grid_kernels.spread(self._open, height, width, targets, self._queue, self._flat, self._grids[place])

    def _weights(self, resolution_m: float, *, aligned: bool) -> NDArray[np.float64]:
        """Return float64 (7,), what the critics' figures are multiplied by."""
        parameters = self._parameters
        half, obstacles = (0.5, resolution_m) if self._scaling == "kinetic" else (1.0, 1.0)
        path = half * resolution_m * parameters.path_distance_bias
        goal = half * resolution_m * parameters.goal_distance_bias
        occupied = obstacles * parameters.occdist_scale
        return np.array([1.0, occupied, goal, path if aligned else 0.0, path, goal, parameters.twirling_scale])


def warm() -> None:
    """Compile the kernels of this module."""
    costmap = CostWindow(
        costs=np.zeros((40, 40), dtype=np.uint8),
        origin_m=(-1.0, -1.0),
        resolution_m=0.05,
        frame="odom",
        footprint=np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1]]),
        inscribed_radius_m=0.05,
        circumscribed_radius_m=0.15,
    )
    scoring = DwaScoring(DwaParameters(), "noetic")
    scoring.prepare(np.zeros(3), np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]), costmap)
    motions = scoring.score(np.zeros(3), np.zeros(3), np.array([[0.3, 0.0, 0.1]]))
    scoring.motion(np.zeros(3), np.zeros(3), motions.samples[0])
