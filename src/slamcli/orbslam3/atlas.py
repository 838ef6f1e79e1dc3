# SPDX-License-Identifier: MIT
"""Maps of a session as plain columns and back: what is saved, and what a later session begins with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.visual_atlas import VisualAtlas, VisualMap

_OF_POINTS = (
    "positions", "normals", "descriptors", "near", "far", "reference", "visible", "found", "first_keyframe", "colours",
)  # fmt: skip
_OF_FEATURES = (
    "pixels", "raw_pixels", "octaves", "angles", "responses", "key_descriptors", "sigmas", "right", "depth",
)  # fmt: skip


def visual_atlas(maps: Sequence[SparseMap]) -> VisualAtlas:
    """Return what is saved of a session's maps, those with keyframes; there must be one map at least.

    Keyframes and points that were culled are left out, so numbers change; a point's reference or first keyframe that was culled
    becomes the first living keyframe that sees it.
    """
    return VisualAtlas(
        camera=maps[0].camera, scales=maps[0].scales,
        maps=tuple(_visual_map(sparse_map) for sparse_map in maps if len(sparse_map.living_keyframes)),
    )  # fmt: skip


def sparse_maps(atlas: VisualAtlas, camera: Pinhole, scales: NDArray[np.float64]) -> list[SparseMap]:
    """Return the maps of an atlas for a camera to go on with; nothing is known yet of their words.

    Raises
    ------
    CalibrationError
        If the atlas was made with another camera or another image pyramid: its keyframes could not be compared.
    """
    made, given = np.append(atlas.camera.array, atlas.camera.limits), np.append(camera.array, camera.limits)
    if not np.allclose(made, given, rtol=1e-6, atol=1e-6):
        raise CalibrationError(
            f"the atlas was made with another camera: fx, fy, cx, cy, baseline {_named(atlas.camera)}, here {_named(camera)}"
        )
    if len(scales) != len(atlas.scales) or not np.allclose(scales, atlas.scales):
        raise CalibrationError(
            f"the atlas was made with ORBextractor.nLevels {len(atlas.scales)} and scaleFactor {_factor(atlas.scales):g}, here "
            f"{len(scales)} and {_factor(scales):g}"
        )
    return [_sparse_map(saved, camera, scales) for saved in atlas.maps]


def _visual_map(sparse_map: SparseMap) -> VisualMap:
    living = sparse_map.living_keyframes
    counts = np.array([sparse_map.counts[k] for k in living.tolist()], dtype=np.int64)
    seen = np.concatenate([sparse_map.seen[k, :n] for k, n in zip(living.tolist(), counts.tolist(), strict=True)])
    alive = np.flatnonzero(sparse_map.point_alive)
    point_number = _numbers(alive, sparse_map.num_points)
    keyframe_number = _numbers(living, sparse_map.num_keyframes)
    columns: dict[str, NDArray[Any]] = {
        name: np.concatenate([getattr(sparse_map, name)[k, :n] for k, n in zip(living.tolist(), counts.tolist(), strict=True)])
        for name in _OF_FEATURES
    }  # fmt: skip
    columns |= {name: getattr(sparse_map, name)[alive].copy() for name in _OF_POINTS}
    columns |= {name: getattr(sparse_map, name)[living].copy() for name in ("T_camera_map", "stamp_ns", "frame_number")}
    columns["counts"] = counts
    columns["seen"] = _renumbered(seen, point_number)
    columns["parent"] = _renumbered(sparse_map.parent[living], keyframe_number)
    first_seen = _first_keyframes(columns["seen"], counts, len(alive))
    for name in ("reference", "first_keyframe"):
        moved = _renumbered(columns[name], keyframe_number)
        columns[name] = np.where(moved < 0, first_seen, moved)
    edges = np.array(sparse_map.loop_edges, dtype=np.int64).reshape(-1, 2)
    edges = _renumbered(edges, keyframe_number)
    columns["loop_edges"] = edges[(edges >= 0).all(axis=1)]
    return VisualMap(columns=columns, T_world_map=sparse_map.T_world_map)


def _sparse_map(saved: VisualMap, camera: Pinhole, scales: NDArray[np.float64]) -> SparseMap:
    columns = saved.columns
    sparse_map = SparseMap(camera, scales)
    sparse_map.T_world_map = saved.T_world_map
    sparse_map.append_points({name: columns[name] for name in _OF_POINTS})
    ends = np.cumsum(columns["counts"])
    for k, (end, count) in enumerate(zip(ends.tolist(), columns["counts"].tolist(), strict=True)):
        rows = slice(end - count, end)
        features = Features(
            descriptors=columns["key_descriptors"][rows],
            **{name: columns[name][rows] for name in _OF_FEATURES if name != "key_descriptors"},
        )
        frame = Frame(
            number=int(columns["frame_number"][k]), stamp_ns=int(columns["stamp_ns"][k]), features=features,
            grid=feature_grid(features, camera), T_camera_map=columns["T_camera_map"][k], points=columns["seen"][rows],
        )  # fmt: skip
        sparse_map.add_keyframe(frame, int(columns["parent"][k]))
    sparse_map.loop_edges.extend((int(a), int(b)) for a, b in columns["loop_edges"])
    return sparse_map


def _numbers(kept: Ids, count: int) -> Ids:
    """Return (count,), the new number of each row, -1 for those that are not kept."""
    numbers = np.full(count, -1, dtype=np.int64)
    numbers[kept] = np.arange(len(kept))
    return numbers


def _renumbered(ids: Ids, numbers: Ids) -> Ids:
    return np.where(ids >= 0, numbers[ids], -1) if len(numbers) else np.full_like(ids, -1)


def _first_keyframes(seen: Ids, counts: Ids, num_points: int) -> Ids:
    """Return the first keyframe that sees each point, 0 for a point that none sees."""
    keyframes = np.repeat(np.arange(len(counts)), counts)
    first = np.full(num_points, len(counts), dtype=np.int64)
    there = seen >= 0
    np.minimum.at(first, seen[there], keyframes[there])
    return np.where(first < len(counts), first, 0)


def _named(camera: Pinhole) -> str:
    return f"{camera.fx:g}, {camera.fy:g}, {camera.cx:g}, {camera.cy:g} px, {camera.baseline_m:g} m"


def _factor(scales: NDArray[np.float64]) -> float:
    return float(scales[1] / scales[0]) if len(scales) > 1 else 1.0
