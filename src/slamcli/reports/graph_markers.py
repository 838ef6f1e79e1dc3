# SPDX-License-Identifier: MIT
"""A pose graph as markers, so that RViz and Foxglove show it in the colours of the report."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.posegraph import MapState
from slamcli.recordings.adapters import Marker, StampedMarkers
from slamcli.reports import scales
from slamcli.reports.graph_arrays import GraphArrays, graph_arrays
from slamcli.reports.graph_map import RESIDUAL_CLASSES, residual_classes

_FRAME = "map"
_RESIDUALS = (scales.SKY, scales.BLUE, scales.ORANGE, scales.VERMILION)


def graph_markers(state: MapState, stamp_ns: int) -> dict[str, StampedMarkers]:
    """Return markers by topic: outlines and names of submaps, nodes, and loop constraints, a namespace for each class of residual.

    Topics that would be empty are left out.
    """
    graph = graph_arrays(state)
    found = {
        "/submaps": _submaps(graph, np.array([s.T_map_submap[2, 3] for s in state.submaps])),
        "/nodes": _nodes(graph),
        "/constraints": _constraints(graph, np.array([s.T_map_submap[:3, 3] for s in state.submaps]).reshape(-1, 3)),
    }
    return {
        topic: StampedMarkers(stamp_ns=stamp_ns, frame_id=_FRAME, markers=tuple(markers))
        for topic, markers in found.items()
        if markers
    }


def _submaps(graph: GraphArrays, heights_m: NDArray[np.float64]) -> list[Marker]:
    known = np.flatnonzero(np.isfinite(graph.outlines_m).all(axis=(1, 2)))
    if not len(known):
        return []
    corners = graph.outlines_m[known]
    lines = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    green = _colour(scales.GREEN)
    outlines = np.column_stack([lines, np.repeat(heights_m[known], 8)])
    markers = [Marker(namespace="outlines", shape="lines", points_m=outlines, colours=green, size_m=0.03)]
    for i in known.tolist():
        place = np.array([[*graph.centres_m[i], heights_m[i]]])
        name = graph.submap_names[i]
        markers.append(Marker(namespace="names", shape="text", points_m=place, colours=green, size_m=0.5, text=name))
    return markers


def _nodes(graph: GraphArrays) -> list[Marker]:
    if not len(graph.positions_m):
        return []
    dark = _colour((29, 33, 41))
    return [Marker(namespace="nodes", shape="points", points_m=graph.positions_m, colours=dark, size_m=0.08)]


def _constraints(graph: GraphArrays, origins_m: NDArray[np.float64]) -> list[Marker]:
    """Return loop constraints as lines from the node to where the robot was in the middle of building the submap."""
    drawn = graph.inter & (graph.constraint_nodes >= 0) & (graph.constraint_submaps >= 0)
    classes = residual_classes(graph.residuals_m, graph.residuals_rad)
    markers = []
    for k, (_, _, words) in enumerate(RESIDUAL_CLASSES):
        its = drawn & (classes == k)
        if not its.any():
            continue
        starts = graph.positions_m[graph.constraint_nodes[its]]
        middles = graph.middles[graph.constraint_submaps[its]]
        ends = np.where((middles >= 0)[:, None], graph.positions_m[middles], origins_m[graph.constraint_submaps[its]])
        lines = np.stack([starts, ends], axis=1).reshape(-1, 3)
        colour = _colour(_RESIDUALS[k])
        markers.append(Marker(namespace=words, shape="lines", points_m=lines, colours=colour, size_m=0.03))
    return markers


def _colour(rgb: tuple[int, int, int]) -> NDArray[np.float64]:
    return np.array([[*(c / 255 for c in rgb), 1.0]])
