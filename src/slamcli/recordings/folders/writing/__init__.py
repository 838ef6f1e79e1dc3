# SPDX-License-Identifier: MIT
"""Recordings to folders of data sets: images as files, and the text files of a layout."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from slamcli.recordings.folders.writing import euroc, kitti, tum
from slamcli.recordings.folders.writing.exported import Exported, ExportedCamera, ExportedImu


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A layout that can be written."""

    title: str
    takes_depth: bool
    takes_imu: bool
    max_cameras: int | None
    """None: as many as there are."""
    png_only: bool
    """Whether its readers expect PNG files: then JPEG is decoded once more."""
    finish: Callable[[Exported], None]


TARGETS: dict[str, Target] = {
    "tum": Target(
        title="TUM RGB-D folder", takes_depth=True, takes_imu=False, max_cameras=1, png_only=False, finish=tum.finish
    ),
    "euroc": Target(
        title="EuRoC folder", takes_depth=False, takes_imu=True, max_cameras=None, png_only=True, finish=euroc.finish
    ),
    "kitti": Target(
        title="KITTI odometry folder",
        takes_depth=False,
        takes_imu=False,
        max_cameras=4,
        png_only=True,
        finish=kitti.finish,
    ),
}
"""By the name that ``--layout`` has."""

__all__ = ["TARGETS", "Exported", "ExportedCamera", "ExportedImu", "Target"]
