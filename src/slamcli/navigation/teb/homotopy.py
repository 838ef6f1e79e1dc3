# SPDX-License-Identifier: MIT
"""Classes of bands that pass obstacles on the same sides: signatures, and first paths of new classes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.teb import _roadmap_kernels as kernels
from slamcli.navigation.teb.obstacle_field import ObstacleField, obstacle_field, sample_costmap
from slamcli.navigation.teb.parameters import TebParameters

Array = NDArray[np.float64]
_MAX_PATHS = 1000
_OBSTACLE_AHEAD = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mark:
    """The class of a path."""

    value: complex
    """H-signature about the groups of obstacle cells."""
    sides: Array
    """float64 (D,): how many turns it makes about each moving disc, positive where that is on its left."""

    @property
    def is_valid(self) -> bool:
        """Whether it is a number; a path through an obstacle point has none."""
        return bool(np.isfinite(self.value))


class Classes:
    """Tells classes of paths from a start to a goal apart.

    Obstacles that stand are the groups of cells between which the robot does not fit, each with one point and its residue
    (the original takes each cell, whose residues grow and vanish beyond all measure when there are hundreds). What moves is
    passed on one side or the other of where it is when the robot is there.

    References
    ----------
    Bhattacharya, Kumar, Likhachev: Search-based path planning with homotopy class constraints, AAAI 2010, eq. 6; Roesmann,
    Hoffmann, Bertram: Integrated online trajectory planning and optimization in distinctive topologies, RAS 2017.
    """

    def __init__(self, parameters: TebParameters, obstacles: ObstacleField, start: Array, goal: Array) -> None:
        self._parameters = parameters
        self._obstacles = obstacles
        self._start = np.ascontiguousarray(start[:2])
        self._goal = np.ascontiguousarray(goal[:2])
        self._discs = obstacles.discs
        self._residues = np.empty(len(obstacles.group_points), dtype=np.complex128)
        kernels.residues(
            obstacles.group_points,
            self._start,
            self._goal,
            parameters.homotopy.h_signature_prescaler,
            self._residues,
        )

    def mark(self, path: Array, times: Array | None = None) -> Mark:
        """Return the class of a path, float64 (N, 2 or 3), N >= 2; without times it is driven at max_vel_x."""
        path = np.ascontiguousarray(path)
        if times is None:
            lengths = np.hypot(*np.diff(path[:, :2], axis=0).T)
            times = np.concatenate([[0.0], np.cumsum(lengths)]) / self._parameters.robot.max_vel_x
        sides = np.empty(len(self._discs))
        kernels.passing_sides(path, times, self._discs, sides)
        return Mark(value=kernels.signature(path, self._obstacles.group_points, self._residues), sides=sides)

    def are_same(self, a: Mark, b: Mark) -> bool:
        """Whether two classes are the same."""
        threshold = self._parameters.homotopy.h_signature_threshold
        return bool(kernels.same_class(a.value, a.sides, b.value, b.sides, threshold))

    def explore(self, known: list[Mark], room: int, rng: np.random.Generator) -> list[Array]:
        """Return a path, float64 (N, 2), of each of up to `room` classes that are not known, the shortest first.

        Nodes are random points between start and goal, or with ``simple_exploration`` points left and right of each group
        of obstacles; links lead towards the goal and do not come within the inscribed radius of an obstacle.
        """
        rules = self._parameters.homotopy
        beside = self._points_beside() if rules.simple_exploration else self._samples(rng)
        nodes = np.ascontiguousarray(np.vstack([self._start, beside, self._goal]))
        paths = np.empty((4 * rules.max_number_classes, len(nodes)), dtype=np.int64)
        lengths = np.empty(len(paths))
        found = kernels.explore(
            nodes,
            self._links(nodes),
            self._obstacles.group_points,
            self._residues,
            self._discs,
            self._parameters.robot.max_vel_x,
            rules.h_signature_threshold,
            np.array([mark.value for mark in known], dtype=np.complex128),
            np.array([mark.sides for mark in known]).reshape(len(known), len(self._discs)),
            _MAX_PATHS,
            paths,
            lengths,
        )
        order = np.argsort(lengths[:found], kind="stable")[:room]
        return [nodes[paths[k][paths[k] >= 0]] for k in order]

    def _samples(self, rng: np.random.Generator) -> Array:
        """Return random points (S, 2) in the rectangle about the way to the goal."""
        rules = self._parameters.homotopy
        ahead = self._goal - self._start
        distance = float(np.hypot(*ahead))
        ahead = ahead / max(distance, 1e-9)
        shares = rng.random((rules.roadmap_graph_no_samples, 2)) - 0.5
        along = distance * (0.5 + shares[:, :1] * rules.roadmap_graph_area_length_scale)
        across = rules.roadmap_graph_area_width * shares[:, 1:]
        return self._start + along * ahead + across * np.array([-ahead[1], ahead[0]])

    def _points_beside(self) -> Array:
        """Return points (2 G, 2) left and right of the groups of obstacles that lie ahead."""
        field = self._obstacles
        ahead = self._goal - self._start
        ahead = ahead / max(float(np.hypot(*ahead)), 1e-9)
        left = np.array([-ahead[1], ahead[0]])
        offset = field.costmap.circumscribed_radius_m + self._parameters.homotopy.obstacle_keypoint_offset
        points = []
        for group, middle in enumerate(field.group_points):
            away = middle - self._start
            if away @ ahead < _OBSTACLE_AHEAD * np.hypot(*away):
                continue
            across = (field.points[field.group_of == group] - middle) @ left
            points += [middle + (across.max() + offset) * left, middle + (across.min() - offset) * left]
        for x, y, radius, *_ in self._discs:
            points += [np.array([x, y]) + sign * (radius + offset) * left for sign in (1.0, -1.0)]
        return np.array(points).reshape(-1, 2)

    def _links(self, nodes: Array) -> NDArray[np.bool_]:
        linked = np.zeros((len(nodes), len(nodes)), dtype=np.bool_)
        kernels.link(
            nodes,
            self._obstacles.costmap.costs,
            *self._obstacles.costmap.origin_m,
            self._obstacles.costmap.resolution_m,
            self._parameters.homotopy.obstacle_heading_threshold,
            linked,
        )
        return linked


def warm() -> None:
    """Compile the kernels of this module."""
    field = obstacle_field(sample_costmap(), np.zeros(3), behind_m=1.0)
    classes = Classes(TebParameters(), field, np.array([0.1, 0.1]), np.array([0.7, 0.7]))
    mark = classes.mark(np.array([[0.1, 0.1], [0.7, 0.7]]))
    classes.mark(np.zeros((2, 3)), np.zeros(2))
    classes.are_same(mark, mark)
    classes.explore([mark], 1, np.random.default_rng(0))
