# SPDX-License-Identifier: MIT
"""Small pictures of single submaps, as they were built."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from slamcli.posegraph import Submap
from slamcli.reports.figures import raster

_MOST = 48
_PIXELS = 280
_SHADES = 12
_UNKNOWN = (208, 214, 222)


def thumbnails(submaps: Sequence[Submap], words: Sequence[str]) -> tuple[str, int]:
    """Return pictures with their words below as markup, and how many they are: at most 48, spread evenly over all submaps."""
    drawable = [i for i, submap in enumerate(submaps) if submap.grid is not None or submap.high_resolution is not None]
    every = max(1, -(-len(drawable) // _MOST))
    parts = []
    for i in drawable[::every]:
        pixels = submap_pixels(submaps[i])
        if pixels is not None:
            data = base64.b64encode(raster.png(pixels)).decode("ascii")
            parts.append(
                f'<div><img src="data:image/png;base64,{data}" alt="submap {escape(words[i])}">{escape(words[i])}</div>'
            )
    return (f'<div class="thumbs">{"".join(parts)}</div>' if parts else ""), len(parts)


def submap_pixels(submap: Submap) -> NDArray[np.uint8] | None:
    """Return the known part of a submap as pixels uint8 (H, W, 3), y up, dark where occupied; None if nothing is known.

    A 3D submap is seen from above: darkness is the share of occupied voxels in a column.
    """
    occupied = _columns(submap) if submap.grid is None else _plane(submap)
    if occupied is None:
        return None
    pool = max(1, -(-max(occupied.shape) // _PIXELS))
    if pool > 1:
        occupied = _pooled(occupied, pool)
    # Few shades make small files, and show as much.
    shade = np.round(255 - 231 * np.round(np.clip(np.nan_to_num(occupied), 0.0, 1.0) * _SHADES) / _SHADES)[..., None]
    pixels = np.where(np.isnan(occupied)[..., None], np.array(_UNKNOWN), shade)
    return pixels[::-1].astype(np.uint8)


def _plane(submap: Submap) -> NDArray[np.float64] | None:
    """Return how occupied each cell is, float64 (H, W), 0 to 1, NaN where unknown, cropped."""
    grid = submap.grid
    if grid is None:
        return None
    from slamcli.grids.probability_grid import ProbabilityGrid  # loads kernels; where there is a grid they are loaded

    if isinstance(grid, ProbabilityGrid):
        known = grid.cells > 0
        occupied = (grid.probabilities().astype(np.float64) - 0.1) / 0.8
    else:
        known = grid.tsd > 0
        occupied = 1.0 - np.abs(grid.tsd.astype(np.float64) - 16384.0) / 16383.0
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return None
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return np.where(known, occupied, np.nan)[box]


def _columns(submap: Submap) -> NDArray[np.float64] | None:
    """Return the share of occupied voxels in each column of a 3D submap, float64 (H, W), against the fullest; NaN where nothing is known."""
    grid = submap.high_resolution
    if grid is None or not len(grid.indices):
        return None
    at = grid.indices[:, :2].astype(np.int64) - grid.indices[:, :2].min(axis=0)
    width, height = (at.max(axis=0) + 1).tolist()
    flat = at[:, 1] * width + at[:, 0]
    known = np.bincount(flat, minlength=width * height)
    hits = np.bincount(flat, weights=grid.values > 16384, minlength=width * height)
    top = max(1.0, float(np.percentile(hits[hits > 0], 95))) if hits.any() else 1.0
    return np.where(known > 0, np.sqrt(np.minimum(hits / top, 1.0)), np.nan).reshape(height, width)


def _pooled(values: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Return the greatest value of each k x k block, NaN where all are."""
    low = np.where(np.isnan(values), -1.0, values)
    for axis in (0, 1):
        low = np.maximum.reduceat(low, np.arange(0, low.shape[axis], k), axis=axis)
    return np.where(low < 0, np.nan, low)
