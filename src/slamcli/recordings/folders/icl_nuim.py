# SPDX-License-Identifier: MIT
"""ICL-NUIM (Handa et al., ICRA 2014), its TUM RGB-D compatible images: ``rgb/0.png``, ``depth/0.png``, ``*.gt.freiburg``.

There are no stamps: files and poses carry frame numbers, 30 Hz from 0. Depth is in 1/5000 m. The data set names fx 481.2,
fy -480, cx 319.5, cy 239.5: its world is left-handed with y up, and so are its poses. The images stand upright, so that
the camera is an ordinary one with fy = +480 in a world that is mirrored at the plane of x and z: the true poses are
mirrored likewise, S T S with S = diag(1, -1, 1).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from slamcli.errors import FormatError
from slamcli.formats import text_tables, trajectories
from slamcli.recordings.folders.camera_models import pinhole
from slamcli.recordings.folders.layout import DataFolder, Layout, Reading
from slamcli.recordings.folders.listings import ImageList, existing_images, numbered_images, text_size
from slamcli.recordings.folders.rgbd import FRAME, rgbd_streams
from slamcli.recordings.folders.truth import read_truth, truth_stream
from slamcli.trajectory import Trajectory

RATE_HZ = 30.0
UNITS_PER_M = 5000.0
_CAMERA = (481.2, 480.0, 319.5, 239.5)
_MIRROR = np.array([1.0, -1.0, 1.0])
_MIRROR_QUATERNION = np.array([-1.0, 1.0, -1.0, 1.0])
"""A rotation about an axis becomes, mirrored, the opposite one about the mirrored axis."""
_ASSOCIATIONS = "associations.txt"


def mirrored(trajectory: Trajectory) -> Trajectory:
    """Return poses of the mirrored world: y turned round in world and camera."""
    return replace(
        trajectory,
        positions_m=trajectory.positions_m * _MIRROR,
        quats_xyzw=trajectory.quats_xyzw * _MIRROR_QUATERNION,
        matrices=None,
    )


def _find(folder: Path) -> Path | None:
    if not (folder / "rgb").is_dir() or not numbered_images(folder / "rgb"):
        return None
    return folder if _truth_file(folder) is not None or _counts_frames(folder / _ASSOCIATIONS) else None


def _truth_file(folder: Path) -> Path | None:
    return next(iter(sorted(folder.glob("*.gt.freiburg"))), None)


def _counts_frames(path: Path) -> bool:
    """Return whether associations carry frame numbers where TUM's carry stamps."""
    try:
        row = next(iter(text_tables.read_rows(path, "associations")), None) if path.is_file() else None
    except FormatError:
        return False
    return row is not None and len(row.fields) == 4 and row.fields[0].isdecimal() and len(row.fields[0]) < 7


def _read(root: Path, reading: Reading) -> DataFolder:
    colour, depth = (_images(root / kind, reading) for kind in ("rgb", "depth"))
    reading.remark(
        "calibration: the one that ICL-NUIM publishes is taken (fx 481.2, fy 480, cx 319.5, cy 239.5); --camera-info (map: --camera) gives another"
    )
    streams = rgbd_streams(colour, depth, pinhole(FRAME, colour.size(), _CAMERA), UNITS_PER_M, reading)
    path = _truth_file(root)
    truth = None if path is None else read_truth(path, lambda file: trajectories.read_tum(file, unit="s"), reading)
    if truth is not None:
        reading.log.note(
            "ICL-NUIM's world is left-handed (it names fy -480): the true poses are mirrored at the plane of x and z, as the "
            "upright images are"
        )
        # The first column was read as seconds: it counts frames.
        stamps = np.round(truth.stamps_ns / RATE_HZ).astype(np.int64)
        streams.append(truth_stream(stamps, mirrored(truth)))
    texts = 0 if path is None else text_size(path)
    return DataFolder(root=root, streams=tuple(streams), size_bytes=texts + colour.size_bytes + depth.size_bytes)


def _images(folder: Path, reading: Reading) -> ImageList:
    found = numbered_images(folder)
    if not found:
        reading.damage.add(f"{folder}: there are no images in it")
    numbers = [number for number, _ in found]
    lacking = numbers[-1] - numbers[0] + 1 - len(numbers) if numbers else 0
    if lacking > 0:
        reading.damage.add(f"{folder}: {lacking} of {numbers[-1] - numbers[0] + 1} images are missing")
    stamps = [round(number * 1e9 / RATE_HZ) for number in numbers]
    return existing_images(stamps, [path for _, path in found], str(folder), reading.damage)


LAYOUT = Layout(
    name="ICL-NUIM folder",
    signs="rgb/0.png and depth/0.png with *.gt.freiburg or associations.txt",
    find=_find,
    read=_read,
)
