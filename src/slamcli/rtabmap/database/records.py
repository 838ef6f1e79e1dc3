# SPDX-License-Identifier: MIT
"""What a database holds beside signatures, images and links."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.vision.pinhole import Pinhole


@dataclass(frozen=True, slots=True, kw_only=True)
class StorageSettings:
    """How nodes are kept, and how SQLite works; `DbSqlite3/...` and `Mem/...` of RTAB-Map."""

    image_encoding: str = ".jpg"
    """``.jpg`` or ``.png`` (`Mem/ImageCompressionFormat`)."""
    depth_encoding: str = ".rvl"
    """``.rvl`` or ``.png``, of depth in whole millimetres (`Mem/DepthCompressionFormat`)."""
    depth_16_bits: bool = False
    """Whether to round other depth to millimetres (`Mem/SaveDepth16Format`)."""
    cache_pages: int = 10000
    """`DbSqlite3/CacheSize`."""
    journal_mode: int = 0
    """0 DELETE, 1 TRUNCATE, 2 PERSIST (`DbSqlite3/JournalMode`). RTAB-Map's 3 MEMORY and 4 OFF, with which a killed run may leave a broken
    file, are taken as 0."""
    synchronous: int = 0
    """0 OFF, 1 NORMAL, 2 FULL (`DbSqlite3/Synchronous`): what a power cut may cost; a killed run costs nothing in any case."""
    temp_store: int = 2
    """0 DEFAULT, 1 FILE, 2 MEMORY (`DbSqlite3/TempStore`)."""
    in_memory: bool = False
    """Whether to write the file only when it is closed (`DbSqlite3/InMemory`): then a killed run leaves nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GeoFix:
    """Where a satellite receiver says the robot is."""

    stamp_ns: int
    longitude_deg: float
    latitude_deg: float
    altitude_m: float
    accuracy_m: float
    bearing_deg: float
    """North 0, clockwise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredCamera:
    """A camera as the database describes it."""

    pinhole: Pinhole
    """Of the images as they are kept; `baseline_m` only for a rectified pair. Its size is 0 x 0 in databases before 0.11.2."""
    T_base_camera: NDArray[np.float64]
    """float64 (4, 4)."""
    intrinsics: NDArray[np.float64] | None = None
    """float64 (3, 3), K of the raw image."""
    distortion: NDArray[np.float64] | None = None
    """float64 (K,): what the images had before they were rectified."""
    rectification: NDArray[np.float64] | None = None
    """float64 (3, 3)."""
    projection: NDArray[np.float64] | None = None
    """float64 (3, 4)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NodeTable:
    """All nodes, by id."""

    ids: NDArray[np.int64]
    map_ids: NDArray[np.int64]
    weights: NDArray[np.int64]
    """-1 for intermediate nodes, -9 for those that are not to be used."""
    stamps_ns: NDArray[np.int64]
    T_odom_base: NDArray[np.float64]
    """float64 (N, 4, 4); NaN for a node without a pose."""
    ground_truth: NDArray[np.float64]
    """float64 (N, 4, 4); NaN where it is not known."""
    labels: tuple[str | None, ...]

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.ids)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OptimisedPoses:
    """The graph as it was optimised last."""

    ids: NDArray[np.int64]
    T_map_base: NDArray[np.float64]
    """float64 (N, 4, 4)."""
    T_map_last: NDArray[np.float64] | None
    """float64 (4, 4): where the robot was last; None where that is not known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredGrid:
    """The assembled map."""

    cells: NDArray[np.int8]
    """(H, W): -1 unknown, 0 free, 100 occupied; row 0 at the smallest y."""
    x_min_m: float
    y_min_m: float
    resolution_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeStatistics:
    """Figures of one update, by RTAB-Map's names such as ``Loop/Visual_inliers/``."""

    node_id: int
    stamp_ns: int
    values: dict[str, float]
