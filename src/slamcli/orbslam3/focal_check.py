# SPDX-License-Identifier: MIT
"""Whether colour and measured depth agree about the focal length, from the map itself.

A depth image that was not brought into the colour camera's view, or a calibration that is wrong, puts points where no other keyframe
sees them. Bundle adjustment with the focal lengths as unknowns then finds others, which fit the images and the depths better. A
wrong unit of the depth does not show: the whole map is larger by it. Nor does a wrong focal length where the camera neither turned nor
moved forward: all shifts are then wrong by one factor. The deviations say so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli.orbslam3.bundles import part_of
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.vision.bundle_adjustment import adjust_in_rounds
from slamcli.vision.bundle_problem import BundleProblem
from slamcli.vision.pinhole import Pinhole

_LEAST_KEYFRAMES, _MOST_KEYFRAMES = 5, 100
_ROUNDS = ((10, True), (10, False))
_LEAST_SHARE = 0.03
_LEAST_SIGMAS = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FocalCheck:
    """The focal lengths that a map's images and depths fit best."""

    given_px: tuple[float, float]
    """fx and fy of the calibration."""
    best_px: tuple[float, float]
    """fx and fy that fit best."""
    sigmas_px: tuple[float, float]
    """Their standard deviations, with the variance that the residuals have."""

    @property
    def contradicts(self) -> bool:
        """Whether one of them is more than 3 % and five standard deviations from that of the calibration."""
        off = np.abs(np.subtract(self.best_px, self.given_px))
        return bool(
            np.any((off > _LEAST_SHARE * np.array(self.given_px)) & (off > _LEAST_SIGMAS * np.array(self.sigmas_px)))
        )

    def figures(self) -> dict[str, list[float] | bool]:
        """Return what is written of it: fx and fy, pixels."""
        return {
            "given_px": list(self.given_px), "best_px": list(self.best_px), "sigmas_px": list(self.sigmas_px),
            "contradicts": self.contradicts,
        }  # fmt: skip

    def warning(self) -> str:
        """Return what to tell: what, how much, what to do."""
        return (
            f"colour and depth contradict the calibration: the map fits focal lengths of {self.best_px[0]:.0f} and {self.best_px[1]:.0f} px"
            f" (+- {max(self.sigmas_px):.0f}) better than its {self.given_px[0]:.0f} and {self.given_px[1]:.0f}: depth not registered to"
            " colour, or a wrong calibration; give the right one (--camera FILE), or register the depth images"
        )


def check_focal_lengths(sparse_map: SparseMap) -> FocalCheck | None:
    """Return the focal lengths that the map fits best, from its first 100 keyframes; None where there are too few to tell.

    The map stays as it is. What the depth sensor measured is kept: only where pixels look changes.
    """
    keyframes = sparse_map.living_keyframes
    if len(keyframes) < _LEAST_KEYFRAMES:
        return None
    problem = _problem(sparse_map, keyframes[:_MOST_KEYFRAMES])
    if problem is None:
        return None
    result = adjust_in_rounds(problem, rounds=_ROUNDS, refine_intrinsics=("fx", "fy"))
    good = result.inliers
    measured = float(2 * good.sum() + np.isfinite(problem.right[good]).sum())
    freedom = measured - 3 * len(problem.points) - 6 * (len(problem.fixed) - 1) - 2
    if freedom <= 0 or not np.isfinite(result.intrinsics_sigmas[:2]).all():
        return None
    spread = np.sqrt(max(float(result.chi2[good].sum()) / freedom, 1.0))
    fx, fy = (result.intrinsics_sigmas[:2] * spread).tolist()
    return FocalCheck(
        given_px=_focal_lengths(sparse_map.camera), best_px=_focal_lengths(result.camera), sigmas_px=(fx, fy)
    )


def _problem(sparse_map: SparseMap, keyframes: Ids) -> BundleProblem | None:
    """Return what these keyframes alone see: others, adjusted with the focal lengths that are in doubt, would hold on to them.

    Depth weighs as in ORB-SLAM3, not more: where it is not registered, it was measured beside the pixel.
    """
    part = part_of(sparse_map, keyframes)
    if part is None or not np.isfinite(part.problem.right).any():
        return None
    whole, camera = part.problem, sparse_map.camera
    rows = np.flatnonzero(np.isin(part.cameras, keyframes))
    taken = np.isin(whole.camera_index, rows)
    # A point with one observation tells nothing of the focal length, but nothing holds one without depth either.
    taken &= np.bincount(whole.point_index[taken], minlength=len(whole.points))[whole.point_index] > 1
    points, point_index = np.unique(whole.point_index[taken], return_inverse=True)
    pixels = whole.pixels[taken]
    return BundleProblem(
        T_camera_map=whole.T_camera_map[rows], fixed=np.arange(len(rows)) == 0, points=whole.points[points],
        camera_index=np.searchsorted(rows, whole.camera_index[taken]), point_index=point_index, pixels=pixels,
        right=pixels[:, 0] - (pixels[:, 0] - whole.right[taken]) / camera.depth_weight, sigmas=whole.sigmas[taken],
        camera=replace(camera, depth_weight=1.0),
    )  # fmt: skip


def _focal_lengths(camera: Pinhole) -> tuple[float, float]:
    return camera.fx, camera.fy
