# SPDX-License-Identifier: MIT
"""The map with the pose graph over it: a drawing in layers that the reader switches on and off."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.reports.graph_arrays import GraphArrays
from slamcli.reports.layers import Layer, Place, dots, ground, layered_drawing, polyline, thinned

_MOST_LINES = 6000
_LABEL_WIDTH, _LABEL_HEIGHT, _LABELS_AT_ONE = 40, 16, 4

RESIDUAL_CLASSES = (
    (0.05, 0.5, "to 5 cm, 0.5°"),
    (0.10, 1.0, "to 10 cm, 1°"),
    (0.25, 2.5, "to 25 cm, 2.5°"),
    (np.inf, np.inf, "above"),
)
"""Upper bounds in metres and degrees of the classes that loop constraints are coloured by, and their words."""


def residual_classes(residuals_m: NDArray[np.float64], residuals_rad: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the place (C,) in `RESIDUAL_CLASSES` of each pair of residuals: the worse of the two counts."""
    metres, degrees = np.array([c[:2] for c in RESIDUAL_CLASSES]).T
    by_metres = np.searchsorted(metres, residuals_m, side="left")
    by_degrees = np.searchsorted(degrees, np.degrees(residuals_rad), side="left")
    return np.minimum(np.maximum(by_metres, by_degrees), len(RESIDUAL_CLASSES) - 1).astype(np.int64)


def graph_map(graph: GraphArrays, grid: OccupancyGrid | None = None) -> str:
    """Return the drawing as markup: map, submap outlines, trajectories, nodes, loop constraints and rejected searches.

    Loop constraints run from the node to the place where the robot was in the middle of building the submap. Of rejected searches
    the best-scored one of each pair of submaps is drawn. At most some thousand lines of a kind are drawn, the worst in any case.
    """
    points = np.concatenate([graph.positions_m[:, :2], graph.outlines_m.reshape(-1, 2)])
    place, background = ground(grid, points)
    layers = [
        background,
        _outlines(graph, place),
        _local_slam(graph, place),
        _trajectories(graph, place, frozen=True),
        _trajectories(graph, place, frozen=False),
        *_closures(graph, place),
        _rejected(graph, place),
        _nodes(graph, place),
    ]
    return layered_drawing(
        [layer for layer in layers if layer is not None and layer.markup], place, "map with pose graph"
    )


def _outlines(graph: GraphArrays, place: Place) -> Layer:
    parts = []
    known = np.flatnonzero(np.isfinite(graph.outlines_m).all(axis=(1, 2)))
    opacity = min(0.6, max(0.15, 8.0 / max(len(known), 1)))  # those of many lie over each other
    for i in known.tolist():
        corners = place(graph.outlines_m[i])
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in corners)
        parts.append(
            f'<path class="outline" stroke-opacity="{opacity:.2f}" d="M{path}Z"><title>submap {escape(graph.submap_names[i])}</title></path>'
        )
    parts += [
        f'<text class="name" x="{x:.1f}" y="{y - 5:.1f}" text-anchor="middle">{escape(words)}</text>'
        for x, y, words in _labels(graph, place, known)
    ]
    return Layer(f"submaps ({len(graph.submap_names):,})", "".join(parts), key="outline")


def _labels(graph: GraphArrays, place: Place, known: NDArray[np.int64]) -> list[tuple[float, float, str]]:
    """Return places and words of the submaps' labels; those that would lie over each other become one."""
    groups: dict[tuple[int, int], list[int]] = {}
    at = place(graph.centres_m[known])
    for i, (x, y) in zip(known.tolist(), at.tolist(), strict=True):
        groups.setdefault((round(x / _LABEL_WIDTH), round(y / _LABEL_HEIGHT)), []).append(i)
    found = []
    for its in groups.values():
        x, y = place(graph.centres_m[its[:1]])[0].tolist()
        words = ", ".join(graph.submap_names[i] for i in its[:_LABELS_AT_ONE])
        found.append((x, y, words + (" …" if len(its) > _LABELS_AT_ONE else "")))
    return found


