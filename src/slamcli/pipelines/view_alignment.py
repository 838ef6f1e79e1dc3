# SPDX-License-Identifier: MIT
"""Lays trajectories of different frames over each other, so that they can be drawn in one picture."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from slamcli.errors import SlamcliError
from slamcli.geometry import alignment, se3
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.trajectory.association import associate

Alignment = Literal["auto", "fit", "start", "none"]
ALIGNMENTS: tuple[Alignment, ...] = ("auto", "fit", "start", "none")
_MOST_APART_S = 0.1


def laid_over(base: Trajectory, name: str, other: Trajectory, how: Alignment, log: RunLog) -> tuple[str, Trajectory]:
    """Return the other trajectory in the frame of `base`, and its name with a word on how it was laid there.

    ``fit`` moves it rigidly to the least squared distance (Umeyama 1991), ``start`` lays its first common pose on that of
    `base`, ``none`` leaves it. What has no common times stays as it is, with a note.
    """
    if how == "none" or not (len(base) and len(other)):
        return name, other
    try:
        matched = associate(base, other, max_diff_s=_MOST_APART_S, method="interpolation")
        if how == "start":
            first = int(np.argmin(matched.estimate.stamps_ns))
            found = alignment.pose_to_pose(matched.estimate.transforms[first], matched.reference.transforms[first])
        else:
            found = alignment.umeyama(matched.estimate.positions_m, matched.reference.positions_m)
    except SlamcliError as error:
        log.note(f"{name} is drawn as it is: {error}")
        return name, other
    positions, quats = se3.to_position_quaternion(found.transform_poses(other.transforms))
    moved = replace(other, positions_m=positions, quats_xyzw=quats, frame_id=base.frame_id, matrices=None)
    return f"{name}, {'fitted' if how != 'start' else 'from the same start'}", moved
