# SPDX-License-Identifier: MIT
"""Tiny data-set folders."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 64, 48


def picture(number: int, channels: int = 3) -> NDArray[np.uint8]:
    """Return an image that differs from number to number, uint8 (48, 64) or (48, 64, 3)."""
    rng = np.random.default_rng(number)
    shape = (HEIGHT, WIDTH) if channels == 1 else (HEIGHT, WIDTH, channels)
    return rng.integers(0, 256, shape, dtype=np.uint8)


def depth_values(number: int) -> NDArray[np.uint16]:
    """Return raw depth, uint16 (48, 64), with one 0 and one 65535."""
    values = (1000 + 10 * number + np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)).astype(np.uint16)
    values[0, 0], values[0, 1] = 0, 65535
    return values


def write_image(path: Path, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write an image file, with the folders that it lies in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels)


def seven_scenes(folder: Path, num: int = 4) -> Path:
    """Write a 7-Scenes sequence that moves 0.1 m a frame along x."""
    for number in range(num):
        write_image(folder / f"frame-{number:06d}.color.png", picture(number))
        write_image(folder / f"frame-{number:06d}.depth.png", depth_values(number))
        pose = np.eye(4)
        pose[0, 3] = 0.1 * number
        (folder / f"frame-{number:06d}.pose.txt").write_text(
            "\n".join("\t".join(map(str, row)) for row in pose.tolist())
        )
    return folder


def tum(folder: Path, num: int = 4) -> Path:
    """Write a TUM RGB-D sequence of 30 Hz whose depth comes 7 ms after colour."""
    lists: dict[str, list[str]] = {"rgb": ["# color images", "# timestamp filename"], "depth": ["# depth maps"]}
    truth = ["# timestamp tx ty tz qx qy qz qw"]
    for number in range(num):
        for kind, pixels, late in (("rgb", picture(number), 0.0), ("depth", depth_values(number), 0.007)):
            stamp = f"{1305031102.175304 + number / 30 + late:.6f}"
            write_image(folder / kind / f"{stamp}.png", pixels)
            lists[kind].append(f"{stamp} {kind}/{stamp}.png")
        truth.append(f"{1305031102.18 + number / 30:.4f} {0.1 * number:.4f} 0 1 0 0 0 1")
    for kind, lines in lists.items():
        (folder / f"{kind}.txt").write_text("\n".join(lines) + "\n")
    (folder / "groundtruth.txt").write_text("\n".join(truth) + "\n")
    return folder


def kitti(folder: Path, num: int = 4, cameras: tuple[int, ...] = (0, 1)) -> Path:
    """Write a KITTI sequence of 10 Hz; the baseline of both pairs is 0.5 m, colour sits 0.06 m left of grey."""
    for camera in cameras:
        for number in range(num):
            write_image(
                folder / f"image_{camera}" / f"{number:06d}.png", picture(10 * camera + number, 1 + 2 * (camera > 1))
            )
    lines = []
    for camera, x in enumerate((0.0, -0.5, 0.06, -0.44)):
        lines.append(f"P{camera}: 700 0 32 {700 * x!r} 0 700 24 0 0 0 1 0")
    (folder / "calib.txt").write_text("\n".join([*lines, "Tr: " + " ".join(["0"] * 12)]) + "\n")
    (folder / "times.txt").write_text("".join(f"{0.1 * number:.6e}\n" for number in range(num)))
    (folder / "poses.txt").write_text("".join(f"1 0 0 0 0 1 0 0 0 0 1 {number}\n" for number in range(num)))
    return folder


def _sensor_yaml(kind: str, T_body_sensor: NDArray[np.float64], more: str) -> str:
    data = ", ".join(map(repr, T_body_sensor.reshape(-1).tolist()))
    return f"%YAML:1.0\nsensor_type: {kind}\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{data}]\n{more}"


def shifted(x: float, y: float, z: float) -> NDArray[np.float64]:
    """Return a translation, float64 (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def euroc(folder: Path, num: int = 4) -> Path:
    """Write an EuRoC sequence of 20 Hz with an IMU of 200 Hz; cam1 sits 0.1 m right of cam0."""
    base, start = folder / "mav0", 1403715273262142976
    stamps = [start + number * 50_000_000 for number in range(num)]
    for camera in (0, 1):
        lines = ["#timestamp [ns],filename"]
        for number, stamp in enumerate(stamps):
            write_image(base / f"cam{camera}" / "data" / f"{stamp}.png", picture(10 * camera + number, 1))
            lines.append(f"{stamp},{stamp}.png")
        (base / f"cam{camera}" / "data.csv").write_text("\r\n".join(lines) + "\r\n")
        more = (
            "rate_hz: 20\nresolution: [64, 48]\ncamera_model: pinhole\nintrinsics: [50.5, 51, 31, 23] # fu\n"
            "distortion_model: radial-tangential\ndistortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]\n"
        )
        (base / f"cam{camera}" / "sensor.yaml").write_text(_sensor_yaml("camera", shifted(0.1 * camera, 0, 0.02), more))
    (base / "imu0").mkdir()
    rows = [f"{start + number * 5_000_000},0.001,0.002,0.003,9.8,0.1,{0.01 * number}" for number in range(10 * num)]
    (base / "imu0" / "data.csv").write_text("#timestamp [ns],w_RS_S_x [rad s^-1]\n" + "\n".join(rows) + "\n")
    noise = (
        "rate_hz: 200\ngyroscope_noise_density: 1.0e-04\ngyroscope_random_walk: 2.0e-05\n"
        "accelerometer_noise_density: 3.0e-3\naccelerometer_random_walk: 4.0e-3\n"
    )
    (base / "imu0" / "sensor.yaml").write_text(_sensor_yaml("imu", np.eye(4), noise))
    truth = base / "state_groundtruth_estimate0"
    truth.mkdir()
    poses = [f"{stamp},{0.1 * number},0,1,1,0,0,0,0,0,0,0,0,0,0,0,0" for number, stamp in enumerate(stamps)]
    (truth / "data.csv").write_text("#time(ns),px,py,pz,qw,qx,qy,qz,vx,vy,vz,a,b,c,d,e,f\n" + "\n".join(poses) + "\n")
    return folder


def tum_vi(folder: Path, num: int = 4) -> Path:
    """Write a TUM-VI sequence with 16 bit images; cam0 sits 0.05 m, cam1 0.15 m along the IMU's x."""
    euroc(folder, num)
    base = folder / "mav0"
    for sensor in ("cam0", "cam1", "imu0"):
        (base / sensor / "sensor.yaml").unlink()
    for path in base.glob("cam*/data/*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.uint16) * 256 + 17)
    (base / "state_groundtruth_estimate0").rename(base / "mocap0")
    (folder / "dso").mkdir()
    camera = (
        "  camera_model: pinhole\n  distortion_coeffs: [0.003, 0.0007, -0.002, 0.0002]\n"
        "  distortion_model: equidistant\n  intrinsics: [190.9, 190.8, 30, 24]\n  resolution: [64, 48]\n"
    )
    cam_imu = "  T_cam_imu:\n  - [1, 0, 0, -0.05]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n"
    before = "  T_cn_cnm1:\n  - [1, 0, 0, -0.1]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n"
    (folder / "dso" / "camchain.yaml").write_text(f"cam0:\n{cam_imu}{camera}cam1:\n{before}{camera}")
    (folder / "dso" / "imu_config.yaml").write_text(
        "accelerometer_noise_density: 0.0028\naccelerometer_random_walk: 0.00086\n"
        "gyroscope_noise_density: 0.00016\ngyroscope_random_walk: 0.000022\nrostopic: /imu0\nupdate_rate: 200\n"
    )
    return folder


def icl_nuim(folder: Path, num: int = 4) -> Path:
    """Write an ICL-NUIM sequence whose poses turn about x and move in y."""
    lines, truth = [], []
    for number in range(num):
        write_image(folder / "rgb" / f"{number}.png", picture(number))
        write_image(folder / "depth" / f"{number}.png", depth_values(number))
        lines.append(f"{number} depth/{number}.png {number} rgb/{number}.png")
        half = 0.05 * number
        truth.append(f"{number} 0 {0.1 * number} -2 {np.sin(half)} 0 0 {np.cos(half)}")
    (folder / "associations.txt").write_text("\n".join(lines) + "\n")
    (folder / "livingRoom0.gt.freiburg").write_text("\n".join(truth) + "\n")
    return folder
