# SPDX-License-Identifier: MIT
"""A dense model on request: the images of the keyframes are read once more, and put where the keyframes are in the end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.formats.clouds import write_cloud
from slamcli.formats.meshes import write_mesh
from slamcli.geometry import se3
from slamcli.grids.depth_mesh import DepthFusion, Mesh
from slamcli.grids.voxel_means import VoxelMeans
from slamcli.measurements import PointCloud, RgbdFrame
from slamcli.pipelines.camera_input import CameraFeed
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.vision.dense_depth import DenseDepth
from slamcli.vision.preparation import Preparation

DenseKind = Literal["none", "cloud", "mesh"]
FILE = "dense.ply"


@dataclass(frozen=True, slots=True, kw_only=True)
class DenseChoices:
    """What dense model the user wants."""

    kind: DenseKind = "none"
    voxel_m: float = 0.02
    range_m: float = 5.0


def check_dense(choices: DenseChoices, cameras: CameraFeed | None) -> None:
    """Refuse a dense model of what has no depth images.

    Raises
    ------
    UsageError
        If the feed is none of colour with depth, or only its size was said.
    """
    if choices.kind == "none":
        if choices != DenseChoices():
            raise UsageError("--dense-voxel and --dense-range go with --dense cloud or --dense mesh")
        return
    if cameras is None:
        raise UsageError(f"--dense {choices.kind}: is made from depth images, for systems that see (--algo orbslam3)")
    if cameras.rig.mode != "rgbd":
        raise UsageError(f"--dense {choices.kind}: needs depth images (--mode rgbd), and this is {cameras.rig.mode}")


def dense_model(
    feed: CameraFeed, keyframes: Trajectory, choices: DenseChoices, map_frame: str, log: RunLog
) -> PointCloud | Mesh:
    """Return the dense model, map frame; memory grows with the place and not with the recording.

    Parameters
    ----------
    feed
        Where the frames came from; they are read again.
    keyframes
        Final poses of the base frame.
    """
    preparation = Preparation(feed.rig)
    dense = DenseDepth(preparation, choices.range_m)
    T_camera = preparation.T_base_camera
    if choices.kind == "mesh":
        camera = preparation.camera
        fusion = DepthFusion(choices.voxel_m, choices.range_m, (camera.fx, camera.fy, camera.cx, camera.cy))
        for frame, T_map_base in _keyframes(feed, keyframes, log):
            fusion.add(*dense.images(frame), se3.inverse(T_map_base @ T_camera))
        return fusion.mesh()
    means = VoxelMeans(choices.voxel_m)
    for frame, T_map_base in _keyframes(feed, keyframes, log):
        points, colours = dense.points(frame)
        T = T_map_base @ T_camera
        means.add(points @ T[:3, :3].T + T[:3, 3], colours)
    found, colours = means.means()
    return PointCloud(stamp_ns=int(keyframes.stamps_ns[0]), frame_id=map_frame, points_m=found, colours=colours)


def write_dense(folder: Path, model: PointCloud | Mesh) -> None:
    """Write ``dense.ply``."""
    if isinstance(model, PointCloud):
        write_cloud(folder / FILE, model)
    else:
        write_mesh(folder / FILE, model)


def _keyframes(feed: CameraFeed, keyframes: Trajectory, log: RunLog) -> Iterator[tuple[RgbdFrame, NDArray[np.float64]]]:
    """Yield the frames that became keyframes, with their poses T_map_base."""
    poses = dict(
        zip(
            keyframes.stamps_ns.tolist(),
            se3.from_position_quaternion(keyframes.positions_m, keyframes.quats_xyzw),
            strict=True,
        )
    )
    # What there is to say of the frames was said when they were read first.
    again = replace(feed, imu=None, accelerometer=None, log=RunLog(log.progress), _stamps_ns=[])
    for frame in again.measurements():
        if isinstance(frame, RgbdFrame) and frame.stamp_ns in poses:
            yield frame, poses[frame.stamp_ns]
