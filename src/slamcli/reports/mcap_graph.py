# SPDX-License-Identifier: MIT
"""The graph of a replay as markers that grow, in the colours of the report."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from slamcli.pipelines.replay import Replay
from slamcli.pipelines.replay_tracks import GraphTrack, SubmapTrack
from slamcli.recordings.adapters import Marker, StampedMarkers
from slamcli.reports import scales
from slamcli.reports.graph_map import RESIDUAL_CLASSES, residual_classes
from slamcli.reports.mcap_clock import Clock, Entry, moments

_RESIDUALS = (scales.SKY, scales.BLUE, scales.ORANGE, scales.VERMILION)
_DARK, _PALE = (29, 33, 41), (150, 158, 170)
_MOST_GRAPHS = 60
_GRAPH_BYTES = 40_000_000
"""Of all markers together before compression."""
_MOST_SHARED = 3000
"""Edges between keyframes that share points: there are many, and they tell little."""


def growing_submaps(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/submaps``: outlines and names of those that are finished."""
    track = replay.submaps
    if track is None:
        return
    known = np.isfinite(track.outlines_m).all(axis=(1, 2))
    finished = np.array([clock.log_ns(stamp) for stamp in track.finished_ns.tolist()], dtype=np.int64)
    times, amounts = np.unique(finished[known], return_counts=True)
    for i in moments(amounts, times, _MOST_GRAPHS):
        markers = _outlines(track, np.flatnonzero(known & (finished <= times[i])))
        stamped = StampedMarkers(stamp_ns=times[i].item(), frame_id=replay.trajectory.frame_id, markers=tuple(markers))
        yield Entry(times[i].item(), "/submaps", stamped)


def growing_graph(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/nodes`` and ``/constraints``: a namespace for each class of loops' residuals, and one for each other kind of edge."""
    graph = replay.graph
    if graph is None:
        return
    nodes = np.array([clock.log_ns(stamp) for stamp in graph.stamps_ns.tolist()], dtype=np.int64)
    edges = np.array([clock.log_ns(stamp) for stamp in graph.edge_stamps_ns.tolist()], dtype=np.int64)
    drawn = _drawn(graph)
    times, place = np.unique(np.concatenate([nodes, edges[drawn]]), return_inverse=True)
    amounts = np.bincount(place, minlength=len(times)).astype(np.int64)
    size = 24 * len(nodes) + 48 * int(drawn.sum())
    most = max(2, min(_MOST_GRAPHS, 2 * _GRAPH_BYTES // max(size, 1)))
    for i in moments(amounts, times, most):
        time, frame = times[i].item(), replay.trajectory.frame_id
        dots = Marker(
            namespace="nodes", shape="points", points_m=graph.positions_m[nodes <= time], colours=_colour(_DARK),
            size_m=0.08, number=0,
        )  # fmt: skip
        if len(dots.points_m):
            yield Entry(time, "/nodes", StampedMarkers(stamp_ns=time, frame_id=frame, markers=(dots,)))
        lines = _edges(graph, drawn & (edges <= time))
        if lines:
            yield Entry(time, "/constraints", StampedMarkers(stamp_ns=time, frame_id=frame, markers=tuple(lines)))


def _outlines(track: SubmapTrack, chosen: NDArray[np.int64]) -> list[Marker]:
    corners, heights = track.outlines_m[chosen], track.heights_m[chosen]
    lines = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    green = _colour(scales.GREEN)
    outlines = np.column_stack([lines, np.repeat(heights, 8)])
    markers = [Marker(namespace="outlines", shape="lines", points_m=outlines, colours=green, size_m=0.03, number=0)]
    for i, middle, height in zip(chosen.tolist(), corners.mean(axis=1), heights.tolist(), strict=True):
        place = np.array([[*middle, height]])
        markers.append(
            Marker(
                namespace="names",
                shape="text",
                points_m=place,
                colours=green,
                size_m=0.5,
                text=track.names[i],
                number=1 + i,
            )
        )
    return markers


def _drawn(graph: GraphTrack) -> NDArray[np.bool_]:
    """Return which edges are drawn (E,): all but some of those that only say that points are shared."""
    shared = np.flatnonzero(graph.kinds == GraphTrack.KINDS.index("covisible"))
    drawn = np.ones(len(graph.edges), dtype=bool)
    every = max(1, -(-len(shared) // _MOST_SHARED))
    drawn[shared] = np.arange(len(shared)) % every == 0
    return drawn


def _edges(graph: GraphTrack, chosen: NDArray[np.bool_]) -> list[Marker]:
    """Return one marker for each kind of edge and class of residual that is there; numbers stay with their kind."""
    loops = chosen & (graph.kinds == GraphTrack.KINDS.index("loop"))
    classes = residual_classes(np.nan_to_num(graph.residual_m), np.nan_to_num(graph.residual_rad))
    found = [(words, loops & (classes == k), _RESIDUALS[k], 0.03) for k, (_, _, words) in enumerate(RESIDUAL_CLASSES)]
    for kind, width in (("sequence", 0.02), ("covisible", 0.01)):
        found.append((kind, chosen & (graph.kinds == GraphTrack.KINDS.index(kind)), _PALE, width))
    return [
        Marker(
            namespace=name, shape="lines", points_m=graph.positions_m[graph.edges[its]].reshape(-1, 3), colours=_colour(rgb),
            size_m=width, number=number,
        )
        for number, (name, its, rgb, width) in enumerate(found)
        if its.any()
    ]  # fmt: skip


def _colour(rgb: tuple[int, int, int]) -> NDArray[np.float64]:
    return np.array([[*(c / 255 for c in rgb), 1.0]])
