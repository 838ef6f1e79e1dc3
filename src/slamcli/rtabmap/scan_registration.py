# SPDX-License-Identifier: MIT
"""How one node's scan lies in another's: for loop closures, and to refine odometry and closures by looks (Reg/Strategy 1 and 2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.rtabmap.local_scan_map import ScanFit, Sought, local_scan_map
from slamcli.rtabmap.registration import Registration, refused
from slamcli.rtabmap.scan_settings import ScanSettings
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]

_WIDER_M, _WIDER_RAD = 0.15, 0.12
"""Standard deviations by which odometry that does not fit is tried again."""
_DOUBTED = 9.0
"""How many times the covariance counts of odometry that scans do not confirm."""
_ONE_SCAN_FACTOR = 25.0
"""Points of one scan are not independent of each other: the covariance that they tell counts so many times."""


def register_scans(
    a: NodeScan, b: NodeScan, T_a_b_guess: Floats, settings: ScanSettings, *, sigma_m: float = 0.05, sigma_rad: float = 0.02
) -> Registration:  # fmt: skip
    """Return how place b lies in place a by their scans.

    Parameters
    ----------
    T_a_b_guess
        float64 (4, 4), by odometry, by the graph or by what the camera saw.
    sigma_m, sigma_rad
        How well the guess is known: planar scans are searched for within three of these where that is more than 0.3 m or 0.15 rad.
    """
    try:
        merged = local_scan_map(np.eye(4)[None], [a], settings)
    except EstimationError as error:
        return refused(str(error))
    sought = Sought(scan=b, T_guess=T_a_b_guess, sigma_m=sigma_m, sigma_rad=sigma_rad)
    return registered(merged.fit(sought, 3.0 * sigma_m + 0.2), _ONE_SCAN_FACTOR)


def refined_by_scans(
    found: Registration, a: NodeScan | None, b: NodeScan | None, settings: ScanSettings
) -> Registration:
    """Return a closure by looks as the scans correct it (Reg/Strategy 2); refused where they refuse it.

    Without scans of both, or without a motion, it comes back as it is. The matches stay those of the features.
    """
    if found.T_a_b is None or a is None or b is None:
        return found
    variances = np.diag(found.covariance)
    by_scans = register_scans(
        a, b, found.T_a_b, settings, sigma_m=min(float(np.sqrt(variances[:3].max())), settings.max_translation_m),
        sigma_rad=min(float(np.sqrt(variances[3:].max())), settings.max_rotation_rad),
    )  # fmt: skip
    if by_scans.T_a_b is None:
        return refused(f"the scans: {by_scans.reason}", num_matches=found.num_matches, num_inliers=found.num_inliers)
    return Registration(
        T_a_b=by_scans.T_a_b, covariance=by_scans.covariance, num_matches=found.num_matches, num_inliers=found.num_inliers,
        matches=found.matches,
    )  # fmt: skip


def refined_motion(
    scans: Sequence[NodeScan | None], T_before_after: Floats, covariance: Floats, settings: ScanSettings
) -> tuple[Floats, Floats]:
    """Return the motion (4, 4) and its covariance (6, 6) between two nodes as their scans refine it (RGBD/NeighborLinkRefining).

    Where the scans do not match it comes back as it was, with more doubt.
    """
    before, after = scans
    if before is None or after is None:
        return T_before_after, covariance
    variances = np.diag(covariance)
    sigma_m, sigma_rad = float(np.sqrt(variances[:3].max())), float(np.sqrt(variances[3:].max()))
    found = register_scans(before, after, T_before_after, settings, sigma_m=sigma_m, sigma_rad=sigma_rad)
    if found.T_a_b is None:  # wheels slip, and clocks differ
        found = register_scans(
            before, after, T_before_after, settings, sigma_m=max(_WIDER_M, 3.0 * sigma_m),
            sigma_rad=max(_WIDER_RAD, 3.0 * sigma_rad),
        )  # fmt: skip
    return (T_before_after, _DOUBTED * covariance) if found.T_a_b is None else (found.T_a_b, found.covariance)


def registered(fit: ScanFit, covariance_factor: float) -> Registration:
    """Return a fit as a registration; its covariance counts `covariance_factor` times."""
    if fit.T_map_scan is None:
        return refused(fit.reason, num_matches=fit.num_points, num_inliers=fit.num_inliers)
    return Registration(
        T_a_b=fit.T_map_scan, covariance=covariance_factor * fit.covariance + fit.floor, num_matches=fit.num_points,
        num_inliers=fit.num_inliers, matches=np.zeros((0, 2), np.int64),
    )  # fmt: skip
