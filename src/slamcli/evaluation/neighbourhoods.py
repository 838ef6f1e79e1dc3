# SPDX-License-Identifier: MIT
"""How points lie among their neighbours, and how those of one visit to a place lie to those of others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.evaluation import _neighbour_kernels as kernels
from slamcli.evaluation.seen_points import PlacedPoints

SAME_SIDE = 0.5
"""Cosine: what is seen from directions more than 60 degrees apart may be the two sides of one thin wall, and is not compared."""

Sums = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Neighbourhoods:
    """The neighbours of Q points, within a radius, seen from about the same direction."""

    centres_m: NDArray[np.float64]
    """float64 (Q, 3), the points."""
    stamps_ns: NDArray[np.int64]
    """int64 (Q,), when they were measured."""
    own: Sums
    """float64 (Q, 10), of the neighbours of the same visit, the point itself among them: number, sums of x, y, z relative to the
    point, sums of xx, xy, xz, yy, yz, zz."""
    others: Sums
    """float64 (Q, 10), the same of other visits."""
    nearest_m: NDArray[np.float64]
    """float64 (Q,), distance to the nearest point of another visit; infinity where there is none within the radius."""


def neighbourhoods(placed: PlacedPoints, *, radius_m: float, visit_gap_s: float, num_queries: int) -> Neighbourhoods:
    """Return the neighbourhoods of points that are spread evenly over all.

    Parameters
    ----------
    radius_m
        How far neighbours are, metres.
    visit_gap_s
        What was measured longer than this before or after is of another visit, seconds.
    num_queries
        How many points are looked at, at most.
    """
    low = placed.points_m.min(axis=0, initial=0.0)
    cells = np.floor((placed.points_m[:, :2] - low[:2]) / radius_m).astype(np.int64) + 1
    columns = int(cells[:, 1].max(initial=1)) + 3
    key = cells[:, 0] * columns + cells[:, 1]
    order = np.argsort(key, kind="stable")
    keys, starts = np.unique(key[order], return_index=True)
    starts = np.append(starts, len(order)).astype(np.int64)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    step = max(-(-len(order) // num_queries), 1)
    chosen = np.arange(0, len(order), step, dtype=np.int64)
    points, stamps = np.ascontiguousarray(placed.points_m[order]), placed.stamps_ns[order]
    looks = placed.origins_m[order] - points
    looks /= np.maximum(np.linalg.norm(looks, axis=1, keepdims=True), 1e-9)
    own, others, nearest = np.zeros((len(chosen), 10)), np.zeros((len(chosen), 10)), np.zeros(len(chosen))
    kernels.moments(
        points, looks, stamps, keys, starts, columns, rank[chosen], np.ascontiguousarray(cells[chosen]), radius_m, round(visit_gap_s * 1e9), SAME_SIDE,
        own, others, nearest,
    )  # fmt: skip
    return Neighbourhoods(
        centres_m=placed.points_m[chosen], stamps_ns=placed.stamps_ns[chosen], own=own, others=others, nearest_m=nearest
    )


def covariances(sums: Sums) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return means (Q, 3) relative to the points, and covariances (Q, 3, 3); of no neighbours NaN."""
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = sums[:, 1:4] / sums[:, :1]
        second = sums[:, 4:] / sums[:, :1]
    full = second[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    return mean, full - mean[:, :, None] * mean[:, None, :]


def warm() -> None:
    """Compile the kernels of this module."""
    points = np.zeros((2, 3))
    placed = PlacedPoints(
        points_m=points, origins_m=points, stamps_ns=np.zeros(2, dtype=np.int64), planar=True, num_views=1
    )
    neighbourhoods(placed, radius_m=0.5, visit_gap_s=1.0, num_queries=2)
