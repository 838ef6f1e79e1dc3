# SPDX-License-Identifier: MIT
"""Maps of points and keyframes as plain columns: what is saved of them, and what a run can begin with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision.pinhole import Pinhole

COLUMNS: dict[str, tuple[str, tuple[int, ...], str]] = {
    "T_camera_map": ("keyframes", (4, 4), "float64"), "stamp_ns": ("keyframes", (), "int64"),
    "frame_number": ("keyframes", (), "int64"), "parent": ("keyframes", (), "int64"),
    "counts": ("keyframes", (), "int64"),
    "seen": ("features", (), "int64"), "pixels": ("features", (2,), "float64"), "raw_pixels": ("features", (2,), "float64"),
    "octaves": ("features", (), "int64"), "angles": ("features", (), "float64"), "responses": ("features", (), "float64"),
    "key_descriptors": ("features", (32,), "uint8"), "sigmas": ("features", (), "float64"),
    "right": ("features", (), "float64"), "depth": ("features", (), "float64"),
    "positions": ("points", (3,), "float64"), "normals": ("points", (3,), "float64"),
    "descriptors": ("points", (32,), "uint8"), "near": ("points", (), "float64"), "far": ("points", (), "float64"),
    "reference": ("points", (), "int64"), "visible": ("points", (), "int64"), "found": ("points", (), "int64"),
    "first_keyframe": ("points", (), "int64"), "colours": ("points", (3,), "uint8"),
    "loop_edges": ("edges", (2,), "int64"),
}  # fmt: skip
"""Name of a column: what has a row in it, shape of a row, type. Features stand keyframe after keyframe, `counts` of each; `seen` is the
point that a feature sees, `reference` and `first_keyframe` are keyframes of a point, `parent` the keyframe above in the spanning
tree; -1 for none. Positions, normals and poses are in the map's frame, metres (mono: its own unit)."""

_REFERENCES = {"seen": "points", "parent": "keyframes", "reference": "keyframes", "loop_edges": "keyframes"}
_FINITE = ("T_camera_map", "pixels", "sigmas", "positions", "normals", "angles")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisualMap:
    """One map: keyframes, their features, points, and who sees what."""

    columns: Mapping[str, NDArray[Any]]
    """Those of `COLUMNS`."""
    T_world_map: NDArray[np.float64] | None = None
    """float64 (4, 4), from the map's frame to the one in which results are given (z up); None: not known."""

    def __post_init__(self) -> None:
        T = self.T_world_map
        if T is not None and (T.shape != (4, 4) or not np.isfinite(T).all()):
            raise DataError("visual map: its pose in the world is no transform")
        _check_shapes(self.columns)
        _check_values(self.columns)

    @property
    def num_keyframes(self) -> int:
        """Number of keyframes."""
        return len(self.columns["counts"])

    @property
    def num_points(self) -> int:
        """Number of points."""
        return len(self.columns["positions"])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisualAtlas:
    """All maps of a run, and the camera that made them."""

    camera: Pinhole
    scales: NDArray[np.float64]
    """(L,), scale of each level of the image pyramid, 1 first."""
    maps: tuple[VisualMap, ...]

    def __post_init__(self) -> None:
        scales = self.scales
        if scales.ndim != 1 or not len(scales) or scales[0] != 1.0 or (np.diff(scales) <= 0).any():
            raise DataError("atlas: the scales of the image pyramid do not begin with 1 and grow")
        if not np.isfinite(self.camera.array).all() or self.camera.fx <= 0 or self.camera.fy <= 0:
            raise DataError("atlas: the camera has no focal length")


def _check_shapes(columns: Mapping[str, NDArray[Any]]) -> None:
    """Raise unless all columns are there, with their types and as many rows as they should have."""
    missing = [name for name in COLUMNS if name not in columns]
    if missing:
        raise DataError(f"visual map: {', '.join(missing)} missing")
    counts = columns["counts"]
    if counts.ndim != 1 or counts.dtype != np.int64 or (counts < 0).any():
        raise DataError("visual map: the numbers of features are none")
    rows = {
        "keyframes": len(counts), "features": int(counts.sum()), "points": len(columns["positions"]),
        "edges": len(columns["loop_edges"]),
    }  # fmt: skip
    for name, (kind, shape, dtype) in COLUMNS.items():
        column = columns[name]
        if column.shape != (rows[kind], *shape) or column.dtype != np.dtype(dtype):
            raise DataError(f"visual map: {name} is {column.dtype} {column.shape}, not {dtype} {(rows[kind], *shape)}")


def _check_values(columns: Mapping[str, NDArray[Any]]) -> None:
    """Raise if a number refers to what is not there, or is not finite where it must be."""
    limits = {"keyframes": len(columns["counts"]), "points": len(columns["positions"])}
    for name, kind in _REFERENCES.items():
        column = columns[name]
        if column.size and (column.min() < -1 or column.max() >= limits[kind]):
            raise DataError(f"visual map: {name} refers to {kind} that are not there ({limits[kind]} are)")
    for name in _FINITE:
        if not np.isfinite(columns[name]).all():
            raise DataError(f"visual map: {name} is not finite")
    parents = columns["parent"]
    if (parents >= np.maximum(np.arange(len(parents)), 0)).any() and _has_cycle(parents):
        raise DataError("visual map: the spanning tree has a cycle")


def _has_cycle(parents: NDArray[np.int64]) -> bool:
    above = parents.copy()
    for _ in range(len(parents).bit_length() + 1):  # twice as far up each time
        above = np.where(above >= 0, above[above], -1)
    return bool((above >= 0).any())
