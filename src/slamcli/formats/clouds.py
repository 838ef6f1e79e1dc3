# SPDX-License-Identifier: MIT
"""Point clouds in files: PLY and PCD, read and written with positions, intensities and colours."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError, UsageError
from slamcli.formats.cloud_colours import colours_in
from slamcli.formats.pcd import pcd_bytes, read_pcd_columns
from slamcli.formats.ply import ply_bytes, read_ply_columns
from slamcli.measurements import PointCloud
from slamcli.outputs import atomic_file

Colour = Literal["rgb", "height", "intensity", "none"]
COLOURS: tuple[str, ...] = get_args(Colour)

_INTENSITIES = ("intensity", "intensities", "reflectivity", "i", "scalar_intensity")
_SPREAD = (2.0, 98.0)  # percentiles between which colours run: single outliers must not take the whole scale
# Dark blue over green to yellow, of rising lightness, so that it reads in print and for the colour-blind too.
_SCALE = np.array(
    [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37]],
    dtype=np.float64,
)  # fmt: skip


def read_cloud(path: str | os.PathLike[str]) -> PointCloud:
    """Return the points of a PLY file (text, or binary of either byte order) or a PCD file (text, binary, compressed).

    Positions become float32; points that are not finite (empty cells of an organised cloud) are left out. The cloud has
    stamp 0 and no frame; normals are not read.

    Raises
    ------
    FormatError
        If there is no such file, its beginning is neither that of PLY nor of PCD, or what it declares is not there.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read as a point cloud: {error.strerror or error}") from error
    columns = read_ply_columns(data, path) if data[:3] == b"ply" else read_pcd_columns(data, path)
    missing = [name for name in "xyz" if name not in columns]
    if missing:
        raise FormatError(
            f"{path}: its points have no {missing[0]} (they have {', '.join(list(columns)[:8]) or 'nothing'})"
        )
    with np.errstate(over="ignore", invalid="ignore"):
        points = np.column_stack([columns[name].astype(np.float32) for name in "xyz"])
    valid = np.isfinite(points).all(axis=1)
    name = next((name for name in columns if name.lower() in _INTENSITIES), None)
    intensities = None
    if name is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            intensities = columns[name].astype(np.float32)[valid]
    colours = colours_in(columns)
    return PointCloud(
        stamp_ns=0, frame_id="", points_m=points[valid], intensities=intensities, colours=None if colours is None else colours[valid]
    )  # fmt: skip


def write_cloud(path: str | os.PathLike[str], cloud: PointCloud, *, colour: Colour = "rgb") -> None:
    """Write points, intensities and colours to a PLY or PCD file (binary, little-endian), whole or not at all.

    Parameters
    ----------
    path
        Its suffix says the format: ``.ply`` or ``.pcd``.
    cloud
        Positions and intensities are written bit by bit; times and rings are not.
    colour
        By what points are coloured: their own colours, their height, their intensity (height where there is none of either), or
        not at all.

    Raises
    ------
    UsageError
        If the suffix is another one, or the file cannot be written.
    """
    path = Path(path)
    writers = {".ply": ply_bytes, ".pcd": pcd_bytes}
    if path.suffix.lower() not in writers:
        raise UsageError(f"{path}: point clouds are written as .ply or .pcd")
    columns: dict[str, NDArray[np.float32]] = {name: cloud.points_m[:, i] for i, name in enumerate("xyz")}
    if cloud.intensities is not None:
        columns["intensity"] = cloud.intensities
    content = writers[path.suffix.lower()](columns, _colours(cloud, colour))
    with atomic_file(path, "wb") as stream:
        stream.write(content)


def _colours(cloud: PointCloud, colour: Colour) -> NDArray[np.uint8] | None:
    if colour == "none":
        return None
    if colour == "rgb" and cloud.colours is not None:
        return cloud.colours
    return colours_of(
        cloud.intensities if colour == "intensity" and cloud.intensities is not None else cloud.points_m[:, 2]
    )


def colours_of(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return red, green, blue (N, 3) for values (N,): a scale from their 2nd to their 98th percentile."""
    usable = values[np.isfinite(values)].astype(np.float64)
    low, high = np.percentile(usable, _SPREAD) if len(usable) else (0.0, 1.0)
    share = np.clip((np.nan_to_num(values.astype(np.float64)) - low) / max(high - low, 1e-9), 0.0, 1.0)
    at = share * (len(_SCALE) - 1)
    steps = np.arange(len(_SCALE))
    return np.rint(np.column_stack([np.interp(at, steps, _SCALE[:, i]) for i in range(3)])).astype(np.uint8)
