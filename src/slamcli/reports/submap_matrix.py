# SPDX-License-Identifier: MIT
"""Which submaps are tied to which by loop constraints, as a square of cells, and which lie over each other without being tied."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray

from slamcli.reports.chart_frame import drawing
from slamcli.reports.graph_arrays import GraphArrays

_WIDTH, _LEFT, _TOP = 720, 44, 40
_MOST = 120
_FEW = 30
_CLASSES = ((1, "1"), (5, "2 to 5"), (20, "6 to 20"), (10**9, "more"))
_NEAR = 2
"""Submaps whose places in the sequence differ by no more share scans or follow each other."""


def constraint_counts(graph: GraphArrays) -> NDArray[np.int64]:
    """Return int64 (S, S): loop constraints between the submap of a row and nodes of the submap of a column."""
    count = len(graph.submap_names)
    counts = np.zeros((count, count), dtype=np.int64)
    use = graph.inter & (graph.constraint_nodes >= 0) & (graph.constraint_submaps >= 0)
    owners = graph.owners[graph.constraint_nodes[use]]
    owned = owners >= 0
    np.add.at(counts, (graph.constraint_submaps[use][owned], owners[owned]), 1)
    return counts


def untied(graph: GraphArrays, reach_m: float = 5.0) -> NDArray[np.bool_]:
    """Return bool (S, S), symmetric: pairs that were built within `reach_m` of each other, not one after the other, and are not tied.

    What counts is the least distance between the nodes of both, after optimisation.
    """
    count = len(graph.submap_names)
    near = np.zeros((count, count), dtype=bool)
    positions = [graph.positions_m[graph.owners == i] for i in range(count)]
    nowhere = np.full(3, np.nan)
    low = np.array([p.min(axis=0) if len(p) else nowhere for p in positions]).reshape(-1, 3)
    high = np.array([p.max(axis=0) if len(p) else nowhere for p in positions]).reshape(-1, 3)
    apart = np.maximum(np.maximum(low[:, None] - high[None], low[None] - high[:, None]), 0.0)
    for i, j in np.argwhere(np.triu(np.linalg.norm(apart, axis=2) <= reach_m, _NEAR + 1)).tolist():
        gaps = np.linalg.norm(positions[i][:, None] - positions[j][None], axis=2)
        near[i, j] = near[j, i] = bool(gaps.min() <= reach_m)
    counts = constraint_counts(graph)
    return near & (counts + counts.T == 0)


def matrix_chart(graph: GraphArrays, open_pairs: NDArray[np.bool_]) -> str:
    """Return an ``<svg>`` element with the `untied` pairs in it; beyond 120 submaps neighbours share a cell."""
    counts = constraint_counts(graph)
    pool = max(1, -(-len(counts) // _MOST))
    counts, missing = _pooled(counts, pool), _pooled(open_pairs.astype(np.int64), pool) > 0
    size = len(counts)
    cell = min((_WIDTH - _LEFT - 10) / size, 30.0)
    side = cell * size
    parts = [_legend(), f'<rect class="m0" x="{_LEFT}" y="{_TOP}" width="{side:.1f}" height="{side:.1f}"/>']
    classes = np.searchsorted([c for c, _ in _CLASSES], counts) + 1
    parts += [
        f'<path class="m{k}" d="{_squares((classes == k) & (counts > 0), cell, 0.04)}"/>'
        for k in range(1, len(_CLASSES) + 1)
    ]
    parts.append(f'<path class="open" d="{_squares(missing & (counts == 0), cell, 0.3)}"/>')
    if size <= _FEW:
        parts += [
            f'<text class="mt" x="{_LEFT + (j + 0.5) * cell:.1f}" y="{_TOP + (i + 0.5) * cell + 3:.1f}" text-anchor="middle">{counts[i, j]}</text>'
            for i, j in np.argwhere(counts > 0).tolist()
        ]
    every = max(1, -(-size // 24))
    for k in range(0, size, every):
        name, at = escape(graph.submap_names[k * pool]), (k + 0.5) * cell
        parts.append(f'<text class="tick" x="{_LEFT - 5}" y="{_TOP + at + 4:.1f}" text-anchor="end">{name}</text>')
        parts.append(
            f'<text class="tick" x="{_LEFT + at:.1f}" y="{_TOP + side + 14:.1f}" text-anchor="middle">{name}</text>'
        )
    parts.append(
        f'<text class="label" x="{_LEFT}" y="{_TOP + side + 32:.1f}">submap of the node (across), submap that it was matched with (down)</text>'
    )
    return drawing("Loop constraints between submaps", _WIDTH, round(_TOP + side + 40), parts)


def _pooled(values: NDArray[np.int64], pool: int) -> NDArray[np.int64]:
    if pool == 1:
        return values
    starts = np.arange(0, len(values), pool)
    return np.add.reduceat(np.add.reduceat(values, starts, axis=0), starts, axis=1)


def _squares(chosen: NDArray[np.bool_], cell: float, margin: float) -> str:
    side = cell * (1 - 2 * margin)
    return "".join(
        f"M{_LEFT + (j + margin) * cell:.1f} {_TOP + (i + margin) * cell:.1f}h{side:.1f}v{side:.1f}h{-side:.1f}z"
        for i, j in np.argwhere(chosen).tolist()
    )


def _legend() -> str:
    parts, x = [], _LEFT
    entries = [(f"m{k}", words) for k, (_, words) in enumerate(_CLASSES, start=1)] + [
        ("open", "near each other, not tied")
    ]
    for kind, words in entries:
        parts.append(
            f'<rect class="{kind}" x="{x}" y="8" width="12" height="12"/><text class="label" x="{x + 17}" y="18">{escape(words)}</text>'
        )
        x += 40 + round(7.5 * len(words))
    return "".join(parts)
