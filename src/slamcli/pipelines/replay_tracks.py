# SPDX-License-Identifier: MIT
"""What a result has of each kind, with the time at which each part of it came to be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.measurements import CameraModel, FrameTransform


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanTrack:
    """Scans in the map, thinned: S scans with P points together."""

    stamps_ns: NDArray[np.int64]
    """int64 (S,), in recorded order."""
    pose_index: NDArray[np.int64]
    """int64 (S,), the pose of the trajectory at which each was made."""
    offsets: NDArray[np.int64]
    """int64 (S + 1,): the points of scan i are ``points_m[offsets[i]:offsets[i + 1]]``."""
    points_m: NDArray[np.float32]
    """float32 (P, 2), metres, map frame."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraphTrack:
    """Nodes (N) and edges (E) of a pose graph, where they ended."""

    KINDS: ClassVar[tuple[str, ...]] = ("sequence", "loop", "covisible")
    """What an edge is: from one node to the next, a closed loop (nearness in space included), or many points in common."""

    stamps_ns: NDArray[np.int64]
    """int64 (N,), when each node came to be."""
    positions_m: NDArray[np.float64]
    """float64 (N, 3), metres, map frame."""
    edges: NDArray[np.int64]
    """int64 (E, 2), places of both ends among the nodes."""
    kinds: NDArray[np.uint8]
    """uint8 (E,), places in `KINDS`."""
    edge_stamps_ns: NDArray[np.int64]
    """int64 (E,), when each edge can have come to be at the earliest: with its later end, or the end of the submap it leads to."""
    residual_m: NDArray[np.float64]
    """float64 (E,), how far the final poses are from what each edge says; NaN where nothing was measured, as of the next."""
    residual_rad: NDArray[np.float64]
    """float64 (E,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SubmapTrack:
    """Submaps (S) where they ended, in the order in which they were begun."""

    names: tuple[str, ...]
    begun_ns: NDArray[np.int64]
    """int64 (S,), stamp of the first node in each."""
    finished_ns: NDArray[np.int64]
    """int64 (S,), stamp of the last node in each."""
    outlines_m: NDArray[np.float64]
    """float64 (S, 4, 2), corners of what is known of each, metres, map frame; NaN where there is no grid."""
    heights_m: NDArray[np.float64]
    """float64 (S,), z of each in the map frame."""
    grids: tuple[OccupancyGrid | None, ...]
    """What each shows alone, turned into its place in the map by its origin; None in 3D."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovingFrame:
    """A frame that moves in its parent, at each of the N poses of a trajectory."""

    parent: str
    child: str
    T_parent_child: NDArray[np.float64]
    """float64 (N, 4, 4)."""
    known: NDArray[np.bool_]
    """bool (N,), where it is told."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameTrack:
    """The frames of the robot, such that a recording's own transforms fit to them where both are played."""

    moving: tuple[MovingFrame, ...]
    """From the map down: map to odometry and on to the robot, or map to robot where there is no odometry."""
    static: tuple[FrameTransform, ...]
    """Mounts of sensors."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplayImage:
    """A camera's image at a pose; it is read and decoded when it is asked for."""

    stamp_ns: int
    topic: str
    pose_index: int
    """Place of the pose in the trajectory."""
    frame_id: str
    T_base_camera: NDArray[np.float64]
    """float64 (4, 4), camera: z ahead, x right."""
    camera: CameraModel | None
    """Of the image as it was recorded."""
    load: Callable[[int], bytes] = field(repr=False)
    """The same as `jpeg`."""

    def jpeg(self, max_width: int = 640) -> bytes:
        """Return a JPEG that is no wider than `max_width` pixels; the same image gives the same bytes.

        Raises
        ------
        InputError
            If the recording has gone, or the image is damaged.
        """
        return self.load(max_width)