def _trajectories(graph: GraphArrays, place: Place, *, frozen: bool) -> Layer:
    chosen = [t for t in np.unique(graph.trajectories).tolist() if (t in graph.frozen) == frozen]
    parts = [
        f'<path class="track {"alone" if frozen else f"t{t % 4}"}" d="{polyline(thinned(place(graph.positions_m[graph.trajectories == t, :2])))}"/>'
        for t in chosen
    ]
    word = "frozen trajector" if frozen else "trajector"
    label = f"{word}y" if len(parts) == 1 else f"{word}ies ({len(parts)})"
    return Layer(label, "".join(parts), key="track alone" if frozen else f"track t{chosen[0] % 4}" if chosen else "")


def _local_slam(graph: GraphArrays, place: Place) -> Layer:
    paths = [
        polyline(thinned(place(graph.local_positions_m[graph.trajectories == trajectory, :2])))
        for trajectory in np.unique(graph.trajectories)
    ]
    markup = f'<path class="alone" d="{"".join(paths)}"/>' if paths else ""
    return Layer("by local SLAM alone", markup, shown=False, key="alone")


def _nodes(graph: GraphArrays, place: Place) -> Layer:
    at = thinned(place(graph.positions_m[:, :2]))
    return Layer(
        f"nodes ({len(graph.stamps_ns):,})", f'<path class="nodes" d="{dots(at)}"/>' if len(at) else "", key="nodes"
    )


def _closures(graph: GraphArrays, place: Place) -> list[Layer]:
    """Return one layer per class of residual, the worst last and so on top."""
    drawn = graph.inter & (graph.constraint_nodes >= 0) & (graph.constraint_submaps >= 0)
    classes = residual_classes(graph.residuals_m, graph.residuals_rad)
    layers = []
    for i, (_, _, words) in enumerate(RESIDUAL_CLASSES):
        its = np.flatnonzero(drawn & (classes == i))
        if len(its):
            lines = _lines(graph, place, graph.constraint_nodes[its], graph.constraint_submaps[its])
            # Hundreds of good ones must not hide the map; bad ones stay as they are.
            opacity = min(0.75, max(0.3, 120.0 / len(its))) if i < len(RESIDUAL_CLASSES) - 1 else 0.9
            layers.append(
                Layer(
                    f"loop constraints {words} ({len(its):,})",
                    f'<path class="loop r{i}" stroke-opacity="{opacity:.2f}" d="{lines}"/>',
                    key=f"loop r{i}",
                )
            )
    return layers


def _rejected(graph: GraphArrays, place: Place) -> Layer:
    its = np.flatnonzero(~graph.accepted & (graph.search_nodes >= 0) & (graph.search_submaps >= 0))
    owners = graph.owners[graph.search_nodes[its]]
    order = its[np.lexsort((its, -graph.scores[its], graph.search_submaps[its], owners))]
    pairs = np.column_stack([graph.owners[graph.search_nodes[order]], graph.search_submaps[order]])
    first = np.ones(len(order), dtype=bool)
    first[1:] = (pairs[1:] != pairs[:-1]).any(axis=1)
    best = order[first]
    lines = _lines(graph, place, graph.search_nodes[best], graph.search_submaps[best])
    label = f"rejected searches ({len(its):,}; the best of each pair of submaps)"
    return Layer(label, f'<path class="rejected" d="{lines}"/>' if len(best) else "", shown=False, key="rejected")


def _lines(graph: GraphArrays, place: Place, nodes: NDArray[np.int64], submaps: NDArray[np.int64]) -> str:
    every = max(1, -(-len(nodes) // _MOST_LINES))
    ends = np.column_stack([place(graph.positions_m[nodes[::every], :2]), place(graph.centres_m[submaps[::every]])])
    return "".join(f"M{a:.0f} {b:.0f}L{c:.0f} {d:.0f}" for a, b, c, d in np.unique(np.round(ends), axis=0))
