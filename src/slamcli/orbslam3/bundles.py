# SPDX-License-Identifier: MIT
"""Bundle adjustment of a part of a map, or of all of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.vision.bundle_adjustment import adjust_bundle
from slamcli.vision.bundle_problem import BundleProblem, BundleResult

_CHI2_MONO, _CHI2_STEREO = 5.991, 7.815

Solver = Callable[[BundleProblem, Ids, int], BundleResult]
"""Adjusts a bundle whose cameras are these keyframes in some iterations; one that knows an IMU keeps its states to itself."""


def solve_visually(problem: BundleProblem, keyframes: Ids, iterations: int) -> BundleResult:  # noqa: ARG001
    """Adjust a bundle by what the cameras see alone."""
    return adjust_bundle(problem, iterations=iterations, robust=True)


def adjust_local(sparse_map: SparseMap, keyframe: int, *, most: int, rounds: tuple[int, int] = (5, 10)) -> None:
    """Move a keyframe, its neighbours and the points they see; others that see these points hold them (ORB-SLAM, section VI-D)."""
    neighbours, _ = sparse_map.covisible(keyframe)
    local = np.concatenate([[keyframe], neighbours[: most - 1]])
    adjust(sparse_map, np.sort(local), rounds=rounds)


def adjust_all(sparse_map: SparseMap, *, rounds: tuple[int, int] = (10, 20)) -> BundleResult | None:
    """Move all keyframes but the first, and all points."""
    return adjust(sparse_map, sparse_map.living_keyframes, rounds=rounds)


def adjust(
    sparse_map: SparseMap, free: Ids, *, rounds: tuple[int, int], solve: Solver = solve_visually
) -> BundleResult | None:
    """Move keyframes `free` (sorted) and the points they see, twice: with a robust kernel, then without the observations that do not fit.

    Those observations are taken out of the map, and points that are then seen by fewer than two keyframes.
    """
    part = part_of(sparse_map, free)
    if part is None:
        return None
    problem, cameras, ids, points = part.problem, part.cameras, part.points, part.problem.point_index
    fixed = problem.fixed
    first = solve(problem, cameras, rounds[0])
    kept = fits(first, problem)
    again = BundleProblem(
        T_camera_map=first.T_camera_map, fixed=fixed, points=first.points, camera_index=problem.camera_index[kept],
        point_index=points[kept], pixels=problem.pixels[kept], right=problem.right[kept], sigmas=problem.sigmas[kept],
        camera=sparse_map.camera,
    )  # fmt: skip
    result = solve(again, cameras, rounds[1])
    last = fits(result, again)
    held = np.flatnonzero(kept)[last]
    _write(sparse_map, result, cameras[~fixed], np.flatnonzero(~fixed), ids)
    out = np.ones(len(points), dtype=np.bool_)
    out[held] = False
    sparse_map.see(part.keyframes[out], part.features[out], -1)
    # An observation with depth is worth two: it says where the point is.
    worth = np.bincount(points[held], weights=1.0 + np.isfinite(problem.right[held]), minlength=len(ids))
    lonely = ids[worth < 2]
    sparse_map.remove_points(lonely)
    sparse_map.refresh_points(ids[sparse_map.point_alive[ids]])
    return result


class Part(NamedTuple):
    """A part of a map as a problem, and what its rows are in the map."""

    problem: BundleProblem
    cameras: Ids
    """(C,), keyframes."""
    points: Ids
    """(P,)."""
    keyframes: Ids
    """(M,), of each observation."""
    features: Ids
    """(M,), of the keyframe, of each observation."""


def part_of(sparse_map: SparseMap, free: Ids) -> Part | None:
    """Return keyframes `free` (sorted), the points they see, and the keyframes that hold these; None where they see next to nothing."""
    ids = sparse_map.points_of(free)
    if len(ids) < 3:
        return None
    offsets, keyframes, features = sparse_map.observations(ids)
    cameras = np.flatnonzero(np.bincount(keyframes))
    fixed = ~np.isin(cameras, free)
    if not fixed.any():
        fixed[0] = True
    row_of_camera = np.full(sparse_map.num_keyframes, -1, dtype=np.int64)
    row_of_camera[cameras] = np.arange(len(cameras))
    problem = BundleProblem(
        T_camera_map=sparse_map.T_camera_map[cameras], fixed=fixed, points=sparse_map.positions[ids],
        camera_index=row_of_camera[keyframes], point_index=np.repeat(np.arange(len(ids)), np.diff(offsets)),
        pixels=sparse_map.pixels[keyframes, features], right=sparse_map.right[keyframes, features],
        sigmas=sparse_map.sigmas[keyframes, features], camera=sparse_map.camera,
    )  # fmt: skip
    return Part(problem, cameras, ids, keyframes, features)


def fits(result: BundleResult, problem: BundleProblem) -> NDArray[np.bool_]:
    """Return which observations (M,) the result explains to 95 %."""
    limit = np.where(np.isfinite(problem.right), _CHI2_STEREO, _CHI2_MONO)
    return (result.chi2 <= limit) & result.positive_depth


def _write(sparse_map: SparseMap, result: BundleResult, cameras: Ids, rows: Ids, ids: Ids) -> None:
    sparse_map.T_camera_map[cameras] = result.T_camera_map[rows]
    sparse_map.positions[ids] = result.points
