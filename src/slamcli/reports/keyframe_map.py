# SPDX-License-Identifier: MIT
"""The graph of keyframes from above, over the map and the trajectory, in layers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.posegraph.keyframe_graph import KeyframeGraph
from slamcli.reports.layers import Layer, Place, dots, ground, layered_drawing, polyline, thinned
from slamcli.trajectory import Trajectory

_MOST_LINES = 6000


def keyframe_map(
    graph: KeyframeGraph, grid: OccupancyGrid | None, trajectory: Trajectory | None, refused: NDArray[np.int64]
) -> str:
    """Return the drawing as markup: map, what ties keyframes or nodes, trajectory, they themselves, loops.

    Of pairs that share points, at most some thousand are drawn, those that share most; of pairs `refused` (P, 2) for a
    closure as many, evenly.
    """
    at_m = graph.T_map_base[:, :2, 3]
    track_m = trajectory.positions_m[:, :2] if trajectory is not None else np.empty((0, 2))
    place, background = ground(grid, np.concatenate([at_m, track_m]))
    track = polyline(thinned(place(track_m)))
    layers = [
        background,
        *_ties(graph, place),
        Layer("trajectory", f'<path class="track t0" d="{track}"/>', key="track t0") if len(track_m) else None,
        Layer(
            f"{'keyframes' if graph.T_first_second is None else 'nodes'} ({len(at_m):,})",
            f'<path class="keyframes" d="{dots(thinned(place(at_m)))}"/>',
            key="keyframes",
        ),
        *_closures(graph, refused, place),
    ]
    return layered_drawing(
        [layer for layer in layers if layer is not None and layer.markup], place, "keyframes from above"
    )


def _ties(graph: KeyframeGraph, place: Place) -> list[Layer]:
    """Return what makes the graph hang together, below the trajectory."""
    if graph.T_first_second is not None:
        odometry = graph.of_kind("odometry")
        return [_edges(f"odometry ({len(odometry):,})", "loop r1", graph, graph.pairs[odometry], place)]
    covisible = graph.of_kind("covisible")
    strongest = np.sort(covisible[np.argsort(-graph.shared[covisible], kind="stable")[:_MOST_LINES]])
    return [
        _edges(f"share 15 points or more ({len(covisible):,})", "shared", graph, graph.pairs[strongest], place),
        _edges("spanning tree", "loop r1", graph, graph.pairs[graph.of_kind("tree")], place),
    ]


def _closures(graph: KeyframeGraph, refused: NDArray[np.int64], place: Place) -> list[Layer]:
    """Return what was known again, above everything."""
    near, loops = graph.of_kind("proximity"), graph.of_kind("loop")
    few = refused[:: max(1, -(-len(refused) // _MOST_LINES))]
    return [
        _edges(f"refused closures ({len(refused):,})", "rejected", graph, few, place, shown=False),
        _edges(f"near ({len(near):,})", "loop r2", graph, graph.pairs[near], place),
        _edges(f"loops ({len(loops):,})", "loop r3", graph, graph.pairs[loops], place),
    ]


def _edges(
    label: str, kind: str, graph: KeyframeGraph, pairs: NDArray[np.int64], place: Place, *, shown: bool = True
) -> Layer:
    """Return lines between keyframes, whose rows are `pairs` (P, 2)."""
    ends = place(graph.T_map_base[pairs.ravel(), :2, 3]).reshape(-1, 4)
    lines = "".join(f"M{a:.0f} {b:.0f}L{c:.0f} {d:.0f}" for a, b, c, d in np.unique(np.round(ends), axis=0))
    return Layer(label, f'<path class="{kind}" d="{lines}"/>' if lines else "", shown, key=kind)
