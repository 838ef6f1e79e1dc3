# SPDX-License-Identifier: MIT
"""Lays an estimated trajectory on its reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.errors import UsageError
from slamcli.evaluation.units import AlignMode
from slamcli.geometry import alignment, quaternion
from slamcli.geometry.alignment import Similarity
from slamcli.trajectory import Matched, Trajectory


def align(matched: Matched, mode: AlignMode, *, num_poses: int = -1) -> tuple[Trajectory, Similarity]:
    """Return the aligned estimate and the transform that was found.

    Parameters
    ----------
    matched
        Poses that belong together.
    mode
        See `AlignMode`.
    num_poses
        How many poses from the start the alignment is found from; -1 takes all.

    Raises
    ------
    EstimationError
        If the positions do not determine the transform.
    UsageError
        If `num_poses` is too small for the mode.
    """
    found = _find(matched, mode, num_poses)
    applied = Similarity(np.eye(3), np.zeros(3), found.scale) if mode is AlignMode.SCALE else found
    return transformed(matched.estimate, applied), found


def transformed(trajectory: Trajectory, transform: Similarity) -> Trajectory:
    """Return a trajectory in the target frame of a transform; positions are scaled, rotations are not."""
    poses = transform.transform_poses(trajectory.transforms)
    return replace(
        trajectory,
        positions_m=poses[:, :3, 3].copy(),
        quats_xyzw=quaternion.from_matrix(poses[:, :3, :3]),
        matrices=poses,
    )


def _find(matched: Matched, mode: AlignMode, num_poses: int) -> Similarity:
    if num_poses != -1 and num_poses < 1:
        raise UsageError(f"cannot align on {num_poses} poses: give -1 for all or at least 1")
    n = len(matched) if num_poses == -1 else min(num_poses, len(matched))
    source, target = matched.estimate, matched.reference
    if mode is AlignMode.NONE:
        return Similarity(np.eye(3), np.zeros(3))
    if mode is AlignMode.ORIGIN or (mode is AlignMode.SE3 and num_poses == 1):
        return alignment.pose_to_pose(source.transforms[0], target.transforms[0])
    if mode is AlignMode.POSYAW:
        if num_poses == 1:
            return alignment.yaw_and_position_of_pose(source.transforms[0], target.transforms[0])
        return alignment.yaw_and_position(source.positions_m[:n], target.positions_m[:n])
    with_scale = mode in (AlignMode.SIM3, AlignMode.SCALE)
    return alignment.umeyama(source.positions_m[:n], target.positions_m[:n], with_scale=with_scale)
