# SPDX-License-Identifier: MIT
"""Data sets as folders of images and text files, read as recordings: one module per layout, recognised by its files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from slamcli.errors import RecordingError
from slamcli.recordings.containers.damage import Damage
from slamcli.recordings.folders import euroc, icl_nuim, kitti, seven_scenes, tum, tum_vi
from slamcli.recordings.folders.layout import TRUTH_TOPIC, Layout, Reading
from slamcli.recordings.folders.reader import FolderReader
from slamcli.recordings.folders.refusals import refuse
from slamcli.runtime import RunLog

LAYOUTS: tuple[Layout, ...] = (
    seven_scenes.LAYOUT,
    icl_nuim.LAYOUT,
    tum.LAYOUT,
    tum_vi.LAYOUT,
    euroc.LAYOUT,
    kitti.LAYOUT,
)
"""In the order in which they are looked for."""

_BAG_SIGNS = ("metadata.yaml", "*.db3", "*.mcap", "*.db3.zstd", "*.mcap.zstd")


def find_layout(folder: Path) -> tuple[Layout, Path] | None:
    """Return the layout of a folder and its root, None for a bag or anything else."""
    if not folder.is_dir() or any(next(folder.glob(sign), None) for sign in _BAG_SIGNS):
        return None
    return next(((layout, root) for layout in LAYOUTS if (root := layout.find(folder)) is not None), None)


def open_folder(paths: Sequence[Path], log: RunLog, *, depth_units_per_m: float | None = None) -> FolderReader | None:
    """Return a reader if `paths` is one data-set folder, None if it is something else.

    Parameters
    ----------
    depth_units_per_m
        Value of one metre in depth images; None for the data set's own.

    Raises
    ------
    RecordingError
        If nothing in it can be read, several folders are given, or what is given lies near a data set.
    """
    found = next((found for path in paths if (found := find_layout(path)) is not None), None)
    if found is None:
        if not any(_holds_other(path) for path in paths):
            refuse(paths, LAYOUTS, find_layout)
        return None
    layout, root = found
    if len(paths) > 1:
        raise RecordingError(f"{root}: a data-set folder cannot be joined with other recordings; give one")
    reading = Reading(log=log, damage=Damage(log), depth_units_per_m=depth_units_per_m)
    return FolderReader(layout.read(root, reading), layout.name, reading)


def _holds_other(path: Path) -> bool:
    """Return whether a folder holds a bag or a log that readers of these can name."""
    signs = (*_BAG_SIGNS, "*.bag", "*.clf", "*.log")
    return path.is_dir() and any(next(path.glob(sign), None) for sign in signs)


__all__ = ["LAYOUTS", "TRUTH_TOPIC", "FolderReader", "find_layout", "open_folder"]
