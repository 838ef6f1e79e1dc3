# SPDX-License-Identifier: MIT
"""Hybrid A*: paths that a robot with a turning radius can drive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.navigation import _hybrid_kernels as kernels
from slamcli.navigation.costmap import LETHAL, NO_INFORMATION
from slamcli.navigation.curves import Curve, CurveFamily, shortest_curve
from slamcli.navigation.grid_search import GridSearch
from slamcli.navigation.hybrid_parameters import HybridParameters
from slamcli.navigation.search_space import SearchGrid, UnreachableError, sample_space

_STEP_CELLS = 1.5
_LATTICE = 0.65
"""Cells between points inside the outline: the emptiest circle between them has a radius of 0.46. Where a cell's inner circle
of 0.5 is not that far inside the outline, the outline cuts it in 0.54 cells or more, and its own points are closer."""
_BORDER = np.array([1.0, 1.0, 0.0])
_GREED = 1.1
"""Factor on the estimate of what is to come: many times fewer states for paths about 2 % dearer (measured in docs/benchmarks.md)."""
_FURTHER = 2
_FURTHER_POPS = 1000
"""When a way is known, the search goes on for so many times the states it took and so many more, for a better one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrivablePath:
    """Poses in cells of the grid, centres at whole numbers."""

    poses: NDArray[np.float64]
    """float64 (N, 3): column, row, yaw; at most a cell apart."""
    directions: NDArray[np.int64]
    """int64 (N,): 1 where the robot comes to the pose forward, -1 in reverse; the first has that of the second."""
    cost: float
    """In cells of free space driven straight on."""


