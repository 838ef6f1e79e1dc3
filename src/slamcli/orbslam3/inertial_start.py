# SPDX-License-Identifier: MIT
"""A visual map is aligned with its IMU: metres, gravity, velocities, biases (Campos et al., T-RO 2021, section V-B)."""

from __future__ import annotations

import numpy as np

from slamcli.errors import EstimationError
from slamcli.orbslam3.inertial_state import Imu, MapInertia
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.posegraph.imu_clock import clock_offset
from slamcli.posegraph.inertial_alignment import (
    AlignmentSettings,
    InertialAlignment,
    VisualPoses,
    align_inertial,
    objection,
)

_LEAST_KEYFRAMES = 10
_LEAST_S, _LEAST_S_WITH_DEPTH = 2.0, 1.0
_MOST_KEYFRAMES = 50
"""Keyframes, the newest ones, that an alignment looks at."""
_POSITION_SHARE = 1e-3
"""Deviation of a keyframe's position over the depth of what it sees: a third of a pixel over a hundred points and a drift."""
_SCALE_SIGMA = 0.02
"""Relative deviation up to which a scale is taken."""
_LEAST_OFFSET_S, _LEAST_GAIN = 0.002, 0.3
"""Clocks are put right where they are off by more, and rotations then agree better by that share."""


def align_map(sparse_map: SparseMap, inertia: MapInertia, imu: Imu, *, last: bool = False) -> float | None:
    """Try to align a map; return metres per unit of the map as it was, or None if it is too early (`inertia.objection`).

    The map is in metres afterwards and `inertia` knows gravity, velocities and biases. With many keyframes only every fourth is
    worth the try, unless it is the `last`.
    """
    living = sparse_map.living_keyframes
    living = living[np.argsort(sparse_map.stamp_ns[living], kind="stable")]
    chosen = living[-_MOST_KEYFRAMES:]
    seconds = float(sparse_map.stamp_ns[chosen[-1]] - sparse_map.stamp_ns[chosen[0]]) * 1e-9
    least_s = _LEAST_S_WITH_DEPTH if imu.fixed_scale else _LEAST_S
    if len(chosen) < _LEAST_KEYFRAMES or seconds < least_s:
        needed = f"{_LEAST_KEYFRAMES} keyframes within at least {least_s:.0f} s are needed"
        inertia.objection = f"not enough motion: {needed}, there are {len(chosen)} within {seconds:.1f} s"
        return None
    if len(living) > 2 * _LEAST_KEYFRAMES and len(living) % 4 and not last:
        return None
    poses = _poses(sparse_map, chosen, imu)
    set_clock(sparse_map, imu)
    try:
        found = align_inertial(
            poses, imu.buffer.samples(int(poses.stamps_ns[0])), imu.noise,
            AlignmentSettings(fixed_scale=imu.fixed_scale, position_sigma=_POSITION_SHARE * _depth(sparse_map, chosen)),
        )  # fmt: skip
    except EstimationError as error:
        inertia.objection = str(error)
        return None
    inertia.objection = objection(found, log_scale_sigma=_SCALE_SIGMA)
    if inertia.objection:
        return None
    if not imu.fixed_scale:
        scale_map(sparse_map, found.scale)
    _take_over(sparse_map, inertia, imu, living, chosen, found)
    return found.scale


def set_clock(sparse_map: SparseMap, imu: Imu) -> None:
    """Put the IMU's clock right where its rotations say surely that it is off the camera's; finer where it was off before."""
    keyframes = sparse_map.living_keyframes
    chosen = keyframes[np.argsort(sparse_map.stamp_ns[keyframes], kind="stable")][-_MOST_KEYFRAMES:]
    poses = _poses(sparse_map, chosen, imu)
    offset = clock_offset(poses, imu.buffer.samples(int(poses.stamps_ns[0]) - 100_000_000), imu.noise)
    least_s, gain = (_LEAST_OFFSET_S, _LEAST_GAIN) if not imu.buffer.offset_ns else (0.25 * _LEAST_OFFSET_S, 0.0)
    if abs(offset.seconds) > max(least_s, 5 * offset.sigma_s) and offset.gain > gain:
        imu.buffer.shift(round(offset.seconds * 1e9))


def scale_map(sparse_map: SparseMap, scale: float) -> None:
    """Make all lengths of a map `scale` times as long, about its origin."""
    sparse_map.positions[:] *= scale
    sparse_map.T_camera_map[:, :3, 3] *= scale
    sparse_map.T_camera_parent[:, :3, 3] *= scale
    sparse_map.refresh_points(np.flatnonzero(sparse_map.point_alive))


def _poses(sparse_map: SparseMap, keyframes: Ids, imu: Imu) -> VisualPoses:
    return VisualPoses(
        stamps_ns=sparse_map.stamp_ns[keyframes].copy(),
        rotations=np.ascontiguousarray(sparse_map.T_camera_map[keyframes, :3, :3].transpose(0, 2, 1)),
        positions=sparse_map.centres[keyframes], T_camera_imu=imu.T_camera_imu,
    )  # fmt: skip


def _depth(sparse_map: SparseMap, keyframes: Ids) -> float:
    """Return the median depth of the points that the keyframes see, in units of the map."""
    depths = []
    for k in keyframes.tolist():
        ids = sparse_map.points_of(np.array([k]))
        T = sparse_map.T_camera_map[k]
        depths.append(sparse_map.positions[ids] @ T[2, :3] + T[2, 3])
    return max(float(np.median(np.concatenate(depths))), 1e-9)


def _take_over(
    sparse_map: SparseMap, inertia: MapInertia, imu: Imu, living: Ids, chosen: Ids, found: InertialAlignment
) -> None:
    """Write the alignment down; older keyframes get the velocities of their positions."""
    inertia.gravity_map = found.gravity_map
    inertia.began_ns, inertia.adjusted = int(sparse_map.stamp_ns[chosen[-1]]), 0
    inertia.version = sparse_map.version
    if len(living) > len(chosen):
        T = sparse_map.T_camera_map[living]
        places = np.einsum("kji,kj->ki", T[:, :3, :3], imu.T_camera_imu[:3, 3] - T[:, :3, 3])
        speeds = np.gradient(places, sparse_map.stamp_ns[living] * 1e-9, axis=0)
        inertia.set(sparse_map, living, speeds, np.tile(found.biases, (len(living), 1)))
    inertia.set(sparse_map, chosen, found.velocities, np.tile(found.biases, (len(chosen), 1)))
