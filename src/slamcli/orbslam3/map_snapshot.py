# SPDX-License-Identifier: MIT
"""A map as it was, and how well it explains what its keyframes see: whether a correction did good."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.sparse_map import Ids, SparseMap

_MUTABLE = (
    "T_camera_map", "keyframe_alive", "parent", "T_camera_parent", "positions", "normals", "descriptors", "near", "far",
    "reference", "point_alive", "visible", "found", "replaced_by",
)  # fmt: skip
_CHI2_MONO, _CHI2_STEREO = 5.991, 7.815
_LEAST = 30
"""Observations of a keyframe that make a mean."""


class MapSnapshot:
    """What a correction may change of a map, to be put back."""

    def __init__(self, sparse_map: SparseMap) -> None:
        self._columns: dict[str, NDArray[Any]] = {name: getattr(sparse_map, name).copy() for name in _MUTABLE}
        self._seen = sparse_map.seen.copy()
        self._loop_edges = list(sparse_map.loop_edges)

    def restore(self, sparse_map: SparseMap) -> None:
        """Put everything back; no keyframe or point may have been added since."""
        for name, values in self._columns.items():
            getattr(sparse_map, name)[...] = values
        sparse_map.restore_seen(self._seen)
        sparse_map.loop_edges[:] = self._loop_edges


class Observations(NamedTuple):
    """Who sees what at some moment, as columns."""

    keyframes: Ids
    features: Ids
    points: Ids


def observations_of(sparse_map: SparseMap, keyframes: Ids) -> Observations:
    """Return all observations of some keyframes."""
    seen = sparse_map.seen[keyframes]
    rows, features = np.nonzero(seen >= 0)
    return Observations(np.asarray(keyframes)[rows], features, seen[rows, features])


class Costs(NamedTuple):
    """How well keyframes see what they should: means over observations of chi2 / bound (95 %), 1 at most."""

    mean: float
    """Over all of them; 0 for none."""
    by_keyframe: NDArray[np.float64]
    """(K,), NaN where a keyframe has fewer than 30."""


def costs(sparse_map: SparseMap, observed: Observations) -> Costs:
    """Return how well a map explains observations that were made of it, perhaps before it was changed.

    Points that were replaced since count where they are now, those that were taken out as 1: an adjustment that throws out what
    does not fit is not better for it.
    """
    shares = _shares(sparse_map, observed)
    counts = np.bincount(observed.keyframes, minlength=sparse_map.num_keyframes)
    sums = np.bincount(observed.keyframes, weights=shares, minlength=sparse_map.num_keyframes)
    known = counts >= _LEAST
    by_keyframe = np.where(known, sums / np.maximum(counts, 1), np.nan)
    return Costs(float(shares.mean()) if len(shares) else 0.0, by_keyframe)


def _shares(sparse_map: SparseMap, observed: Observations) -> NDArray[np.float64]:
    """Return chi2 / bound, 1 at most, of each observation (M,)."""
    out = np.ones(len(observed.points))
    ids = sparse_map.resolved(observed.points)
    alive = np.flatnonzero(ids >= 0)
    k, i, ids = observed.keyframes[alive], observed.features[alive], ids[alive]
    T, camera = sparse_map.T_camera_map[k], sparse_map.camera
    x, y, z = ((T[:, :3, :3] @ sparse_map.positions[ids][:, :, None])[..., 0] + T[:, :3, 3]).T
    ahead = z > 1e-9
    z = np.where(ahead, z, 1.0)
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    pixels, right = sparse_map.pixels[k, i], sparse_map.right[k, i]
    stereo = np.isfinite(right)
    across = np.where(stereo, u - camera.bf / z - np.where(stereo, right, 0.0), 0.0)
    chi2 = ((u - pixels[:, 0]) ** 2 + (v - pixels[:, 1]) ** 2 + across**2) / sparse_map.sigmas[k, i] ** 2
    out[alive] = np.where(ahead, np.minimum(chi2 / np.where(stereo, _CHI2_STEREO, _CHI2_MONO), 1.0), 1.0)
    return out
