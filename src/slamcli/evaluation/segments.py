# SPDX-License-Identifier: MIT
"""Drift over segments of the true path: the KITTI odometry measure, and the sub-trajectories of rpg_trajectory_evaluation.

References
----------
A. Geiger, P. Lenz and R. Urtasun, "Are we ready for autonomous driving?", CVPR 2012, doi:10.1109/CVPR.2012.6248074.
Z. Zhang and D. Scaramuzza, "A tutorial on quantitative trajectory evaluation for visual(-inertial) odometry", IROS 2018,
doi:10.1109/IROS.2018.8593941.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from slamcli.errors import UsageError
from slamcli.evaluation.statistics import Statistics
from slamcli.geometry import se3
from slamcli.trajectory import Trajectory, path_lengths

KITTI_LENGTHS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
SUBTRAJECTORY_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5)

_KITTI_STEP = 10
_LENGTH_TOLERANCE = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class KittiErrors:
    """Errors per metre over segments of fixed lengths."""

    length_m: NDArray[np.float64]
    """float64 (K,), nominal length of each segment, metres."""
    first: NDArray[np.int64]
    """int64 (K,), pose at which each segment starts."""
    trans_percent: NDArray[np.float64]
    """float64 (K,), translational error over length, percent."""
    rot_deg_per_m: NDArray[np.float64]
    """float64 (K,), rotational error over length, degrees per metre."""


def kitti_errors(
    reference: Trajectory,
    estimate: Trajectory,
    *,
    lengths_m: Sequence[float] = KITTI_LENGTHS_M,
    step: int = _KITTI_STEP,
) -> KittiErrors:
    """Return the errors over segments as the development kit of the KITTI odometry benchmark measures them.

    From every `step`-th pose, for each length, the segment ends at the first pose whose distance along the true path is more
    than that length away. Its error pose is ``inverse(estimated motion) @ true motion``; translation and angle are divided by
    the nominal length. No alignment plays a part.

    Parameters
    ----------
    reference, estimate
        Trajectories of equal length whose poses belong together.
    lengths_m
        Lengths of segments, metres.
    step
        A segment starts at every `step`-th pose.

    Returns
    -------
    KittiErrors
        Of no segments, where the path is shorter than every length.
    """
    along = path_lengths(reference.positions_m)
    starts = np.arange(0, len(along), step, dtype=np.int64)
    rows = []
    for length in _checked(lengths_m):
        ends = np.searchsorted(along, along[starts] + length, side="right")
        fits = ends < len(along)
        rows.append((starts[fits], ends[fits], np.full(int(fits.sum()), length)))
    first, last, nominal = (np.concatenate(column) for column in zip(*rows, strict=True))
    error = se3.inverse(_motions(estimate, first, last)) @ _motions(reference, first, last)
    trans = np.linalg.norm(error[:, :3, 3], axis=1)
    return KittiErrors(nominal, first, trans / nominal * 100, np.degrees(_angles(error)) / nominal)


@dataclass(frozen=True, slots=True, eq=False)
class SubtrajectoryErrors:
    """Relative errors over all sub-trajectories of one length; names as rpg_trajectory_evaluation's."""

    length_m: float
    rel_trans: NDArray[np.float64]
    """float64 (K,), norm of the translational error, metres."""
    rel_rot: NDArray[np.float64]
    """float64 (K,), angle of the rotational error, degrees."""
    rel_yaw: NDArray[np.float64]
    """float64 (K,), absolute yaw of the rotational error about the estimate's world z axis, degrees."""
    rel_gravity: NDArray[np.float64]
    """float64 (K,), root of the squares of pitch and roll of the rotational error in the estimate's world, degrees."""

    def statistics(self) -> dict[str, Statistics]:
        """Return the statistics of each error, of ``rel_trans_perc`` (percent of length) and ``rel_rot_deg_per_m`` too."""
        return {
            "rel_trans": Statistics.of(self.rel_trans),
            "rel_trans_perc": Statistics.of(self.rel_trans / self.length_m * 100),
            "rel_rot": Statistics.of(self.rel_rot),
            "rel_rot_deg_per_m": Statistics.of(self.rel_rot / self.length_m),
            "rel_yaw": Statistics.of(self.rel_yaw),
            "rel_gravity": Statistics.of(self.rel_gravity),
        }


