# SPDX-License-Identifier: MIT
"""Every frame or scan that was given, with its pose by odometry, and which of them became nodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.frame_poses import frame_poses
from slamcli.rtabmap.node_input import OdometryStep

Floats = NDArray[np.float64]


class PlacedFrames(NamedTuple):
    """Frames with poses in the map."""

    rows: NDArray[np.int64]
    """int64 (F,), increasing: which of all frames."""
    stamps_ns: NDArray[np.int64]
    T_map_base: Floats
    """float64 (F, 4, 4)."""


class FrameTrack:
    """Grows by a frame at a time. A stretch is what odometry followed without beginning anew."""

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self._poses: list[Floats | None] = []
        self._stretches: list[int] = []
        self._node_rows: dict[int, int] = {}
        self.num_stretches = 0
        self.num_carried = 0
        """Frames on which the recording's odometry stood in for own odometry, which was lost."""
        self.refined = False
        """Whether poses were replaced by better ones."""

    def add(self, step: OdometryStep, *, begins: bool) -> None:
        """Take the next frame; `begins`: a stretch begins with it."""
        self.num_stretches += begins
        self.num_carried += step.carried
        self.stamps_ns.append(step.stamp_ns)
        self._poses.append(step.T_odom_base)
        self._stretches.append(self.num_stretches - 1)

    def mark_node(self, node_id: int) -> None:
        """Note that the last frame became a node."""
        self._node_rows[node_id] = len(self.stamps_ns) - 1

    @property
    def num_lost(self) -> int:
        """Frames without a pose by odometry."""
        return sum(pose is None for pose in self._poses)

    @property
    def has_pose(self) -> NDArray[np.bool_]:
        """Bool (F,), whether odometry knew where each frame was."""
        return np.array([pose is not None for pose in self._poses], dtype=np.bool_)

    def refine(self, stamps_ns: NDArray[np.int64], T_odom_base: Floats) -> None:
        """Replace poses by better ones of the same odometry, found by their stamps; others stay."""
        self.refined = True
        better = dict(zip(stamps_ns.tolist(), T_odom_base, strict=True))
        self._poses = [
            better.get(stamp, pose) if pose is not None else None
            for stamp, pose in zip(self.stamps_ns, self._poses, strict=True)
        ]

    def node_pose(self, node_id: int) -> Floats | None:
        """Return the pose by odometry (4, 4) of a node of this run, as it is known by now; None for other nodes."""
        row = self._node_rows.get(node_id)
        return None if row is None else self._poses[row]

    def placed(self, T_map_node: Mapping[int, Floats]) -> PlacedFrames:
        """Return the frames of all stretches that have at least one node with a pose in the map."""
        rows_of: dict[int, list[int]] = {}
        for row, pose in enumerate(self._poses):
            if pose is not None:
                rows_of.setdefault(self._stretches[row], []).append(row)
        nodes_of: dict[int, list[int]] = {}
        for node_id, row in self._node_rows.items():
            if node_id in T_map_node:
                nodes_of.setdefault(self._stretches[row], []).append(node_id)
        found_rows, found_poses = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 4, 4))]
        for stretch, node_ids in sorted(nodes_of.items()):
            rows = np.array(rows_of[stretch], dtype=np.int64)
            poses = np.array([self._poses[row] for row in rows])
            ordered = sorted(node_ids, key=self._node_rows.__getitem__)
            at = np.searchsorted(rows, [self._node_rows[node_id] for node_id in ordered])
            placed = np.array([T_map_node[node_id] for node_id in ordered])
            stamps = np.array([self.stamps_ns[row] for row in rows], dtype=np.int64)
            found_rows.append(rows)
            found_poses.append(frame_poses(stamps, poses, at, placed))
        chosen, poses = np.concatenate(found_rows), np.concatenate(found_poses)
        stamps = np.array(self.stamps_ns, dtype=np.int64)[chosen]
        return PlacedFrames(chosen, stamps, poses)
