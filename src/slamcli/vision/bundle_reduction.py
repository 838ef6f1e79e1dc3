# SPDX-License-Identifier: MIT
"""The visual part of a larger problem: reprojection errors as terms between cameras, their points eliminated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.vision.bundle_problem import BundleProblem
from slamcli.vision.bundle_system import BundleState, BundleSystem

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraTerms:
    """A quadratic of the increments of F free cameras: cost + gradient @ x + x @ hessian @ x / 2.

    Increments are (phi, rho) of each camera in its own axes: T_camera_map becomes [Exp(phi) | rho] @ T_camera_map.
    """

    hessian: Floats
    """float64 (6 F, 6 F), symmetric."""
    gradient: Floats
    """float64 (6 F,)."""
    cost: float
    """Half the sum of the losses of all observations."""


class BundleReduction:
    """The points of a bundle problem, eliminated at one state after the other.

    An optimiser with more terms (an IMU's) linearises, adds what it has to `CameraTerms`, solves for the cameras, and asks
    where the points follow. `problem` says who sees what; its poses and points are not used.
    """

    def __init__(self, problem: BundleProblem, fixed_points: NDArray[np.bool_] | None = None) -> None:
        held = np.zeros(len(problem.points), np.bool_) if fixed_points is None else np.asarray(fixed_points, np.bool_)
        self._system = BundleSystem(problem, held)
        self._points, self._camera = np.array(problem.points, np.float64, order="C"), problem.camera.array

    @property
    def free(self) -> NDArray[np.int64]:
        """int64 (F,), the cameras of the problem that move, in the order of the terms."""
        return self._system.free

    def linearise(
        self, T_camera_map: Floats, points: Floats, *, damping: float = 0.0, robust: bool = True
    ) -> CameraTerms:
        """Return the cameras' terms at poses (C, 4, 4) and points (P, 3).

        `damping`, a share of the diagonal, is added to the points' blocks only: damp the cameras yourself.
        """
        self._points = np.array(points, np.float64, order="C")
        poses = np.array(T_camera_map[:, :3], np.float64, order="C")
        reduced = self._system.linearise(self._state(poses, self._points), damping, robust)
        return CameraTerms(
            hessian=self._system.system.dense(reduced.blocks), cost=reduced.cost,
            gradient=reduced.gradient[self._system.system.ranks].ravel(),
        )  # fmt: skip

    def follow(self, T_camera_map: Floats, steps: Floats, *, robust: bool = True) -> tuple[Floats, float]:
        """Return where the points (P, 3) go, and the cost there.

        Parameters
        ----------
        T_camera_map : float64 (C, 4, 4), the cameras after their steps.
        steps : float64 (F, 6), the increments from the last linearisation that led there.
        robust : as in that linearisation.
        """
        by_rank = np.empty((len(self.free), 6))
        by_rank[self._system.system.ranks] = np.asarray(steps, np.float64).reshape(-1, 6)
        poses = np.array(T_camera_map[:, :3], np.float64, order="C")
        return self._system.follow(self._state(poses, self._points), by_rank, robust)

    def _state(self, poses: Floats, points: Floats) -> BundleState:
        return BundleState(poses=poses, points=points, camera=self._camera)
