# SPDX-License-Identifier: MIT
"""A dense model on request: the images of the keyframes once more, put where the keyframes are in the end."""

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
from slamcli.formats.textured_meshes import write_textured
from slamcli.geometry import se3
from slamcli.grids.depth_mesh import EMPTY, DepthFusion, Mesh
from slamcli.grids.voxel_means import VoxelMeans
from slamcli.measurements import PointCloud, RgbdFrame
from slamcli.pipelines.camera_input import CameraFeed
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.vision.dense_depth import DenseDepth, usable_depth
from slamcli.vision.posed_view import DepthViews, PosedView
from slamcli.vision.preparation import Preparation
from slamcli.vision.texturing import TexturedMesh, textured

DenseKind = Literal["none", "cloud", "mesh", "texture"]
DenseModel = PointCloud | Mesh | TexturedMesh
FILE = "dense.ply"
_TOLERANCE_VOXELS = 3.0
"""How far the depth of a view may lie from the mesh that takes its colours from it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DenseChoices:
    """What dense model the user wants."""

    kind: DenseKind = "none"
    voxel_m: float = 0.02
    range_m: float = 5.0


def check_dense(choices: DenseChoices, cameras: CameraFeed | None, *, remembered: bool) -> None:
    """Refuse a dense model of what has no depth images.

    Parameters
    ----------
    cameras
        The cameras of the recording that are used; None: none, or what is mapped is a memory of an earlier run.
    remembered
        Whether the system keeps the images of its nodes itself; the depth of a stereo pair is found then.

    Raises
    ------
    UsageError
        If there is no depth, or only the size of the model was said.
    """
    if choices.kind == "none":
        if choices != DenseChoices():
            raise UsageError("--dense-voxel and --dense-range go with --dense cloud, mesh or texture")
        return
    if cameras is None:
        if not remembered:
            raise UsageError(
                f"--dense {choices.kind}: is made from depth images, for systems that see (--algo orbslam3, --algo rtabmap)"
            )
        return
    usable = ("rgbd", "stereo") if remembered else ("rgbd",)
    if cameras.rig.mode not in usable:
        wanted = "depth images or a stereo pair" if remembered else "depth images (--mode rgbd)"
        raise UsageError(f"--dense {choices.kind}: needs {wanted}, and this is {cameras.rig.mode}")


def dense_model(
    feed: CameraFeed, keyframes: Trajectory, choices: DenseChoices, map_frame: str, log: RunLog
) -> DenseModel:
    """Return the dense model of frames that are read again, map frame; memory grows with the place and not with the recording.

    Parameters
    ----------
    feed
        Where the frames came from.
    keyframes
        Final poses of the base frame.
    """
    preparation = Preparation(feed.rig)
    dense = DenseDepth(preparation, choices.range_m)
    if choices.kind != "cloud":
        return model_of_views(_KeyframeViews(feed, keyframes, preparation, dense, log), choices, map_frame, 0)
    T_camera = preparation.T_base_camera
    means = VoxelMeans(choices.voxel_m)
    for frame, T_map_base in _keyframes(feed, keyframes, log):
        points, colours = dense.points(frame)
        T = T_map_base @ T_camera
        means.add(points @ T[:3, :3].T + T[:3, 3], colours)
    found, colours = means.means()
    return PointCloud(stamp_ns=int(keyframes.stamps_ns[0]), frame_id=map_frame, points_m=found, colours=colours)


def model_of_views(views: DepthViews, choices: DenseChoices, map_frame: str, stamp_ns: int) -> DenseModel:
    """Return the dense model of posed views, gone through once, for a texture three times; empty where none shows anything."""
    if choices.kind == "cloud":
        means = VoxelMeans(choices.voxel_m)
        for view in views:
            points, colours = _points(view, usable_depth(view.depth, choices.range_m))
            means.add(points, colours)
        found, colours = means.means()
        return PointCloud(stamp_ns=stamp_ns, frame_id=map_frame, points_m=found, colours=colours)
    fusion: DepthFusion | None = None
    for view in views:
        camera = view.camera
        if fusion is None:
            fusion = DepthFusion(choices.voxel_m, choices.range_m)
        intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
        fusion.add(usable_depth(view.depth, choices.range_m), view.colour, intrinsics, se3.inverse(view.T_map_camera))
    mesh = fusion.mesh() if fusion is not None else EMPTY
    return textured(mesh, views, _TOLERANCE_VOXELS * choices.voxel_m) if choices.kind == "texture" else mesh


def is_empty(model: DenseModel) -> bool:
    """Return whether nothing is in a model."""
    return len(model.points_m if isinstance(model, PointCloud) else model.triangles) == 0


def _points(view: PosedView, depth: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return the points (N, 3) of a view, map frame, and their colours (N, 3)."""
    row, column = np.nonzero(depth)
    pixels = np.column_stack([column, row]).astype(np.float64)
    T = view.T_map_camera
    points = view.camera.back_project(pixels, depth[row, column].astype(np.float64)) @ T[:3, :3].T + T[:3, 3]
    return points, view.colour[row, column]


@dataclass(frozen=True, slots=True)
class _KeyframeViews:
    """Views of keyframes; the recording is read again whenever they are gone through."""

    feed: CameraFeed
    keyframes: Trajectory
    preparation: Preparation
    dense: DenseDepth
    log: RunLog

    def __iter__(self) -> Iterator[PosedView]:
        for frame, T_map_base in _keyframes(self.feed, self.keyframes, self.log):
            depth, colour = self.dense.images(frame)
            yield PosedView(colour, depth, self.preparation.camera, T_map_base @ self.preparation.T_base_camera)


def write_dense(folder: Path, model: DenseModel) -> None:
    """Write ``dense.ply``, of a mesh with pictures ``dense.obj`` and what belongs to it."""
    if isinstance(model, PointCloud):
        write_cloud(folder / FILE, model)
    elif isinstance(model, TexturedMesh):
        write_textured(folder / "dense.obj", model)
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
