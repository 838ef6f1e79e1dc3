# SPDX-License-Identifier: MIT
"""Absolute and relative pose errors (APE, also called ATE, and RPE), as evo defines them.

References
----------
J. Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, doi:10.1109/IROS.2012.6385773.
M. Grupp, "evo: Python package for the evaluation of odometry and SLAM", https://github.com/MichaelGrupp/evo.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from slamcli.errors import DataError, EstimationError, UsageError
from slamcli.evaluation.pairs import Pairs, find_pairs
from slamcli.evaluation.statistics import Statistics
from slamcli.evaluation.units import DeltaUnit, PoseRelation
from slamcli.geometry import se3
from slamcli.trajectory import Trajectory

_POINTS = (PoseRelation.POINT_DISTANCE, PoseRelation.POINT_DISTANCE_ERROR_RATIO)


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Errors of poses or of pairs of poses."""

    relation: PoseRelation
    errors: NDArray[np.float64]
    """float64 (K,), in `relation.unit`."""
    indices: NDArray[np.int64]
    """int64 (K,), the matched pose of each error; for pairs the second one."""

    @property
    def statistics(self) -> Statistics:
        """Statistics of the errors."""
        return Statistics.of(self.errors)


def absolute_errors(
    reference: Trajectory, estimate: Trajectory, relation: PoseRelation = PoseRelation.TRANS_PART
) -> PoseErrors:
    """Return the absolute pose errors of an aligned estimate.

    The error pose is ``E = inverse(T_estimate) @ T_reference``.

    Parameters
    ----------
    reference, estimate
        Trajectories of equal length whose poses belong together.
    relation
        What of E is measured.

    Raises
    ------
    UsageError
        If `relation` has no meaning for single poses.
    """
    _check_paired(reference, estimate)
    if relation is PoseRelation.POINT_DISTANCE_ERROR_RATIO:
        raise UsageError(f"{relation.value} compares distances between poses: it is a relative error only")
    if relation in (PoseRelation.TRANS_PART, PoseRelation.POINT_DISTANCE):
        errors = np.linalg.norm(estimate.positions_m - reference.positions_m, axis=1)
    else:
        errors = measure(se3.inverse(estimate.transforms) @ reference.transforms, relation)
    return PoseErrors(relation, errors, np.arange(len(errors)))


def relative_errors(
    reference: Trajectory,
    estimate: Trajectory,
    relation: PoseRelation = PoseRelation.TRANS_PART,
    *,
    delta: float = 1.0,
    unit: DeltaUnit = DeltaUnit.FRAMES,
    all_pairs: bool = False,
    rel_tol: float = 0.1,
    pairs_from_reference: bool = False,
) -> PoseErrors:
    """Return the relative pose errors over pairs of poses that are `delta` apart.

    For motions Q of the reference and P of the estimate over the same pair the error pose is ``E = inverse(Q) @ P``.

    Parameters
    ----------
    reference, estimate
        Trajectories of equal length whose poses belong together.
    relation
        What of E is measured.
    delta, unit, all_pairs, rel_tol
        Which pairs: see `slamcli.evaluation.pairs.find_pairs`.
    pairs_from_reference
        Find the pairs on the reference instead of the estimate.

    Raises
    ------
    UsageError
        If `delta` is out of range.
    EstimationError
        If no two poses are `delta` apart.
    """
    _check_paired(reference, estimate)
    source = reference if pairs_from_reference else estimate
    pairs = find_pairs(source, delta, unit, all_pairs=all_pairs, rel_tol=rel_tol)
    return pair_errors(reference, estimate, pairs, (relation,))[0]


def pair_errors(
    reference: Trajectory, estimate: Trajectory, pairs: Pairs, relations: Sequence[PoseRelation]
) -> tuple[PoseErrors, ...]:
    """Return the relative errors over given pairs (K, 2), measured in several ways; see :func:`relative_errors`."""
    first, second = pairs.T
    error_poses = None
    found = []
    for relation in relations:
        if relation in _POINTS:
            found.append(_distance_errors(reference, estimate, relation, pairs))
            continue
        if error_poses is None:
            motion_reference = _motions(reference.transforms, first, second)
            motion_estimate = _motions(estimate.transforms, first, second)
            error_poses = se3.inverse(motion_reference) @ motion_estimate
        found.append(PoseErrors(relation, measure(error_poses, relation), second))
    return tuple(found)


def measure(error_poses: NDArray[np.float64], relation: PoseRelation) -> NDArray[np.float64]:
    """Return a number per error pose (N, 4, 4): see `PoseRelation`."""
    if relation is PoseRelation.TRANS_PART:
        return np.linalg.norm(error_poses[:, :3, 3], axis=1)
    if relation is PoseRelation.FULL:
        return np.linalg.norm(error_poses - np.eye(4), axis=(1, 2))
    if relation is PoseRelation.ROT_PART:
        return np.linalg.norm(error_poses[:, :3, :3] - np.eye(3), axis=(1, 2))
    angles = Rotation.from_matrix(error_poses[:, :3, :3]).magnitude()
    return np.rad2deg(angles) if relation is PoseRelation.ANGLE_DEG else angles


def _motions(poses: NDArray[np.float64], first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.float64]:
    return se3.inverse(poses[first]) @ poses[second]


def _distance_errors(reference: Trajectory, estimate: Trajectory, relation: PoseRelation, pairs: Pairs) -> PoseErrors:
    first, second = pairs.T
    true = np.linalg.norm(reference.positions_m[first] - reference.positions_m[second], axis=1)
    found = np.linalg.norm(estimate.positions_m[first] - estimate.positions_m[second], axis=1)
    errors = np.abs(true - found)
    if relation is PoseRelation.POINT_DISTANCE:
        return PoseErrors(relation, errors, second)
    moved = true > 0
    if not moved.any():
        raise EstimationError("the reference does not move between any two poses: no ratio of distances")
    return PoseErrors(relation, errors[moved] / true[moved] * 100, second[moved])


def _check_paired(reference: Trajectory, estimate: Trajectory) -> None:
    if len(reference) != len(estimate) or not len(reference):
        raise DataError(
            f"pose errors: {len(reference)} reference poses and {len(estimate)} estimated ones are no pairs"
        )