class HybridAStar:
    """Finds drivable paths on one search space; its levels may change between queries.

    States are poses, one per cell and heading bin; a step is an arc of at least 1.5 cells with the least radius, twice that, or
    straight, forward and in reverse (REEDS_SHEPP). At states taken from the queue, the nearer to the goal the more often, the
    shortest curve to the goal is tried. What is to come is estimated by 1.1 times the cost on the grid from the goal, obstacles
    included. The robot's outline is checked at every cell of the way.

    Neither complete nor optimal: one state per cell and bin, an estimate that may be too high, `max_iterations`.

    References
    ----------
    Dolgov, Thrun, Montemerlo, Diebel: Practical Search Techniques in Path Planning for Autonomous Driving, 2008.
    """

    def __init__(self, space: SearchGrid, parameters: HybridParameters) -> None:
        self._space = space
        self._parameters = parameters
        self._levels = space.levels.reshape(-1)
        self.grid_search = GridSearch(space, guided=False)
        self._hit = np.zeros(256, dtype=np.bool_)
        self._hit[LETHAL] = True
        self._hit[NO_INFORMATION] = bool(space.blocked[NO_INFORMATION])
        size = parameters.max_iterations
        self._nodes = np.empty((size, 6))
        self._parents = np.empty(size, dtype=np.int64)
        self._codes = np.empty(size, dtype=np.int64)
        self._table = np.empty(1 << (2 * size - 1).bit_length(), dtype=np.int64)
        self._keys = np.empty(size)
        self._items = np.empty(size, dtype=np.int64)

    def find(
        self,
        start: NDArray[np.float64],
        goal: NDArray[np.float64],
        footprint_cells: NDArray[np.float64],
        resolution_m: float,
    ) -> DrivablePath:
        """Return the path between two poses (3,): column, row, yaw, both on free cells; a yaw of NaN may be any.

        `footprint_cells`, float64 (F, 2), is the robot's outline in cells, base frame.

        Raises
        ------
        UnreachableError
            If there is no way, the robot cannot stand at an end, or the search gave up.
        """
        parameters, stride = self._parameters, self._space.stride
        radius = parameters.minimum_turning_radius / resolution_m
        family: CurveFamily = "dubins" if parameters.motion_model_for_search == "DUBIN" else "reeds_shepp"
        # The grid's kernels count the border in, and so do poses from here on.
        first, last = self._with_headings(start, goal, radius)
        world = (
            self._levels,
            stride,
            self._space.blocked,
            self._hit,
            self._space.weight,
            outline_points(footprint_cells),
        )
        for role, pose in (("start", first), ("goal", last)):
            if not math.isfinite(kernels.pose_cost(*world, *pose)):
                raise UnreachableError(f"the robot's outline touches an obstacle at the {role}")
        field = self.grid_search.costs_to((round(goal[1]), round(goal[0]))) * _GREED
        motions = self._motions(radius)
        step = max(_STEP_CELLS, 2.0 * math.pi * radius / parameters.angle_quantization_bins)
        state = (self._nodes, self._parents, self._codes, self._table, self._keys, self._items, np.zeros(4, np.int64))
        ahead = float(field[math.floor(first[1] + 0.5) * stride + math.floor(first[0] + 0.5)])
        if not math.isfinite(ahead):
            raise UnreachableError("no way on the grid")
        kernels.begin(first, stride, parameters.angle_quantization_bins, ahead, *state)
        penalties = np.array([parameters.cusp_penalty / resolution_m])
        best: tuple[float, int, Curve | None] = (math.inf, -1, None)
        limit = len(self._nodes)
        while True:
            node = kernels.resume(
                *world,
                field,
                parameters.angle_quantization_bins,
                motions,
                penalties,
                step,
                parameters.analytic_expansion_ratio,
                best[0],
                limit,
                *state,
            )
            if node < 0:
                break
            curve = shortest_curve(self._nodes[node, :3], last, radius, family)
            cost = self._nodes[node, kernels.G] + self._curve_cost(world, curve, node, penalties[0])
            if cost < best[0]:
                if best[2] is None:
                    limit = _FURTHER * int(state[-1][kernels.POPS]) + _FURTHER_POPS
                best = (cost, node, curve)
        if best[2] is None:
            why = "the search gave up (max_iterations)" if node == kernels.LIMIT else "no drivable way"
            raise UnreachableError(why)
        return self._path(best[0], best[1], best[2], step)

    def _with_headings(
        self, start: NDArray[np.float64], goal: NDArray[np.float64], radius: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the poses on the bordered grid, with headings along the way on the grid where they have none."""
        if math.isnan(start[2]) or math.isnan(goal[2]):
            start, goal = start.copy(), goal.copy()
            cells = [(math.floor(p[1] + 0.5), math.floor(p[0] + 0.5)) for p in (start, goal)]
            path, _ = self.grid_search.find(*cells)
            # Over a stretch that a curve can follow, not the last two cells.
            near = min(math.ceil(2.0 * radius), len(path) - 1)
            for pose, (dy, dx) in ((start, path[near] - path[0]), (goal, path[-1] - path[-1 - near])):
                if math.isnan(pose[2]):
                    pose[2] = math.atan2(dy, dx)
        return start + _BORDER, goal + _BORDER

    def _motions(self, radius: float) -> NDArray[np.float64]:
        """Return float64 (M, 3): curvature, direction, factor on the cost."""
        parameters = self._parameters
        directions = (1.0,) if parameters.motion_model_for_search == "DUBIN" else (1.0, -1.0)
        motions = [
            (
                curvature / radius,
                direction,
                (parameters.non_straight_penalty if curvature else 1.0)
                * (parameters.reverse_penalty if direction < 0 else 1.0),
            )
            for direction in directions
            for curvature in (0.0, 1.0, -1.0, 0.5, -0.5)
        ]
        return np.array(motions)

    def _curve_cost(
        self, world: tuple[NDArray[np.generic] | int, ...], curve: Curve, node: int, cusp_penalty: float
    ) -> float:
        """Return what a curve from a node costs; inf if the robot touches something on it."""
        parameters = self._parameters
        pose = np.array(curve.start)
        before, total = float(self._nodes[node, kernels.DIRECTION]), 0.0
        for length, turn in zip(curve.lengths_m.tolist(), curve.turns.tolist(), strict=True):
            way = kernels.drive(*world, pose, turn / curve.turning_radius_m, length, 1.0)
            if not math.isfinite(way):
                return math.inf
            direction = math.copysign(1.0, length)
            total += way * (parameters.non_straight_penalty if turn else 1.0)
            total += (
                way
                * (parameters.non_straight_penalty if turn else 1.0)
                * (parameters.reverse_penalty - 1.0 if direction < 0 else 0.0)
            )
            total += cusp_penalty if before * direction < 0 else 0.0
            before = direction
        return total

    def _path(self, cost: float, node: int, curve: Curve, step: float) -> DrivablePath:
        chain = []
        at = node
        while self._parents[at] >= 0:
            chain.append(at)
            at = int(self._parents[at])
        pieces = [curve]
        for at in chain:
            curvature = float(self._nodes[at, kernels.CURVATURE])
            direction = float(self._nodes[at, kernels.DIRECTION])
            pieces.append(
                Curve(
                    self._nodes[self._parents[at], :3].copy(),
                    np.array([direction * step]),
                    np.array([int(np.sign(curvature))]),
                    1.0 / abs(curvature) if curvature else 1.0,
                )
            )
        sampled = [piece.sample(1.0) for piece in pieces[::-1]]
        poses = np.vstack([sampled[0][0][:1], *(p[1:] for p, _ in sampled)])
        directions = np.concatenate([d[1:] for _, d in sampled])
        poses[:, :2] -= 1.0
        return DrivablePath(
            poses=poses,
            directions=np.concatenate([directions[:1], directions]) if len(directions) else np.ones(1, dtype=np.int64),
            cost=cost,
        )


def outline_points(footprint_cells: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return float64 (S, 2): points on the outline at most half a cell apart, and a lattice inside.

    Together they meet every cell whose centre the outline contains, in any pose (but for cells right at a sharp corner).
    """
    corners = np.asarray(footprint_cells, dtype=np.float64)
    points: list[NDArray[np.float64]] = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(1, math.ceil(2.0 * math.dist(a, b)))
        points.extend(a + (b - a) * k / count for k in range(count))
    low, high = corners.min(axis=0), corners.max(axis=0)
    lattice = [(x, y) for x in np.arange(low[0], high[0], _LATTICE) for y in np.arange(low[1], high[1], _LATTICE)]
    points.extend(np.array(p) for p in lattice if _inside(corners, *p))
    return np.ascontiguousarray(np.array(points))


def _inside(corners: NDArray[np.float64], x: float, y: float) -> bool:
    """Whether a point lies in a polygon: crossings of a ray."""
    following = np.roll(corners, -1, axis=0)
    spans = (corners[:, 1] > y) != (following[:, 1] > y)
    rise = np.where(following[:, 1] == corners[:, 1], 1.0, following[:, 1] - corners[:, 1])
    at = corners[:, 0] + (y - corners[:, 1]) / rise * (following[:, 0] - corners[:, 0])
    return bool((spans & (x < at)).sum() % 2)


def warm() -> None:
    """Compile the kernels of this module."""
    square = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])
    search = HybridAStar(sample_space(), HybridParameters(max_iterations=1000, minimum_turning_radius=0.1))
    try:
        search.find(np.array([0.0, 0.0, 0.0]), np.array([3.0, 3.0, 0.0]), square, 0.1)
    except UnreachableError as error:
        raise PlanningError("hybrid A* failed on its sample") from error
