# SPDX-License-Identifier: MIT
"""The relations metric: relative poses of a trajectory against true ones (Kümmerle et al. 2009).

References
----------
R. Kümmerle, B. Steder, C. Dornhege, M. Ruhnke, G. Grisetti, C. Stachniss and A. Kleiner, "On measuring the accuracy of SLAM
algorithms", Autonomous Robots 27(4), 2009, doi:10.1007/s10514-009-9155-6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError, UsageError
from slamcli.evaluation.statistics import Statistics
from slamcli.geometry import quaternion, se2
from slamcli.trajectory import Trajectory
from slamcli.trajectory.trajectory import seconds


@dataclass(frozen=True, slots=True, eq=False)
class Relations:
    """True poses at `second_ns` seen from the poses at `first_ns`."""

    first_ns: NDArray[np.int64]
    """int64 (K,), nanoseconds."""
    second_ns: NDArray[np.int64]
    """int64 (K,), nanoseconds."""
    translations_m: NDArray[np.float64]
    """float64 (K, 3), metres."""
    angles_rad: NDArray[np.float64]
    """float64 (K, 3), roll, pitch and yaw in radians."""
    source: str = ""

    def __post_init__(self) -> None:
        k = len(self.first_ns)
        if self.second_ns.shape != (k,) or self.translations_m.shape != (k, 3) or self.angles_rad.shape != (k, 3):
            raise DataError(
                f"relations: {k} and {self.second_ns.shape} stamps, {self.translations_m.shape} translations,"
                f" {self.angles_rad.shape} angles"
            )
        if not (np.isfinite(self.translations_m).all() and np.isfinite(self.angles_rad).all()):
            raise DataError("relations: a relation is not finite")

    def __len__(self) -> int:
        return len(self.first_ns)

    @property
    def planar(self) -> NDArray[np.float64]:
        """float64 (K, 3), x, y, yaw."""
        return np.column_stack([self.translations_m[:, :2], self.angles_rad[:, 2]])


@dataclass(frozen=True, slots=True, eq=False)
class RelationsResult:
    """Errors of a trajectory over relations."""

    num_relations: int
    matched: NDArray[np.bool_]
    """bool (K,), whether both times of a relation have a pose near them."""
    trans_m: NDArray[np.float64]
    """float64 (M,), absolute translational error of the matched relations, metres."""
    rot_rad: NDArray[np.float64]
    """float64 (M,), absolute rotational error of the matched relations, radians, in [0, pi]."""

    @property
    def num_matched(self) -> int:
        """Number of relations that could be compared."""
        return int(self.matched.sum())

    @property
    def trans(self) -> Statistics:
        """Statistics of the absolute translational error, metres."""
        return Statistics.of(self.trans_m)

    @property
    def rot_deg(self) -> Statistics:
        """Statistics of the absolute rotational error, degrees."""
        return Statistics.of(np.degrees(self.rot_rad))

    @property
    def trans_squared(self) -> Statistics:
        """Statistics of the squared translational error, square metres."""
        return Statistics.of(self.trans_m**2)

    @property
    def rot_squared_deg(self) -> Statistics:
        """Statistics of the squared rotational error, square degrees."""
        return Statistics.of(np.degrees(self.rot_rad) ** 2)


def relation_errors(trajectory: Trajectory, relations: Relations, *, max_gap_s: float = 0.5) -> RelationsResult:
    """Return the errors of a planar trajectory over relations.

    The pose at a relation's time is interpolated between the two poses next to it in time (x, y and the unwrapped yaw
    each linearly). A time with no pose within `max_gap_s` is unmatched.

    Parameters
    ----------
    trajectory
        Poses in any order; of poses with one stamp the first counts. Height, roll and pitch are left aside.
    relations
        What is true.
    max_gap_s
        Largest distance in time from a relation's time to the nearest pose, seconds.

    Raises
    ------
    EstimationError
        If the trajectory has fewer than two poses.
    UsageError
        If the trajectory has no stamps.

    Notes
    -----
    For a relation delta* between poses x_i and x_j the error is ``delta (-) delta*`` (eq. 4 and 5 of the paper), the pose
    ``inverse(delta*) @ delta``; its translation and its angle are summed up apart.
    """
    if not trajectory.timed:
        raise UsageError(f"{trajectory.source or 'the trajectory'} has no stamps: relations are given by time")
    times, first = np.unique(trajectory.stamps_s, return_index=True)
    if len(times) < 2:
        raise EstimationError("relations need a trajectory of at least two poses")
    positions = trajectory.positions_m[first]
    yaw = np.unwrap(quaternion.yaw(trajectory.quats_xyzw[first]))
    poses_i, near_i = _poses_at(seconds(relations.first_ns), times, positions, yaw, max_gap_s)
    poses_j, near_j = _poses_at(seconds(relations.second_ns), times, positions, yaw, max_gap_s)
    matched = near_i & near_j
    error = se2.between(relations.planar[matched], se2.between(poses_i[matched], poses_j[matched]))
    return RelationsResult(len(relations), matched, np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2]))


def _poses_at(
    at: NDArray[np.float64],
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    yaw: NDArray[np.float64],
    max_gap_s: float,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    right = np.clip(np.searchsorted(times, at), 0, len(times) - 1)
    left = np.clip(right - 1, 0, len(times) - 1)
    gap = np.minimum(np.abs(times[right] - at), np.abs(times[left] - at))
    poses = [np.interp(at, times, positions[:, 0]), np.interp(at, times, positions[:, 1]), np.interp(at, times, yaw)]
    return np.column_stack(poses), gap <= max_gap_s
