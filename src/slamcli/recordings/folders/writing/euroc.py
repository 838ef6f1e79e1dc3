# SPDX-License-Identifier: MIT
"""The text files of an EuRoC folder (the ASL layout)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.formats.trajectories import write_euroc
from slamcli.measurements import CameraModel
from slamcli.recordings.folders.writing.exported import Exported, ExportedCamera, ExportedImu

_MODELS = {
    "plumb_bob": "radial-tangential",
    "": "radial-tangential",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
}
_IMU_HEADER = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)


def finish(exported: Exported) -> None:
    """Write ``data.csv`` and ``sensor.yaml`` of every sensor, and the ground truth, under ``mav0``."""
    for camera in exported.cameras:
        _write_camera(exported, camera)
    if exported.imu is not None:
        _write_imu(exported.root / "mav0" / "imu0", exported.imu)
    if exported.truth is not None:
        folder = exported.root / "mav0" / "state_groundtruth_estimate0"
        folder.mkdir(parents=True)
        write_euroc(folder / "data.csv", exported.truth)
        _write(folder / "sensor.yaml", ["sensor_type: visual-inertial", *_pose(np.eye(4))])


def _write_camera(exported: Exported, camera: ExportedCamera) -> None:
    folder = exported.root / camera.folder
    lines = [f"{stamp},{name}" for stamp, name in sorted(camera.frames)]
    _write(folder.parent / "data.csv", ["#timestamp [ns],filename", *lines])
    model = camera.model
    if model is None:
        return
    if model.distortion_model not in _MODELS or len(model.distortion) > 5:
        exported.log.warn(
            f"{folder.parent.name}: the distortion model {model.distortion_model} ({len(model.distortion)} coefficients) has no "
            "name in EuRoC's sensor.yaml: the calibration is left out"
        )
        return
    lines = ["sensor_type: camera", *_pose(camera.T_body_camera), *_intrinsics(model)]
    stamps = sorted(stamp for stamp, _ in camera.frames)
    if len(stamps) > 1:
        lines.append(f"rate_hz: {1e9 / float(np.median(np.diff(stamps)) or 1e9):.6g}")
    _write(folder.parent / "sensor.yaml", lines)


def _intrinsics(model: CameraModel) -> list[str]:
    k = model.intrinsics
    coefficients = model.distortion.tolist()
    if model.distortion_model in ("", "plumb_bob"):
        coefficients = (coefficients + [0.0] * 4)[:4] if not any(coefficients[4:]) else coefficients
    return [
        f"resolution: [{model.width}, {model.height}]",
        "camera_model: pinhole",
        f"intrinsics: [{k[0, 0].item()!r}, {k[1, 1].item()!r}, {k[0, 2].item()!r}, {k[1, 2].item()!r}]",
        f"distortion_model: {_MODELS[model.distortion_model]}",
        f"distortion_coefficients: [{', '.join(map(repr, coefficients))}]",
    ]


def _write_imu(folder: Path, imu: ExportedImu) -> None:
    folder.mkdir(parents=True)
    values = np.array(imu.values).reshape(-1, 6).tolist()
    with (folder / "data.csv").open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(_IMU_HEADER + "\n")
        for stamp, row in zip(imu.stamps_ns, values, strict=True):
            stream.write(f"{stamp},{','.join(map(repr, row))}\n")
    lines = ["sensor_type: imu", *_pose(imu.T_body_imu)]
    if imu.noise is not None:
        lines += [
            f"rate_hz: {imu.noise.frequency_hz!r}",
            f"gyroscope_noise_density: {imu.noise.gyroscope!r}",
            f"gyroscope_random_walk: {imu.noise.gyroscope_walk!r}",
            f"accelerometer_noise_density: {imu.noise.accelerometer!r}",
            f"accelerometer_random_walk: {imu.noise.accelerometer_walk!r}",
        ]
    _write(folder / "sensor.yaml", lines)


def _pose(T_body_sensor: NDArray[np.float64]) -> list[str]:
    rows = [", ".join(map(repr, row)) for row in T_body_sensor.tolist()]
    return ["T_BS:", "  cols: 4", "  rows: 4", f"  data: [{(',' + chr(10) + '         ').join(rows)}]"]


def _write(path: Path, lines: list[str]) -> None:
    head = ["%YAML:1.0"] if path.suffix == ".yaml" else []
    path.write_text("\n".join([*head, *lines]) + "\n", encoding="utf-8", newline="\n")
