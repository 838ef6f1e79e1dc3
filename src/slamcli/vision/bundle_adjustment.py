# SPDX-License-Identifier: MIT
"""Full and local bundle adjustment by Levenberg-Marquardt with the points eliminated (Schur complement)."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _observation_kernels as kernels
from slamcli.vision.bundle_problem import MONO_BOUND, STEREO_BOUND, BundleProblem, BundleResult
from slamcli.vision.bundle_system import BundleState, BundleSystem
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]
START = 1e-5  # damping in the beginning, as a share of the diagonal
SMALLEST = 1e-9
INTRINSICS = ("fx", "fy", "cx", "cy", "bf")
LARGEST = 1e8  # damping at which no step leads down any more


def adjust_bundle(
    problem: BundleProblem,
    *,
    iterations: int = 10,
    robust: bool = True,
    fixed_points: NDArray[np.bool_] | None = None,
    refine_intrinsics: Sequence[str] = (),
    tolerance: float = 1e-6,
    threads: int = 1,
) -> BundleResult:
    """Return the cameras and points that minimise the reprojection error.

    Parameters
    ----------
    problem : with at least one fixed camera, or two for a monocular one, if the whole is not to drift.
    iterations : at most; a rejected step counts.
    robust : Huber's loss with the 95 % bounds (5.991 mono, 7.815 stereo) on the squared residuals.
    fixed_points : bool (P,), points that stay.
    refine_intrinsics : which of "fx", "fy", "cx", "cy" and "bf" are unknowns as well, shared by all cameras. Baseline times
        focal length is the map's scale: refine it only where fixed cameras or points hold that.
    tolerance : relative decrease of the cost at which it ends.
    threads : that share the work; the result is the same to the byte.

    Returns
    -------
    BundleResult

    Notes
    -----
    Minimises half the sum of rho(|u_ij - pi(T_i, P_j)|^2 / sigma_ij^2) (Mur-Artal and Tardós, T-RO 2017, equation 6). A
    camera or point that too few observations hold is held by the damping. A point that its step would put in a worse place
    goes a quarter or a sixteenth of it, or stays; one behind a camera has a constant, high cost.
    """
    return adjust_in_rounds(
        problem, rounds=((iterations, robust),), fixed_points=fixed_points, refine_intrinsics=refine_intrinsics,
        tolerance=tolerance, threads=threads,
    )  # fmt: skip


def adjust_in_rounds(
    problem: BundleProblem,
    *,
    rounds: Sequence[tuple[int, bool]] = ((5, True), (10, False)),
    fixed_points: NDArray[np.bool_] | None = None,
    refine_intrinsics: Sequence[str] = (),
    tolerance: float = 1e-5,
    threads: int = 1,
) -> BundleResult:
    """Return the bundle adjusted in rounds of (iterations, robust), each without the outliers of the one before.

    The default is the local bundle adjustment of ORB-SLAM: five iterations with Huber's loss, then ten without loss and
    without what lies behind a camera or beyond the 95 % bound. `inliers` of the result tells which observations remain
    good. Parameters otherwise as for :func:`adjust_bundle`. The tolerance is wider: on nine synthetic problems what was
    left moved cameras by 0.00 to 0.08 of their standard deviation on average.
    """
    held = np.zeros(len(problem.points), np.bool_) if fixed_points is None else np.asarray(fixed_points, np.bool_)
    if held.shape != (len(problem.points),):
        raise DataError(f"bundle adjustment: fixed_points is {held.shape}, {(len(problem.points),)} is wanted")
    unknown = [name for name in refine_intrinsics if name not in INTRINSICS]
    if unknown:
        raise DataError(f"bundle adjustment: no intrinsic is called {unknown[0]!r}; there are {', '.join(INTRINSICS)}")
    refined = np.isin(INTRINSICS, list(refine_intrinsics))
    state = _start(problem)
    chi2, ahead, inliers = _judge(problem, state)
    total, before, cost, converged, deviations = 0, 0.0, 0.0, True, np.full(len(INTRINSICS), np.nan)
    with _pool(threads) as pool:
        for turn, (iterations, robust) in enumerate(rounds):
            part = problem if turn == 0 else _selected(problem, inliers)
            system = BundleSystem(part, held, pool, refined)
            state, before, cost, done, converged = _descend(system, state, iterations, robust, tolerance)
            total += done
            if refined.any() and turn == len(rounds) - 1:
                deviations = system.intrinsics_sigmas(state, robust)
            chi2, ahead, inliers = _judge(problem, state)
    T = np.tile(np.eye(4), (len(state.poses), 1, 1))
    T[:, :3] = state.poses
    T[problem.fixed] = problem.T_camera_map[problem.fixed]
    return BundleResult(
        T_camera_map=T, points=state.points, chi2=chi2, positive_depth=ahead, inliers=inliers,
        camera=_camera(problem.camera, state) if refined.any() else problem.camera, intrinsics_sigmas=deviations, iterations=total, cost_before=before,
        cost=cost, converged=converged,
    )  # fmt: skip


def _descend(
    system: BundleSystem, state: BundleState, iterations: int, robust: bool, tolerance: float
) -> tuple[BundleState, float, float, int, bool]:
    """Return the state at the end, the costs before and after, the steps tried, and whether it converged."""
    damping, growth, before, cost = START, 4.0, -1.0, 0.0
    for iteration in range(iterations):
        reduced = system.linearise(state, damping, robust)
        cost = reduced.cost
        before = cost if before < 0 else before
        steps = system.solve(reduced, damping)
        if steps is not None:
            moved, other = system.step(state, steps, robust)
            if other <= cost:
                settled = cost - other <= tolerance * cost
                state, cost = moved, other
                damping, growth = max(0.1 * damping, SMALLEST), 4.0
                if settled:
                    return state, before, cost, iteration + 1, True
                continue
            if other - cost <= 1e-9 * cost:  # rounding: there is no way down
                return state, before, cost, iteration + 1, True
        damping, growth = damping * growth, 2.0 * growth
        if damping > LARGEST:
            return state, before, cost, iteration + 1, True
    return state, max(before, 0.0), cost, iterations, False


def _start(problem: BundleProblem) -> BundleState:
    poses = np.array(problem.T_camera_map[:, :3], np.float64, order="C")
    points = np.array(problem.points, np.float64, order="C")
    return BundleState(poses=poses, points=points, camera=problem.camera.array)


def _camera(camera: Pinhole, state: BundleState) -> Pinhole:
    fx, fy, cx, cy, bf = state.camera.tolist()
    return replace(camera, fx=fx, fy=fy, cx=cx, cy=cy, baseline_m=bf / (fx * camera.depth_weight))


def _selected(problem: BundleProblem, chosen: NDArray[np.bool_]) -> BundleProblem:
    """Return the problem with the chosen observations only."""
    return replace(
        problem, camera_index=problem.camera_index[chosen], point_index=problem.point_index[chosen],
        pixels=problem.pixels[chosen], right=problem.right[chosen], sigmas=problem.sigmas[chosen],
    )  # fmt: skip


def _judge(problem: BundleProblem, state: BundleState) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return chi2, whether the point is ahead, and whether the observation is an inlier, each (M,)."""
    chi2, ahead = np.empty(len(problem)), np.empty(len(problem), np.bool_)
    kernels.squares(
        np.ascontiguousarray(problem.camera_index, np.int64), np.ascontiguousarray(problem.point_index, np.int64),
        np.column_stack([problem.pixels, problem.right]), 1.0 / np.asarray(problem.sigmas, np.float64) ** 2,
        state.poses, state.points, state.camera, chi2, ahead,
    )  # fmt: skip
    return chi2, ahead, ahead & (chi2 <= np.where(np.isnan(problem.right), MONO_BOUND, STEREO_BOUND))


@contextlib.contextmanager
def _pool(threads: int) -> Iterator[Executor | None]:
    if threads <= 1:
        yield None
        return
    with ThreadPoolExecutor(threads) as pool:
        yield pool


def warm() -> None:
    """Compile the kernels of this module with two cameras and four points."""
    points = np.array([[0.0, 0, 2], [1, 0, 3], [0, 1, 4], [1, 1, 3]])
    camera = Pinhole(fx=100.0, fy=100.0, cx=50.0, cy=50.0, width=100, height=100)
    pixels = np.concatenate([camera.project(points), camera.project(points + 0.1)])
    index, zeros = np.arange(4), np.zeros(4, np.int64)
    problem = BundleProblem(
        T_camera_map=np.tile(np.eye(4), (2, 1, 1)), fixed=np.array([True, False]), points=points,
        camera_index=np.concatenate([zeros, zeros + 1]), point_index=np.concatenate([index, index]), pixels=pixels,
        right=np.full(8, np.nan), sigmas=np.ones(8), camera=camera,
    )  # fmt: skip
    adjust_in_rounds(problem, refine_intrinsics=("fx",))
