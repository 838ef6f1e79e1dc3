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


def keyframe_map(graph: KeyframeGraph, grid: OccupancyGrid | None, trajectory: Trajectory | None) -> str:
    """Return the drawing as markup: map, covisibility, spanning tree, trajectory, keyframes, loops.

    Of pairs that share points, at most some thousand are drawn, those that share most.
    """
    at_m = graph.T_map_base[:, :2, 3]
    track_m = trajectory.positions_m[:, :2] if trajectory is not None else np.empty((0, 2))
    place, background = ground(grid, np.concatenate([at_m, track_m]))
    covisible = graph.of_kind("covisible")
    strongest = np.sort(covisible[np.argsort(-graph.shared[covisible], kind="stable")[:_MOST_LINES]])
    tree, loops = graph.of_kind("tree"), graph.of_kind("loop")
    layers = [
        background,
        _edges(f"share 15 points or more ({len(covisible):,})", "shared", graph, strongest, place),
        _edges("spanning tree", "loop r1", graph, tree, place),
        Layer("trajectory", f'<path class="track t0" d="{polyline(thinned(place(track_m)))}"/>', key="track t0")
        if len(track_m)
        else None,
        Layer(
            f"keyframes ({len(at_m):,})", f'<path class="keyframes" d="{dots(thinned(place(at_m)))}"/>', key="keyframes"
        ),
        _edges(f"loops ({len(loops):,})", "loop r3", graph, loops, place),
    ]
    return layered_drawing(
        [layer for layer in layers if layer is not None and layer.markup], place, "keyframes from above"
    )


def _edges(label: str, kind: str, graph: KeyframeGraph, edges: NDArray[np.int64], place: Place) -> Layer:
    ends = place(graph.T_map_base[graph.pairs[edges].ravel(), :2, 3]).reshape(-1, 4)
    lines = "".join(f"M{a:.0f} {b:.0f}L{c:.0f} {d:.0f}" for a, b, c, d in np.unique(np.round(ends), axis=0))
    return Layer(label, f'<path class="{kind}" d="{lines}"/>' if lines else "", key=kind)
