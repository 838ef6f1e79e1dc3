# SPDX-License-Identifier: MIT
"""What is kept of every frame, and where all of them were in the end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.loop_closing import Closure
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.vision.pose_optimisation import optimise_pose

_LEAST = 15
"""Points that must hold for a pose to be optimised again at the end."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackedFrame:
    """A frame by its pose beside a keyframe, and by what it saw."""

    number: int
    stamp_ns: int
    map_number: int
    """Which of the maps it is in."""
    reference: int
    """Keyframe of that map."""
    T_frame_reference: NDArray[np.float64]
    """float64 (4, 4)."""
    points: Ids
    """(M,), map points at that time."""
    pixels: NDArray[np.float64]
    """(M, 2)."""
    right: NDArray[np.float64]
    """(M,), NaN where unknown."""
    sigmas: NDArray[np.float64]
    """(M,)."""
    depth: NDArray[np.float16] | None = None
    """As `Frame.depth`."""


def tracked_frame(sparse_map: SparseMap, map_number: int, frame: Frame) -> TrackedFrame:
    """Return what is kept of a frame that was tracked."""
    rows = np.flatnonzero(frame.points >= 0)
    T_reference = sparse_map.T_camera_map[frame.reference]
    return TrackedFrame(
        number=frame.number,
        stamp_ns=frame.stamp_ns,
        map_number=map_number,
        reference=frame.reference,
        T_frame_reference=frame.T_camera_map @ np.linalg.inv(T_reference),
        points=frame.points[rows],
        pixels=frame.features.pixels[rows],
        right=frame.features.right[rows],
        sigmas=frame.features.sigmas[rows],
        depth=frame.depth,
    )


def after_merge(frame: TrackedFrame, closure: Closure, newest: int) -> TrackedFrame:
    """Return a frame in the numbers that keyframes and points have since the newest map took another one in."""
    if frame.map_number == closure.merged_map:
        return replace(frame, map_number=newest)
    if frame.map_number != newest:
        return frame
    beside = frame.T_frame_reference.copy()
    beside[:3, 3] *= closure.length_factor
    return replace(
        frame,
        reference=frame.reference + closure.keyframe_offset,
        points=frame.points + closure.point_offset,
        T_frame_reference=beside,
    )


def rescaled(frame: TrackedFrame, number: int, scale: float) -> TrackedFrame:
    """Return a frame after the lengths of map `number` became `scale` times as long."""
    if frame.map_number != number:
        return frame
    return replace(frame, T_frame_reference=scaled(frame.T_frame_reference, scale))


def scaled(T: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """Return a pose with `scale` times the translation."""
    out = T.copy()
    out[:3, 3] *= scale
    return out


def final_pose(
    sparse_map: SparseMap, poses: NDArray[np.float64], frame: TrackedFrame, *, refine: bool
) -> NDArray[np.float64]:
    """Return T_camera_map (4, 4) of a frame on the final map.

    Parameters
    ----------
    poses
        (K, 4, 4), `SparseMap.poses_of_all`.
    refine
        Whether its pose is optimised once more on the points as they are now, rather than only carried along with its keyframe.
    """
    carried = frame.T_frame_reference @ poses[frame.reference]
    if not refine:
        return carried
    ids = sparse_map.resolved(frame.points)
    rows = np.flatnonzero(ids >= 0)
    if len(rows) < _LEAST:
        return carried
    estimate = optimise_pose(
        carried,
        sparse_map.positions[ids[rows]],
        frame.pixels[rows],
        frame.right[rows],
        frame.sigmas[rows],
        sparse_map.camera,
    )
    return estimate.T_camera_map if estimate.inliers.sum() >= max(_LEAST, 0.5 * len(rows)) else carried
