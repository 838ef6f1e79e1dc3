# SPDX-License-Identifier: MIT
"""One sweep to match: clouds of one or several sensors in the base frame, thinned, and unwarped with the robot's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer import _sweep_kernels as kernels
from slamcli.cartographer.pose_extrapolator_3d import from_rotation_vector, rotation_vector
from slamcli.geometry import quaternion, se3
from slamcli.measurements import PointCloud
from slamcli.registration.voxel_filter import voxel_filter

KNOT_NS = 5_000_000
"""Poses are interpolated between times this far apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """Points of one or several clouds, each where the base was when it was measured."""

    cloud_stamps_ns: NDArray[np.int64]
    """int64 (C,), of the clouds that it is made of."""
    begin_ns: int
    end_ns: int
    """When the first and the last point were measured; the pose of a sweep is that at its end."""
    points_m: NDArray[np.float32]
    """float32 (N, 3), base frame at each point's own time."""
    seconds: NDArray[np.float64]
    """float64 (N,), after `begin_ns`."""
    intensities: NDArray[np.float32]
    """float32 (N,), 0 where the sensor gives none."""
    origin_m: NDArray[np.float64]
    """float64 (3,), the first sensor in the base frame."""

    def knots_ns(self) -> NDArray[np.int64]:
        """Return times from the first to the last point, evenly spaced, int64 (K,), K >= 2."""
        count = max(2, (self.end_ns - self.begin_ns) // KNOT_NS + 1)
        return np.linspace(self.begin_ns, max(self.end_ns, self.begin_ns + 1), count).astype(np.int64)

    def unwarped(self, T_local_base: NDArray[np.float64], rows: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Return points float64 (N, 3) in the base frame at the end of the sweep, given the poses at its knots (K, 4, 4)."""
        points, seconds = (self.points_m, self.seconds) if rows is None else (self.points_m[rows], self.seconds[rows])
        shifts, quats = se3.to_position_quaternion(se3.inverse(T_local_base[-1]) @ T_local_base)
        knots = np.linspace(0.0, max(self.end_ns - self.begin_ns, 1) * 1e-9, len(T_local_base))
        out = np.empty(points.shape)
        kernels.unwarp(points, seconds, knots, quats, shifts, out)
        return out


def assemble(
    clouds: list[tuple[PointCloud, NDArray[np.float64]]], min_range_m: float, max_range_m: float, voxel_m: float
) -> Sweep:
    """Return one sweep of clouds and their mounts ``T_base_sensor`` (4, 4).

    Points that are not finite, or nearer or farther than the limits, are left out; the rest is thinned to one per voxel, in
    each sensor's frame. A cloud without times of its points counts as measured at its stamp.
    """
    points, times, intensities = [], [], []
    for cloud, T_base_sensor in clouds:
        kept = np.empty(len(cloud.points_m), dtype=np.int64)
        kept = kept[: kernels.in_range(cloud.points_m, min_range_m, max_range_m, kept)]
        kept = kept[voxel_filter(cloud.points_m[kept], voxel_m)]
        offsets = np.zeros(len(kept), dtype=np.int64) if cloud.offset_ns is None else cloud.offset_ns[kept]
        points.append(cloud.points_m[kept].astype(np.float64) @ T_base_sensor[:3, :3].T + T_base_sensor[:3, 3])
        times.append(cloud.stamp_ns + offsets)
        intensities.append(
            np.zeros(len(kept), dtype=np.float32) if cloud.intensities is None else cloud.intensities[kept]
        )
    stamps = np.array([cloud.stamp_ns for cloud, _ in clouds], dtype=np.int64)
    when = np.concatenate(times)
    begin = int(min(stamps.min(), when.min())) if len(when) else int(stamps.min())
    end = int(max(stamps.max(), when.max())) if len(when) else int(stamps.max())
    return Sweep(
        cloud_stamps_ns=stamps,
        begin_ns=begin,
        end_ns=end,
        points_m=np.concatenate(points).astype(np.float32),
        seconds=np.asarray((when - begin) * 1e-9, dtype=np.float64),
        intensities=np.concatenate(intensities),
        origin_m=clouds[0][1][:3, 3].copy(),
    )


def corrected(
    T_predicted: NDArray[np.float64], knots_ns: NDArray[np.int64], previous_ns: int, T_matched: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return poses (K, 4, 4) at the knots that end at the matched pose: predictions, corrected in proportion to time.

    At the time of the previous pose nothing is corrected (it was matched itself), at the last knot everything.
    """
    span = max(int(knots_ns[-1]) - previous_ns, 1)
    share = np.clip((knots_ns - previous_ns) / span, 0.0, 1.0)
    change = se3.inverse(T_predicted[-1]) @ T_matched
    turns = quaternion.to_matrix(from_rotation_vector(share[:, None] * rotation_vector(change[:3, :3])))
    out: NDArray[np.float64] = T_predicted.copy()
    # Shifts are corrected along the local frame's axes, so that a correction of the heading does not bend the path.
    out[:, :3, :3] = T_predicted[:, :3, :3] @ turns
    out[:, :3, 3] += share[:, None] * (T_matched[:3, 3] - T_predicted[-1, :3, 3])
    return out


def warm() -> None:
    """Compile the kernels of this module and of `imu_track`."""
    cloud = PointCloud(stamp_ns=0, frame_id="", points_m=np.ones((2, 3), dtype=np.float32))
    sweep = assemble([(cloud, np.eye(4))], 0.1, 10.0, 0.1)
    sweep.unwarped(np.broadcast_to(np.eye(4), (2, 4, 4)))
    kernels.integrate_rates(np.zeros(1), np.zeros((1, 3)), 0.0, np.ones(1), np.empty((1, 4)))
