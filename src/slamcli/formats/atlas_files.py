# SPDX-License-Identifier: MIT
"""Visual maps in files: NumPy's ``.npz`` with the columns of `slamcli.vision.visual_atlas`."""

from __future__ import annotations

import os
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, FormatError
from slamcli.outputs import atomic_file
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.visual_atlas import COLUMNS, VisualAtlas, VisualMap

VERSION = 1
_KIND = "slamcli atlas"
_MOST_MAPS = 10_000


def write_atlas(atlas: VisualAtlas, target: str | os.PathLike[str]) -> None:
    """Write an atlas; the same one gives the same bytes.

    Raises
    ------
    UsageError
        If `target` cannot be written to.
    """
    camera = atlas.camera
    columns: dict[str, NDArray[Any]] = {
        "kind": np.array(f"{_KIND} {VERSION}"), "num_maps": np.array(len(atlas.maps)), "scales": atlas.scales,
        "camera": np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.baseline_m, camera.depth_weight, *camera.limits]),
        "image_size": np.array([camera.width, camera.height]), "has_bounds": np.array(camera.bounds is not None),
    }  # fmt: skip
    for number, saved in enumerate(atlas.maps):
        columns |= {f"map{number}.{name}": saved.columns[name] for name in COLUMNS}
        if saved.T_world_map is not None:
            columns[f"map{number}.T_world_map"] = saved.T_world_map
    with atomic_file(target, "wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **columns)


def read_atlas(source: str | os.PathLike[str]) -> VisualAtlas:
    """Return the atlas in a file.

    Raises
    ------
    FormatError
        If the file is none, is damaged, or is of another version; ORB-SLAM3's own (``.osa``) cannot be read.
    """
    path = Path(source)
    _check_kind(path)
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as columns:
            kind = str(columns["kind"])
            if kind == f"{_KIND} {VERSION}":
                return _atlas(columns)
    except KeyError as error:
        raise FormatError(f"{path}: no atlas of slamcli, or a damaged one: {error.args[0]}") from error
    except (zipfile.BadZipFile, zlib.error, ValueError, IndexError, TypeError, EOFError, OSError, MemoryError, RuntimeError, DataError) as error:  # fmt: skip
        raise FormatError(f"{path}: this atlas is damaged: {error}") from error
    raise FormatError(f"{path}: {kind[:60]!r} is not read; this slamcli reads '{_KIND} {VERSION}'")


def _check_kind(path: Path) -> None:
    """Raise if the file cannot be opened, or does not begin as ``.npz`` files do."""
    try:
        with path.open("rb") as stream:
            head = stream.read(64)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror or error}") from error
    if path.suffix.lower() == ".osa" or b"serialization::archive" in head:
        raise FormatError(
            f"{path}: an atlas of ORB-SLAM3 (.osa), whose layout follows its compiled classes, cannot be read: map its recording with slamcli and --save-atlas"
        )
    if not head.startswith(b"PK"):
        raise FormatError(f"{path}: no atlas of slamcli (as --save-atlas writes it)")


def _atlas(columns: Any) -> VisualAtlas:
    fx, fy, cx, cy, baseline_m, weight, *limits = (float(value) for value in columns["camera"])
    width, height = (int(value) for value in columns["image_size"])
    num_maps = int(columns["num_maps"])
    if not 0 <= num_maps <= _MOST_MAPS or len(limits) != 4:
        raise DataError(f"{num_maps} maps, {len(limits)} limits of the image")
    bounds = (limits[0], limits[1], limits[2], limits[3]) if bool(columns["has_bounds"]) else None
    return VisualAtlas(
        camera=Pinhole(
            fx=fx,
            fy=fy,
            cx=cx,
            cy=cy,
            width=width,
            height=height,
            baseline_m=baseline_m,
            depth_weight=weight,
            bounds=bounds,
        ),
        scales=columns["scales"],
        maps=tuple(_map(columns, number) for number in range(num_maps)),
    )


def _map(columns: Any, number: int) -> VisualMap:
    placed = f"map{number}.T_world_map"
    return VisualMap(
        columns={name: columns[f"map{number}.{name}"] for name in COLUMNS},
        T_world_map=columns.get(placed),
    )
