# SPDX-License-Identifier: MIT
"""KITTI odometry (Geiger et al., CVPR 2012): ``image_0`` to ``image_3``, ``times.txt``, ``calib.txt``, poses.

All cameras are rectified: grey left and right (0, 1), colour left and right (2, 3). ``calib.txt`` holds ``P0`` to ``P3``,
``P_i = K [I | t_i]`` seen from camera 0. True poses are those of camera 0: ``poses.txt`` in the folder, or
``poses/NN.txt`` beside ``sequences/NN``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.formats import text_tables, trajectories
from slamcli.measurements import CameraModel, FrameTransform
from slamcli.recordings.folders.camera_models import fixed_frame, pinhole
from slamcli.recordings.folders.layout import DataFolder, Layout, Reading
from slamcli.recordings.folders.listings import ImageList, existing_images, numbered_images, text_size
from slamcli.recordings.folders.streams import CameraInfos, FixedFrames, ImageFiles, Stream
from slamcli.recordings.folders.truth import read_truth, truth_stream

CAMERAS = {"image_0": "gray/left", "image_1": "gray/right", "image_2": "color/left", "image_3": "color/right"}
"""Name space of the topics by folder."""
_PARTNERS = {"image_1": "image_0", "image_3": "image_2"}
RATE_HZ = 10.0


def image_topic(folder: str) -> str:
    """Return the topic of a folder's images."""
    return f"/{CAMERAS[folder]}/image_rect{'_color' * CAMERAS[folder].startswith('color')}/compressed"


def frame_of(folder: str) -> str:
    """Return the frame of a folder's camera."""
    return CAMERAS[folder].replace("/", "_")


def _find(folder: Path) -> Path | None:
    return folder if any(numbered_images(folder / name) for name in CAMERAS) else None


def _read(root: Path, reading: Reading) -> DataFolder:
    stamps = _stamps(root, reading)
    images = {name: _images(root / name, stamps, reading) for name in CAMERAS if (root / name).is_dir()}
    images = {name: found for name, found in images.items() if len(found)}
    matrices = _projections(root, reading)
    streams: list[Stream] = []
    fixed: list[FrameTransform] = []
    for name, found in images.items():
        camera = _camera(name, found.size(), matrices)
        if camera is None:
            reading.damage.add(f"{root}: calib.txt has no P{name[-1]}: {name} has no calibration (--camera-info)")
        else:
            topic = f"/{CAMERAS[name]}/camera_info"
            streams.append(CameraInfos(topic=topic, model=camera, stamps_ns=found.stamps_ns))
            if name != "image_0":
                T_zero_camera = np.eye(4)
                T_zero_camera[:3, 3] = -_offset(matrices[name])
                fixed.append(fixed_frame(frame_of("image_0"), frame_of(name), T_zero_camera))
        streams.append(
            ImageFiles(topic=image_topic(name), frame_id=frame_of(name), stamps_ns=found.stamps_ns, paths=found.paths)
        )
    if fixed:
        first = min(stream.stamps_ns[0] for stream in streams)
        streams.insert(0, FixedFrames(transforms=tuple(fixed), stamps_ns=np.array([first])))
    poses = _poses_file(root)
    streams += _truth(poses, stamps, reading) if poses is not None else []
    size = text_size(root / "calib.txt", root / "times.txt") + sum(found.size_bytes for found in images.values())
    return DataFolder(root=root, streams=tuple(streams), size_bytes=size + (text_size(poses) if poses else 0))


def _stamps(root: Path, reading: Reading) -> NDArray[np.int64]:
    """Return the stamps in ``times.txt``, int64 (N,); of 10 Hz from 0 where there is none."""
    path = root / "times.txt"
    try:
        if path.is_file():
            return trajectories.read_times(path)
        why = f"{path} is missing"
    except FormatError as error:
        why = str(error)
    count = 1 + max((number for name in CAMERAS for number, _ in numbered_images(root / name)), default=-1)
    reading.damage.add(f"{why}: images are taken as {RATE_HZ:g} Hz from 0")
    return np.round(np.arange(count) * 1e9 / RATE_HZ).astype(np.int64)


