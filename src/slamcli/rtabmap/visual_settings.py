# SPDX-License-Identifier: MIT
"""What registration by features is told (``Vis/*``, ``Reg/*``)."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.rtabmap.parameters import RegGroup, VisGroup


@dataclass(frozen=True, slots=True, kw_only=True)
class VisualSettings:
    """Fields are the native names in small letters; the defaults are RTAB-Map's."""

    estimation_type: int = 1
    """0: points to points, 1: points to pixels (PnP), 2: pixels to pixels (epipolar), scaled by the points that are known."""
    cor_nn_type: int = 1
    """5: each the other's nearest, whatever the second best; any other: nearest by `cor_nndr`, all found exactly by brute force."""
    cor_nndr: float = 0.8
    """Distance to the nearest over that to the second nearest."""
    cor_guess_win_size: int = 40
    """Pixels around where a point is expected; 0: a guess is not used to find matches."""
    pnp_reproj_error: float = 2.0
    """Pixels, at the finest octave."""
    pnp_max_variance: float = 0.0
    """m^2; 0: not looked at."""
    pnp_variance_median_ratio: int = 4
    """Which part of the sorted errors tells their size: the least 1 / ratio. Above 4 covariances become smaller, below larger."""
    epipolar_geometry_var: float = 0.1
    inlier_distance: float = 0.1
    """m."""
    refine_iterations: int = 5
    iterations: int = 300
    min_inliers: int = 20
    mean_inliers_distance: float = 0.0
    """m; 0: not looked at."""
    min_inliers_distribution: float = 0.0
    """0: not looked at."""
    bundle_adjustment: int = 1
    """0: none; any other: ours, of both cameras and all points."""
    repeat_once: bool = True
    """Whether matches are sought again around where the first motion puts them."""
    force_3dof: bool = False
    """Whether motions have x, y and yaw alone."""


def visual_settings(vis: VisGroup, reg: RegGroup) -> VisualSettings:
    """Return what registration by features is told by ``Vis/*`` and ``Reg/*``."""
    return VisualSettings(
        estimation_type=vis.estimation_type, cor_nn_type=vis.cor_nn_type, cor_nndr=vis.cor_nndr,
        cor_guess_win_size=vis.cor_guess_win_size, pnp_reproj_error=vis.pnp_reproj_error,
        pnp_max_variance=vis.pnp_max_variance, pnp_variance_median_ratio=vis.pnp_variance_median_ratio,
        epipolar_geometry_var=vis.epipolar_geometry_var, inlier_distance=vis.inlier_distance,
        refine_iterations=vis.refine_iterations, iterations=vis.iterations, min_inliers=vis.min_inliers,
        mean_inliers_distance=vis.mean_inliers_distance, min_inliers_distribution=vis.min_inliers_distribution,
        bundle_adjustment=vis.bundle_adjustment, repeat_once=reg.repeat_once, force_3dof=reg.force_3dof,
    )  # fmt: skip