def subtrajectory_lengths(reference: Trajectory) -> tuple[float, ...]:
    """Return 10, 20, 30, 40 and 50 % of the length of the true path, metres, cut to centimetres."""
    return tuple(
        length for share in SUBTRAJECTORY_SHARES if (length := math.trunc(share * reference.length_m * 100) / 100) > 0
    )


def subtrajectory_errors(
    reference: Trajectory, estimate: Trajectory, lengths_m: Sequence[float], *, scale: float = 1.0
) -> tuple[SubtrajectoryErrors, ...]:
    """Return the relative errors over sub-trajectories as rpg_trajectory_evaluation defines them.

    From every pose the sub-trajectory ends at the pose whose distance along the true path comes nearest to the length; it
    counts if it comes nearer than 20 % of the length. The error pose ``inverse(true motion) @ estimated motion``, which is
    seen from the end pose, is turned into the estimate's world frame, so that its yaw and its tilt mean something.

    Parameters
    ----------
    reference, estimate
        Trajectories of equal length whose poses belong together; the estimate in its own world frame, not aligned.
    lengths_m
        Lengths of sub-trajectories, metres: see `subtrajectory_lengths`.
    scale
        Factor on the estimate's translations (found by a Sim(3) alignment).

    Returns
    -------
    tuple
        One record per length for which there are at least two sub-trajectories.
    """
    along = path_lengths(reference.positions_m)
    found = []
    for length in _checked(lengths_m):
        first, last = _nearest_ends(along, length)
        if len(first) < 2:
            continue
        motion = _motions(estimate, first, last)
        motion[:, :3, 3] *= scale
        error = se3.inverse(_motions(reference, first, last)) @ motion
        world = estimate.transforms[last][:, :3, :3]
        rotation = world @ error[:, :3, :3] @ world.swapaxes(1, 2)
        yaw = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
        pitch = np.arctan2(-rotation[:, 2, 0], np.hypot(rotation[:, 0, 0], rotation[:, 1, 0]))
        roll = np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
        found.append(
            SubtrajectoryErrors(
                length,
                rel_trans=np.linalg.norm(error[:, :3, 3], axis=1),
                rel_rot=np.degrees(_angles(error)),
                rel_yaw=np.degrees(np.abs(yaw)),
                rel_gravity=np.degrees(np.hypot(pitch, roll)),
            )
        )
    return tuple(found)


def _nearest_ends(along: NDArray[np.float64], length: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    target = along + length
    above = np.clip(np.searchsorted(along, target), 0, len(along) - 1)
    below = np.searchsorted(along, along[np.maximum(above - 1, 0)])  # the first of poses at one place
    off_below, off_above = np.abs(along[below] - target), np.abs(along[above] - target)
    last = np.where(off_below <= off_above, below, above)
    near = np.minimum(off_below, off_above) < _LENGTH_TOLERANCE * length
    return np.flatnonzero(near), last[near]


def _motions(trajectory: Trajectory, first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.float64]:
    poses = trajectory.transforms
    return se3.inverse(poses[first]) @ poses[last]


def _angles(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return Rotation.from_matrix(poses[:, :3, :3]).magnitude() if len(poses) else np.zeros(0)


def _checked(lengths_m: Sequence[float]) -> Sequence[float]:
    for length in lengths_m:
        if not (math.isfinite(length) and length > 0):
            raise UsageError(f"segment length {length:g} m must be a positive number")
    if not lengths_m:
        raise UsageError("no segment lengths given")
    return lengths_m
