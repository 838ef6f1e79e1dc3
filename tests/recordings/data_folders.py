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
