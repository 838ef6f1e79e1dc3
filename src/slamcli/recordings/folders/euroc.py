# SPDX-License-Identifier: MIT
"""EuRoC (Burri et al., IJRR 2016), the ASL layout: ``mav0`` with ``cam0``, ``cam1``, ``imu0``, ground truth.

Each sensor's folder has a ``data.csv`` (nanoseconds first) and a ``sensor.yaml`` with its pose in the body frame, ``T_BS``;
cameras have their images in ``data``. Cameras are neither undistorted nor rectified. True poses are those of the body.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from slamcli.formats import trajectories
from slamcli.geometry import se3
from slamcli.measurements import FrameTransform
from slamcli.recordings.folders.camera_models import fixed_frame
from slamcli.recordings.folders.imu_rows import read_imu_rows
from slamcli.recordings.folders.layout import DataFolder, Layout, Reading
from slamcli.recordings.folders.listings import ImageList, listed_images, stamped_images, text_size
from slamcli.recordings.folders.sensor_files import SensorModel, read_sensor_yaml
from slamcli.recordings.folders.streams import CameraInfos, FixedFrames, ImageFiles, ImuNoiseText, Stream
from slamcli.recordings.folders.truth import read_truth, truth_stream

BODY = "body"
TRUTHS = ("state_groundtruth_estimate0", "mocap0", "vicon0")
"""Folders of ground truth, the best first (``leica0`` has positions only)."""

CalibrationReader = Callable[[Path, Reading], dict[str, SensorModel]]
"""From a data set's root: the calibration of each sensor by the name of its folder."""


def base_folder(folder: Path) -> Path:
    """Return where the sensors' folders lie: in ``mav0``, or in the folder itself."""
    return folder / "mav0" if (folder / "mav0").is_dir() else folder


def find(folder: Path) -> Path | None:
    """Return the folder if sensors in the ASL layout lie in it, None if not."""
    base = base_folder(folder)
    signs = ("cam0/data.csv", "cam0/data", "imu0/data.csv")
    return folder if any((base / sign).exists() for sign in signs) else None


def image_topic(sensor: str) -> str:
    """Return the topic of a camera's images."""
    return f"/{sensor}/image_raw/compressed"


def read(root: Path, reading: Reading, calibrations: CalibrationReader) -> DataFolder:
    """Look through a folder in the ASL layout."""
    base = base_folder(root)
    names = sorted(path.name for path in base.iterdir() if path.is_dir() and re.fullmatch(r"(cam|imu)\d+", path.name))
    models = calibrations(root, reading)
    streams: list[Stream] = []
    fixed: list[FrameTransform] = []
    size = 0
    for name in names:
        found, num_bytes = _sensor(base / name, models.get(name), reading)
        streams += found
        size += num_bytes
        model = models.get(name)
        if found and model is not None and model.T_body_sensor is not None:
            fixed.append(fixed_frame(BODY, name, model.T_body_sensor))
    filled = [stream for stream in streams if len(stream.stamps_ns)]
    if fixed and filled:
        first = min(int(stream.stamps_ns[0]) for stream in filled)
        streams.insert(0, FixedFrames(transforms=tuple(fixed), stamps_ns=np.array([first])))
    streams += _truth(base, reading)
    return DataFolder(root=root, streams=tuple(streams), size_bytes=size)


def _sensor(folder: Path, model: SensorModel | None, reading: Reading) -> tuple[list[Stream], int]:
    """Return the streams of a camera or an IMU, and their bytes."""
    name, table = folder.name, folder / "data.csv"
    if name.startswith("imu"):
        rows = read_imu_rows(table, f"/{name}", name, reading.damage)
        if rows is None:
            return [], 0
        noise = model.noise if model is not None else None
        texts = [] if noise is None else [ImuNoiseText.of(f"/{name}", noise, rows.stamps_ns[:1])]
        return [*texts, rows], text_size(table)
    images = _images(folder, reading)
    streams: list[Stream] = []
    if model is not None and model.camera is not None:
        streams.append(CameraInfos(topic=f"/{name}/camera_info", model=model.camera, stamps_ns=images.stamps_ns))
    elif len(images):
        reading.damage.add(f"{folder}: no calibration that can be read (sensor.yaml): --camera-info gives one")
    streams.append(ImageFiles(topic=image_topic(name), frame_id=name, stamps_ns=images.stamps_ns, paths=images.paths))
    return streams, images.size_bytes + text_size(table)


def _images(folder: Path, reading: Reading) -> ImageList:
    table = folder / "data.csv"
    if table.is_file():
        return listed_images(table, folder / "data", reading.damage)
    found = stamped_images(folder / "data", reading.damage)
    reading.damage.add(f"{table} is missing: {len(found)} images are stamped by their names")
    return found


def _calibrations(root: Path, reading: Reading) -> dict[str, SensorModel]:
    """Return the calibration in each sensor's ``sensor.yaml``."""
    return {
        path.parent.name: model
        for path in sorted(base_folder(root).glob("*/sensor.yaml"))
        if (model := read_sensor_yaml(path, reading.damage)) is not None
    }


def _truth(base: Path, reading: Reading) -> list[Stream]:
    """Return the true poses of the body; those of another sensor (a marker) are carried over to it."""
    for name in TRUTHS:
        path = base / name / "data.csv"
        trajectory = read_truth(path, trajectories.read_euroc, reading) if path.is_file() else None
        if trajectory is None:
            continue
        model = read_sensor_yaml(path.with_name("sensor.yaml"), reading.damage)
        T_body_sensor = None if model is None else model.T_body_sensor
        if T_body_sensor is None or np.array_equal(T_body_sensor, np.eye(4)):
            return [truth_stream(trajectory.stamps_ns, trajectory)]
        positions, quats = se3.to_position_quaternion(trajectory.transforms @ se3.inverse(T_body_sensor))
        return [truth_stream(trajectory.stamps_ns, replace(trajectory, positions_m=positions, quats_xyzw=quats))]
    return []


def _read(root: Path, reading: Reading) -> DataFolder:
    return read(root, reading, _calibrations)


LAYOUT = Layout(name="EuRoC folder", signs="mav0/cam0/data.csv", find=find, read=_read)
