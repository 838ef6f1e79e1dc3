# SPDX-License-Identifier: MIT
"""What to say of a folder or file that is no data set, but lies near one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from slamcli.errors import RecordingError
from slamcli.recordings.folders.layout import Layout
from slamcli.recordings.folders.listings import IMAGE_SUFFIXES

_PARTS = ("rgb.txt", "depth.txt", "times.txt", "calib.txt", "data.csv", "sensor.yaml", "groundtruth.txt", "poses.txt")
_NEARLY = (
    ("rgb", "its rgb is no data set's: TUM RGB-D has rgb.txt beside it, ICL-NUIM rgb/0.png and associations.txt"),
    ("image_0", "its image_0 holds no images named 000000.png, as KITTI's does"),
    ("image_2", "its image_2 holds no images named 000000.png, as KITTI's does"),
    ("mav0", "its mav0 has neither cam0/data.csv nor imu0/data.csv, as EuRoC's does"),
)
_MOST_ENTRIES = 200


def refuse(paths: Sequence[Path], layouts: Sequence[Layout], find: Callable[[Path], object | None]) -> None:
    """Raise if a path is a part of a data set, holds several, or is a folder with no recording at all.

    Parameters
    ----------
    find
        Returns something for a folder that is a data set.

    Raises
    ------
    RecordingError
        Which says what to name instead, or what is missing.
    """
    for path in paths:
        if path.is_dir():
            _refuse_folder(path, layouts, find)
        elif path.is_file() and (path.name in _PARTS or path.suffix.lower() in IMAGE_SUFFIXES):
            _refuse_part(path, find)


def _refuse_folder(folder: Path, layouts: Sequence[Layout], find: Callable[[Path], object | None]) -> None:
    inside = [entry for entry in _folders(folder) if find(entry)]
    inside = inside or [entry for above in _folders(folder)[:20] for entry in _folders(above) if find(entry)]
    if inside:
        names = [entry.relative_to(folder).as_posix() for entry in inside]
        listed = ", ".join(names[:4]) + (", …" if len(names) > 4 else "")
        raise RecordingError(
            f"{folder}: holds {'several recordings, name one' if len(names) > 1 else 'one, name it'}: {listed}"
        )
    _refuse_part(folder, find)
    nearly = next((what for name, what in _NEARLY if (folder / name).is_dir()), None)
    signs = "; ".join(f"{layout.name.removesuffix(' folder')}: {layout.signs}" for layout in layouts)
    raise RecordingError(
        f"{folder}: neither a ROS 2 bag (.db3, .mcap) nor a data set lies in this folder: "
        + (nearly or f"a data set has one of these: {signs}")
    )


def _refuse_part(path: Path, find: Callable[[Path], object | None]) -> None:
    resolved = path.resolve()
    # A sensor's images lie up to three levels below (mav0/cam0/data).
    for above in resolved.parents[:4]:
        if find(above):
            raise RecordingError(f"{path}: is a part of the data set {above}: name that folder")


def _folders(folder: Path) -> list[Path]:
    try:
        return sorted(entry for entry in folder.iterdir() if entry.is_dir())[:_MOST_ENTRIES]
    except OSError:
        return []
