# SPDX-License-Identifier: MIT
"""7-Scenes (Shotton et al., CVPR 2013): ``frame-000000.color.png``, ``.depth.png`` and ``.pose.txt`` in one folder.

There are no stamps: frames are 30 Hz, the first at 0. Depth is in millimetres, 0 and 65535 are none. Poses are those of
the camera in the world of KinectFusion. The data set names one calibration for all: 585 px, centre 320, 240.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion
from slamcli.measurements import CameraModel
from slamcli.recordings.folders.camera_models import pinhole
from slamcli.recordings.folders.layout import DataFolder, Layout, Reading
from slamcli.recordings.folders.listings import ImageList, existing_images, file_sizes, numbered_images
from slamcli.recordings.folders.rgbd import FRAME, rgbd_streams
from slamcli.recordings.folders.streams import Stream
from slamcli.recordings.folders.truth import truth_stream
from slamcli.trajectory import Trajectory

RATE_HZ = 30.0
UNITS_PER_M = 1000.0
_NOMINAL = (585.0, 585.0, 320.0, 240.0)
_CALIBRATION = "camera-intrinsics.txt"
_ORTHOGONAL = 0.01


def _find(folder: Path) -> Path | None:
    return folder if numbered_images(folder, r"frame-(\d+)\.color") else None


def _read(root: Path, reading: Reading) -> DataFolder:
    colour = _images(root, "color", reading)
    depth = _images(root, "depth", reading)
    if not len(depth):
        reading.damage.add(f"{root}: no depth images (frame-000000.depth.png)")
    streams = rgbd_streams(colour, depth, _camera(root, colour.size(), reading), UNITS_PER_M, reading)
    streams += _truth(root, reading)
    sizes = file_sizes(root)
    return DataFolder(root=root, streams=tuple(streams), size_bytes=sum(sizes.values()))


def frame_stamp_ns(number: int) -> int:
    """Return the stamp of a frame by its number."""
    return round(number * 1e9 / RATE_HZ)


def _images(root: Path, kind: str, reading: Reading) -> ImageList:
    found = numbered_images(root, rf"frame-(\d+)\.{kind}")
    numbers = [number for number, _ in found]
    holes = [a + 1 for a, b in itertools.pairwise(numbers) if b > a + 1]
    if holes:
        lacking = numbers[-1] - numbers[0] + 1 - len(set(numbers))
        reading.damage.add(
            f"{root}: {lacking} of {numbers[-1] - numbers[0] + 1} {kind} images are missing "
            f"(first: frame-{holes[0]:06d}.{kind})"
        )
    return existing_images(
        [frame_stamp_ns(number) for number in numbers], [path for _, path in found], str(root), reading.damage
    )


def _camera(root: Path, size: tuple[int, int], reading: Reading) -> CameraModel:
    path = root / _CALIBRATION
    if path.is_file():
        try:
            k = np.loadtxt(path, dtype=np.float64, max_rows=3)
            if k.shape == (3, 3) and np.isfinite(k).all() and k[0, 0] > 0 and k[1, 1] > 0:
                return pinhole(FRAME, size, (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
        except (OSError, ValueError):
            pass
        reading.damage.add(f"{path}: no 3 x 3 matrix of a camera; the data set's nominal one is taken instead")
    reading.remark(
        "calibration: the nominal one of 7-Scenes is taken (fx = fy = 585, cx 320, cy 240); --camera-info (map: --camera) gives another"
    )
    return pinhole(FRAME, size, _NOMINAL)


def _truth(root: Path, reading: Reading) -> list[Stream]:
    names = sorted(name for name in file_sizes(root) if name.startswith("frame-") and name.endswith(".pose.txt"))
    stamps, poses, wrong = [], [], []
    for name in names:
        number = name.removeprefix("frame-").removesuffix(".pose.txt")
        pose = _pose(root / name)
        if pose is None or not number.isdecimal():
            wrong.append(name)
            continue
        stamps.append(frame_stamp_ns(int(number)))
        poses.append(pose)
    if wrong:
        reading.damage.add(f"{root}: {len(wrong)} of {len(names)} poses are none and are left out (first: {wrong[0]})")
    if not poses:
        return []
    T_world_camera = np.array(poses)
    trajectory = Trajectory(
        np.array(stamps, dtype=np.int64),
        T_world_camera[:, :3, 3].copy(),
        quaternion.from_matrix(T_world_camera[:, :3, :3]),
    )
    return [truth_stream(trajectory.stamps_ns, trajectory)]


def _pose(path: Path) -> NDArray[np.float64] | None:
    try:
        values = np.array(path.read_text(encoding="ascii").split(), dtype=np.float64)
    except (OSError, ValueError):
        return None
    if values.size != 16 or not np.isfinite(values).all():
        return None
    pose = values.reshape(4, 4)
    rotation = np.clip(pose[:3, :3], -10.0, 10.0)  # whose squares do not overflow
    is_rotation = np.abs(rotation @ rotation.T - np.eye(3)).max() < _ORTHOGONAL and np.linalg.det(rotation) > 0
    return pose if is_rotation else None


LAYOUT = Layout(name="7-Scenes folder", signs="frame-000000.color.png", find=_find, read=_read)
