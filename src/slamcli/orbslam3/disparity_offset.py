# SPDX-License-Identifier: MIT
"""What a stereo camera's calibration leaves wrong of all disparities alike, from the map itself.

A rectified pair whose principal columns, or whose cameras' yaw, are wrong by a tenth of a pixel measures all disparities too small or
too large by that. Depth then bends: near points fit, far ones do not, and what is passed at several distances contradicts itself. The
reprojection error of a whole map has its minimum at the true offset, which neither points nor poses can make up for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli.orbslam3.bundles import part_of
from slamcli.orbslam3.frame_track import TrackedFrame
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.vision.bundle_adjustment import adjust_bundle
from slamcli.vision.bundle_problem import BundleProblem

_STEP_PX = 0.1
_MOST_PX = 0.5
_LEAST_SIGMAS = 5.0
"""Standard deviations of the offset that it must differ from 0 by; many, as matches are not independent of each other."""
_LEAST_KEYFRAMES, _MOST_KEYFRAMES = 5, 60
_ITERATIONS = 15


@dataclass(frozen=True, slots=True, kw_only=True)
class DisparityOffset:
    """What is to be added to all disparities."""

    offset_px: float
    sigmas: float
    """Of how many standard deviations that is."""


def find_disparity_offset(sparse_map: SparseMap) -> DisparityOffset | None:
    """Return the offset that the map is most consistent with; None where it is small, unsure or implausible (over 0.5 px).

    Bundle adjustment at three offsets gives a parabola, and its lowest point is tried.
    """
    keyframes = sparse_map.living_keyframes
    if len(keyframes) < _LEAST_KEYFRAMES:
        return None
    part = part_of(sparse_map, keyframes[:_MOST_KEYFRAMES])
    if part is None:
        return None
    problem = part.problem
    low, middle, high = (_cost(problem, offset) for offset in (-_STEP_PX, 0.0, _STEP_PX))
    bend = low - 2.0 * middle + high
    if not bend > 0.0:
        return None
    best = 0.5 * (low - high) / bend * _STEP_PX
    if abs(best) > _MOST_PX:
        return None
    lowest = _cost(problem, best)
    gain = (middle - lowest) / (lowest / _freedom(problem))  # half chi2, with the variance that the residuals have
    sigmas = float(np.sqrt(max(2.0 * gain, 0.0)))
    return DisparityOffset(offset_px=float(best), sigmas=sigmas) if sigmas >= _LEAST_SIGMAS else None


def with_offset(frame: TrackedFrame, offset_px: float) -> TrackedFrame:
    """Return a frame whose disparities are larger by an offset."""
    return replace(frame, right=frame.right - offset_px)


def apply_offset(sparse_map: SparseMap, offset_px: float) -> None:
    """Make all disparities of a map larger by an offset; depths follow."""
    sparse_map.right[:] -= offset_px
    with np.errstate(invalid="ignore", divide="ignore"):
        depth = sparse_map.camera.bf / (sparse_map.pixels[:, :, 0] - sparse_map.right)
        sparse_map.depth[:] = np.where(np.isfinite(sparse_map.depth) & (depth > 0), depth, np.nan)


def _freedom(problem: BundleProblem) -> float:
    """Return half the degrees of freedom: of the measured numbers less the unknowns."""
    measured = 2 * len(problem.right) + np.isfinite(problem.right).sum()
    return 0.5 * max(float(measured - 3 * len(problem.points) - 6 * (~problem.fixed).sum()), 1.0)


def _cost(problem: BundleProblem, offset_px: float) -> float:
    return adjust_bundle(replace(problem, right=problem.right - offset_px), iterations=_ITERATIONS, robust=True).cost