def _images(folder: Path, stamps_ns: NDArray[np.int64], reading: Reading) -> ImageList:
    found = numbered_images(folder)
    late = [path for number, path in found if number >= len(stamps_ns)]
    if late:
        reading.damage.add(f"{folder}: {len(late)} images have no line in times.txt (first: {late[0].name})")
    numbers = {number for number, _ in found}
    lacking = [number for number in range(len(stamps_ns)) if number not in numbers]
    if lacking and found:
        name = f"{lacking[0]:0{len(found[0][1].stem)}d}"
        reading.damage.add(f"{folder}: {len(lacking)} of {len(stamps_ns)} images are missing (first: {name})")
    kept = [(int(stamps_ns[number]), path) for number, path in found if number < len(stamps_ns)]
    return existing_images([stamp for stamp, _ in kept], [path for _, path in kept], str(folder), reading.damage)


def _projections(root: Path, reading: Reading) -> dict[str, NDArray[np.float64]]:
    """Return the projection matrices, float64 (3, 4), by folder of images."""
    path = root / "calib.txt"
    found: dict[str, NDArray[np.float64]] = {}
    if not path.is_file():
        reading.damage.add(f"{path} is missing: the cameras have no calibration (--camera-info gives one)")
        return found
    try:
        for row in text_tables.read_rows(path, "a KITTI calibration"):
            name = row.fields[0].rstrip(":")
            if name not in ("P0", "P1", "P2", "P3"):
                continue
            values = text_tables.parse_numbers(row.fields[1:], path, row.line)
            if len(values) == 12 and values[0] > 0 and values[5] > 0 and values[10] != 0:
                found[f"image_{name[1]}"] = np.array(values).reshape(3, 4)
            else:
                reading.damage.add(f"{path}, line {row.line}: {name} is no 3 x 4 projection matrix of a camera")
    except FormatError as error:
        reading.damage.add(str(error))
    return found


def _offset(projection: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return t of ``P = K [I | t]``, float64 (3,), metres: the camera sits at -t in camera 0."""
    return np.asarray(np.linalg.solve(projection[:, :3], projection[:, 3]), dtype=np.float64)


def _camera(name: str, size: tuple[int, int], matrices: Mapping[str, NDArray[np.float64]]) -> CameraModel | None:
    """Return a rectified camera; its ``P[0, 3]`` is -fx times the distance to the left camera of its pair (ROS)."""
    projection = matrices.get(name)
    if projection is None:
        return None
    partner = matrices.get(_PARTNERS.get(name, ""))
    shift = 0.0
    if partner is not None:
        plain = not partner[:, 3].any() and projection[2, 3] == 0  # no detour: the same number as in the file
        apart_m = (_offset(projection) - _offset(partner))[0]
        shift = float(projection[0, 3] if plain else apart_m * projection[0, 0])
    k = projection[:, :3]
    return pinhole(frame_of(name), size, (k[0, 0], k[1, 1], k[0, 2], k[1, 2]), shift_px=shift)


def _poses_file(root: Path) -> Path | None:
    number = root.resolve().name
    above = root.resolve().parent
    places = (root / "poses.txt", above.parent / "poses" / f"{number}.txt", above / "poses" / f"{number}.txt")
    return next((path for path in places if path.is_file()), None)


def _truth(path: Path, stamps_ns: NDArray[np.int64], reading: Reading) -> list[Stream]:
    trajectory = read_truth(path, trajectories.read_kitti, reading)
    if trajectory is None:
        return []
    if len(trajectory) != len(stamps_ns):
        reading.damage.add(
            f"{path}: {len(trajectory)} poses for {len(stamps_ns)} stamps; they are taken from the first on"
        )
    number = min(len(trajectory), len(stamps_ns))
    return [truth_stream(stamps_ns[:number], trajectory.select(np.arange(number)))] if number else []


LAYOUT = Layout(name="KITTI odometry folder", signs="image_0 with times.txt and calib.txt", find=_find, read=_read)
