# SPDX-License-Identifier: MIT
"""Ranges along rays in space through a world with heights, exact to rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation import _space_kernels
from slamcli.simulation.relief import CEILING, GROUND, THING, Relief, Terrain

Array = NDArray[np.float64]

_COARSE_M = 1.0


class Space:
    """A relief made ready for rays: what stands in each cell of a grid on the plan of about 1 m."""

    def __init__(self, relief: Relief) -> None:
        ground = relief.ground
        ratio = max(int(np.ceil(_COARSE_M / ground.cell_m - 1e-9)), 1)
        fields = [ground] if relief.ceiling is None else [ground, relief.ceiling]
        self._heights = np.stack([_padded(f.heights, ratio) for f in fields])
        self._lows = np.stack([_extremes(h, ratio, np.minimum) for h in self._heights])
        self._highs = np.stack([_extremes(h, ratio, np.maximum) for h in self._heights])
        coarse = ratio * ground.cell_m
        self._layout = np.array([ground.x0, ground.y0, ground.cell_m, coarse, GROUND, CEILING])
        self._relief = relief
        self._starts, self._members = _index(relief, ground, coarse, self._lows.shape[1:])

    def cast(self, origins: Array, directions: Array, max_range_m: float) -> Array:
        """Return range, reflectivity and cosine of incidence (N, 3) of the first thing along each ray.

        Ranges are metres; inf where there is nothing within `max_range_m`.

        Parameters
        ----------
        origins, directions
            float64 (N, 3), map frame: metres, and unit vectors.
        max_range_m
            How far rays go.
        """
        hits = np.zeros((len(origins), 3))
        hits[:, 0] = max_range_m
        r = self._relief
        _space_kernels.cast(
            np.ascontiguousarray(origins), np.ascontiguousarray(directions), r.panels, r.boxes, r.cylinders,
            self._starts, self._members, self._lows, self._highs, self._heights, self._layout, hits,
        )  # fmt: skip
        hits[hits[:, 0] >= max_range_m * (1 - 1e-12), 0] = np.inf
        return hits


def shorten(hits: Array, origins: Array, directions: Array, times_s: Array, bodies: Array, max_range_m: float) -> Array:
    """Return `hits` (N, 3) where bodies (B, 7) x, y, radius, vx, vy, low, high are nearer; ray i is cast at `times_s[i]`."""
    nearest: Array = hits.copy()
    nearest[:, 0] = np.minimum(nearest[:, 0], max_range_m)
    _space_kernels.cast_bodies(
        np.ascontiguousarray(origins), np.ascontiguousarray(directions), np.ascontiguousarray(times_s),
        np.ascontiguousarray(bodies), THING, nearest,
    )  # fmt: skip
    nearest[nearest[:, 0] >= max_range_m * (1 - 1e-12), 0] = np.inf
    return nearest


def _padded(heights: Array, ratio: int) -> Array:
    """Return nodes (H, W) repeated at the upper and right edge until whole coarse cells are full."""
    missing = [(0, -(size - 1) % ratio) for size in heights.shape]
    return np.ascontiguousarray(np.pad(heights, missing, mode="edge"))


def _extremes(heights: Array, ratio: int, of: np.ufunc) -> Array:
    """Return the extremes (h, w) of all nodes in and on the border of each coarse cell."""
    rows = np.arange(0, heights.shape[0] - 1, ratio)
    columns = np.arange(0, heights.shape[1] - 1, ratio)
    within = of.reduceat(of.reduceat(heights, rows, axis=0), columns, axis=1)
    # reduceat ends before the next cell's first node, which is on this one's border too
    upper = of.reduceat(heights[rows + ratio], columns, axis=1)
    right = of.reduceat(heights[:, columns + ratio], rows, axis=0)
    corner = heights[np.ix_(rows + ratio, columns + ratio)]
    extremes: Array = of(of(within, upper), of(right, corner))
    return extremes


def _index(
    relief: Relief, ground: Terrain, coarse_m: float, shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return, for each coarse cell in turn, where its things begin (cells + 1,) and the things, in ascending order."""
    corner = np.array([ground.x0, ground.y0])
    cells: list[NDArray[np.int64]] = []
    things: list[NDArray[np.int64]] = []
    for number, outline in enumerate(_outlines(relief)):
        low = np.clip(((outline.min(axis=0) - corner) / coarse_m).astype(np.int64) - 1, 0, np.array(shape[::-1]) - 1)
        high = np.clip(((outline.max(axis=0) - corner) / coarse_m).astype(np.int64) + 1, 0, np.array(shape[::-1]) - 1)
        columns, rows = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
        here = np.column_stack([columns.ravel(), rows.ravel()])
        if len(outline) == 2:  # a line: the cells that it can pass through
            middle = corner + (here + 0.5) * coarse_m
            here = here[_from_line(middle, outline[0], outline[1]) <= coarse_m * 0.75]
        cells.append(here[:, 1] * shape[1] + here[:, 0])
        things.append(np.full(len(here), number))
    cell = np.concatenate([np.zeros(0, np.int64), *cells])
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], np.arange(shape[0] * shape[1] + 1))
    return starts.astype(np.int64), np.concatenate([np.zeros(0, np.int64), *things])[order]


def _outlines(relief: Relief) -> list[Array]:
    """Return two ends (2, 2) of each panel, four corners (4, 2) about each box and cylinder."""
    outlines: list[Array] = list(relief.panels[:, :4].reshape(-1, 2, 2))
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for x, y, c, s, length, width in relief.boxes[:, :6]:
        outlines.append(np.array([x, y]) + (square * [length, width]) @ np.array([[c, s], [-s, c]]))
    outlines.extend(np.array([x, y]) + square * radius for x, y, radius in relief.cylinders[:, :3])
    return outlines


def _from_line(points: Array, a: Array, b: Array) -> Array:
    along = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-12), 0.0, 1.0)
    gaps = points - (a + along[:, None] * (b - a))
    return np.hypot(gaps[:, 0], gaps[:, 1])


def warm() -> None:
    """Compile the kernel of this module."""
    ground = Terrain(np.zeros((2, 2)), 1.0, 0.0, 0.0)
    relief = Relief(ground, None, np.zeros((1, 7)), np.zeros((1, 9)), np.zeros((1, 6)))
    origins, directions = np.array([[0.5, 0.5, 1.0]]), np.array([[0.0, 0.0, -1.0]])
    hits = Space(relief).cast(origins, directions, 2.0)
    shorten(hits, origins, directions, np.zeros(1), np.zeros((1, 7)), 2.0)
