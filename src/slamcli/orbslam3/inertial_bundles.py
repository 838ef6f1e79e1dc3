# SPDX-License-Identifier: MIT
"""Bundle adjustment of a part of a map, or of all of it, together with its IMU."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.bundles import adjust
from slamcli.orbslam3.inertial_state import Imu, MapInertia
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.posegraph.visual_inertial import adjust_visual_inertial
from slamcli.posegraph.visual_inertial_problem import VisualInertialProblem
from slamcli.vision.bundle_adjustment import adjust_bundle
from slamcli.vision.bundle_problem import BundleProblem, BundleResult

Floats = NDArray[np.float64]
LOCAL = 12
"""Keyframes in a row that a local adjustment moves; ORB-SLAM3 takes 10."""
_LONGEST_LINK_NS = 10_000_000_000
"""Keyframes farther apart in time are not linked."""


def adjust_local_inertially(
    sparse_map: SparseMap, inertia: MapInertia, imu: Imu, *, rounds: tuple[int, int] = (5, 10)
) -> None:
    """Move the newest keyframes with their velocities and biases, and the points they see; the one before them holds them."""
    known = inertia.known(sparse_map)
    free = known[-LOCAL:]
    whole = len(free) == len(sparse_map.living_keyframes)
    before = known[-LOCAL - 1 : -LOCAL]
    solver = InertialSolver(sparse_map, inertia, imu, np.concatenate([before, free]), held=before, whole=whole)
    if adjust(sparse_map, np.sort(free), rounds=rounds, solve=solver) is not None:
        solver.store()


def adjust_all_inertially(
    sparse_map: SparseMap, inertia: MapInertia, imu: Imu, *, rounds: tuple[int, int] = (10, 20)
) -> None:
    """Move all keyframes but the first, velocities, biases, points, and gravity's direction."""
    known = inertia.known(sparse_map)
    solver = InertialSolver(sparse_map, inertia, imu, known, held=known[:0], whole=True)
    if adjust(sparse_map, sparse_map.living_keyframes, rounds=rounds, solve=solver) is not None:
        solver.store()


class InertialSolver:
    """Adjusts bundles with the states of an IMU that belong to their keyframes, and keeps these states in between."""

    def __init__(
        self, sparse_map: SparseMap, inertia: MapInertia, imu: Imu, keyframes: Ids, *, held: Ids, whole: bool
    ) -> None:
        """Take the keyframes with states, in the order of time; those `held` keep velocity and biases."""
        self._map, self._inertia, self._imu, self._whole = sparse_map, inertia, imu, whole
        self._keyframes, self._held = keyframes, np.isin(keyframes, held)
        self._velocities, self._biases = inertia.velocities(keyframes), inertia.biases(keyframes)
        self._gravity = inertia.gravity
        stamps = sparse_map.stamp_ns[keyframes]
        self._samples = imu.buffer.samples(int(stamps[0]) if len(stamps) else None)
        self.mean_square = 0.0
        """Of the links' residuals, per freedom, after the last call."""

    def __call__(self, problem: BundleProblem, keyframes: Ids, iterations: int) -> BundleResult:
        """Return the bundle adjusted; rows are those of the problem."""
        rows = np.flatnonzero(np.isin(self._keyframes, keyframes))
        stamps = self._map.stamp_ns[self._keyframes[rows]]
        n = np.arange(len(rows))
        links = np.stack([n[:-1], n[1:]], axis=1)[np.diff(stamps) <= _LONGEST_LINK_NS]
        result = adjust_visual_inertial(
            VisualInertialProblem(
                bundle=problem, cameras=np.searchsorted(keyframes, self._keyframes[rows]), stamps_ns=stamps,
                velocities=self._velocities[rows], biases=self._biases[rows], held=self._held[rows], links=links,
                samples=self._samples, noise=self._imu.noise, T_camera_imu=self._imu.T_camera_imu,
                gravity_map=self._gravity, gravity_moves=self._whole,
            ),
            iterations=iterations,
        )  # fmt: skip
        self._velocities[rows], self._biases[rows], self._gravity = result.velocities, result.biases, result.gravity_map
        self.mean_square = float(np.median(result.link_squares)) / 15 if len(links) else 0.0
        moved = BundleProblem(
            T_camera_map=result.T_camera_map, fixed=problem.fixed, points=result.points,
            camera_index=problem.camera_index, point_index=problem.point_index, pixels=problem.pixels,
            right=problem.right, sigmas=problem.sigmas, camera=problem.camera,
        )  # fmt: skip
        return adjust_bundle(moved, iterations=0)  # judges the observations where they are

    def store(self) -> None:
        """Keep the states that were found."""
        free = ~self._held
        self._inertia.set(self._map, self._keyframes[free], self._velocities[free], self._biases[free])
        self._inertia.gravity_map = self._gravity
