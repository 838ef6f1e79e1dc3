# SPDX-License-Identifier: MIT
"""TUM RGB-D (Sturm et al., IROS 2012): ``rgb.txt``, ``depth.txt``, ``groundtruth.txt`` and the images that they name.

Depth is in 1/5000 m, registered to colour. The folders hold no calibration: the data set publishes one for each of its
three Kinects, which a folder names (``freiburg1`` or ``fr1``). A ``camera_info.yaml`` in the folder (ROS's
camera_calibration) goes before that. ``associations.txt`` is not needed.
"""

from __future__ import annotations

import re
from pathlib import Path

from slamcli.errors import CalibrationError
from slamcli.formats import trajectories
from slamcli.measurements import CameraModel
from slamcli.recordings.calibration_file import read_camera_info
from slamcli.recordings.folders.camera_models import in_frame, pinhole
from slamcli.recordings.folders.layout import DataFolder, Layout, Reading
from slamcli.recordings.folders.listings import (
    ImageList,
    has_stamped_images,
    listed_images,
    lists_images,
    stamped_images,
    text_size,
)
from slamcli.recordings.folders.rgbd import FRAME, rgbd_streams
from slamcli.recordings.folders.truth import read_truth, truth_stream

UNITS_PER_M = 5000.0
CALIBRATION = "camera_info.yaml"
_PUBLISHED = {
    "1": ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "2": ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "3": ((535.4, 539.2, 320.1, 247.6), ()),
}
"""Colour cameras of the data set's page: fx, fy, cx, cy and k1, k2, p1, p2, k3 (the images of fr3 are undistorted)."""
_NOMINAL = (525.0, 525.0, 319.5, 239.5)
"""ROS's for a Kinect, which the data set recommends where nothing else is known."""
_NOMINAL_SIZE = (640, 480)


def _find(folder: Path) -> Path | None:
    if any(lists_images(folder / f"{kind}.txt") for kind in ("rgb", "depth")):
        return folder
    if not (folder / "rgb").is_dir():
        return None
    return folder if (folder / "groundtruth.txt").is_file() or has_stamped_images(folder / "rgb") else None


def _read(root: Path, reading: Reading) -> DataFolder:
    colour, depth = (_images(root, kind, reading) for kind in ("rgb", "depth"))
    streams = rgbd_streams(colour, depth, _camera(root, colour.size(), reading), UNITS_PER_M, reading)
    path = root / "groundtruth.txt"
    truth = read_truth(path, trajectories.read_tum, reading) if path.is_file() else None
    if truth is not None:
        streams.append(truth_stream(truth.stamps_ns, truth))
    texts = text_size(*(root / f"{name}.txt" for name in ("rgb", "depth", "groundtruth")))
    return DataFolder(root=root, streams=tuple(streams), size_bytes=texts + colour.size_bytes + depth.size_bytes)


def _images(root: Path, kind: str, reading: Reading) -> ImageList:
    path = root / f"{kind}.txt"
    if path.is_file():
        return listed_images(path, root, reading.damage)
    found = stamped_images(root / kind, reading.damage)
    how = f"the images in {kind} are stamped by their names" if len(found) else f"there are no {kind} images"
    reading.damage.add(f"{path} is missing: {how}")
    return found


def _camera(root: Path, size: tuple[int, int], reading: Reading) -> CameraModel | None:
    path = root / CALIBRATION
    if path.is_file():
        try:
            return in_frame(read_camera_info(path), FRAME)
        except CalibrationError as error:
            reading.damage.add(str(error))
    resolved = root.resolve()
    for name in (resolved.name, resolved.parent.name):
        number = re.search(r"(?:freiburg|(?<![a-z])fr)([123])(?![0-9])", name.lower())
        if number:
            reading.remark(
                f"calibration: the one that TUM RGB-D publishes for freiburg{number[1]}, which {name} names, is taken; "
                "--camera-info (map: --camera) gives another"
            )
            return pinhole(FRAME, size, *_PUBLISHED[number[1]])
    if size != _NOMINAL_SIZE:
        reading.log.warn(f"{root}: no calibration in the folder, and its name tells no camera: give --camera-info")
        return None
    reading.remark(
        f"{root}: no calibration in the folder, and its name tells no camera: the nominal one of a Kinect is taken "
        "(fx = fy = 525, cx 319.5, cy 239.5); --camera-info (map: --camera) gives another",
        doubtful=True,
    )
    return pinhole(FRAME, size, _NOMINAL)


LAYOUT = Layout(name="TUM RGB-D folder", signs="rgb.txt and depth.txt", find=_find, read=_read)
