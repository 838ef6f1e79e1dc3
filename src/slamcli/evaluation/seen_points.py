# SPDX-License-Identifier: MIT
"""What a recording's range sensor saw, and where a trajectory puts it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.trajectory import Trajectory, interpolate

_MOST_GAP_S = 0.5
_GAP_STEPS = 3.0
_FARTHEST_M = 1e6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenPoints:
    """Points that a sensor measured, thinned, view by view; a view is a scan, a cloud or a depth image."""

    stamps_ns: NDArray[np.int64]
    """int64 (S,), stamp of each view, in recorded order."""
    view: NDArray[np.int64]
    """int64 (P,), the view of each point."""
    points_m: NDArray[np.float32]
    """float32 (P, 3), in the sensor's frame, metres."""
    offset_ns: NDArray[np.int64]
    """int64 (P,), when each point was measured after its view's stamp."""
    frame_id: str
    """The sensor's frame."""
    topic: str
    planar: bool
    """Whether the sensor measures in one plane: figures are of x and y then."""

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points_m)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedPoints:
    """Points where a trajectory puts them."""

    points_m: NDArray[np.float64]
    """float64 (P, 3), in the frame of the trajectory, metres; z is 0 of planar points."""
    origins_m: NDArray[np.float64]
    """float64 (P, 3), where the sensor was when each was measured; z likewise."""
    stamps_ns: NDArray[np.int64]
    """int64 (P,), when each was measured."""
    planar: bool
    num_views: int
    """Views that have a pose."""

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points_m)

    def thinned(self, most: int) -> PlacedPoints:
        """Return every n-th point, so that there are at most `most`."""
        step = max(-(-len(self) // most), 1)
        return replace(
            self,
            points_m=self.points_m[::step].copy(),
            origins_m=self.origins_m[::step].copy(),
            stamps_ns=self.stamps_ns[::step].copy(),
        )


def place(seen: SeenPoints, trajectory: Trajectory, T_base_sensor: NDArray[np.float64]) -> PlacedPoints:
    """Return the points in the frame of a trajectory, each at the pose interpolated at its own time.

    Views farther from the nearest pose than half a second (or three steps of the trajectory, if that is more) have no pose, and
    their points are left out.

    Parameters
    ----------
    trajectory
        Poses of the base frame.
    T_base_sensor
        float64 (4, 4), the sensor's mount.

    Raises
    ------
    EstimationError
        If no view has a pose.
    """
    known = has_pose(seen.stamps_ns, trajectory)
    rows = np.flatnonzero(known[seen.view]) if len(seen.view) else np.zeros(0, dtype=np.int64)
    if not len(rows):
        raise EstimationError(
            f"{trajectory.source or 'the trajectory'}: no pose at the time of anything on {seen.topic}"
        )
    stamps = seen.stamps_ns[seen.view[rows]] + seen.offset_ns[rows]
    unique, which = np.unique(stamps, return_inverse=True)
    posed = interpolate(trajectory, unique)
    T = se3.from_position_quaternion(posed.positions_m, posed.quats_xyzw) @ T_base_sensor
    rotation, origin = T[:, :3, :3][which], T[:, :3, 3][which]
    points = np.einsum("nij,nj->ni", rotation, seen.points_m[rows].astype(np.float64)) + origin
    if seen.planar:
        points[:, 2] = 0.0
        origin = origin * (1.0, 1.0, 0.0)
    near = (np.abs(points) < _FARTHEST_M).all(axis=1)
    return PlacedPoints(
        points_m=np.ascontiguousarray(points[near]), origins_m=np.ascontiguousarray(origin[near]), stamps_ns=stamps[near],
        planar=seen.planar, num_views=int(known.sum()),
    )  # fmt: skip


def has_pose(stamps_ns: NDArray[np.int64], trajectory: Trajectory) -> NDArray[np.bool_]:
    """Return bool (N,): whether a trajectory has a pose within half a second (or three of its steps) of each stamp."""
    poses = np.unique(trajectory.stamps_ns)
    if len(poses) < 2:
        return np.zeros(len(stamps_ns), dtype=np.bool_)
    most = max(_MOST_GAP_S * 1e9, _GAP_STEPS * float(np.median(np.diff(poses))))
    after = np.clip(np.searchsorted(poses, stamps_ns), 1, len(poses) - 1)
    gap = np.minimum(np.abs(stamps_ns - poses[after - 1]), np.abs(poses[after] - stamps_ns))
    near: NDArray[np.bool_] = gap <= most
    return near
