# SPDX-License-Identifier: MIT
"""The parts of a report that show what a camera saw: pictures of keyframes, both sides of loops, the graph from above."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.posegraph.keyframe_graph import KeyframeGraph
from slamcli.posegraph.place_closure import PlaceClosure
from slamcli.reports import page
from slamcli.reports.keyframe_map import keyframe_map
from slamcli.trajectory import Trajectory
from slamcli.vision.pictures import KeyframeView, Picture, PlaceView

_MOST_BYTES = 420_000
"""Of all pictures together, before their third more as text."""
_MOST_MATCHES = 80
"""Lines of a loop; of more matches every so manieth is drawn."""
_GAP = 12
_WORDS = {
    "loop": "Here a loop was closed", "join": "Here two maps were joined",
    "near": "Here a place near by was known again", "refused": "Refused",
}  # fmt: skip

_GRAPH_CAPTION = (
    "Switches above show and hide what is drawn. Keyframes are tied where they share points of the map; the spanning tree hangs each on the "
    "one it was made beside. Where the camera came back and no line ties old and new keyframes, a loop was not found."
)
_PICTURE_CAPTION = (
    "Dots are key points that see a point of the map. Few dots, or dots on one side only, are places where the track hangs by little: "
    "blank walls, blur, darkness, or nothing near enough."
)
_NODE_CAPTION = (
    "Switches above show and hide what is drawn. Nodes follow each other by odometry, and are tied where a place was known again by its looks (loops) "
    "or because it is near. Where the robot came back and no line ties old and new nodes, a loop was not found: see the refused ones."
)
_NODE_PICTURE_CAPTION = "Dots are key points whose place in space is known: these alone can be compared with other nodes. Few of them are nodes that are hard to know again."
_MATCH_CAPTION = "Lines tie the key points that agree with the motion between both nodes. Lines that cross wildly are wrong matches. Of a refused closure without lines no motion was found."
_LOOP_CAPTION = "Points of the final map that both keyframes see. Lines that cross wildly are wrong matches."


def keyframe_sections(
    graph: KeyframeGraph | None,
    views: Sequence[KeyframeView],
    places: Sequence[PlaceView],
    grid: OccupancyGrid | None,
    trajectory: Trajectory | None,
    began_ns: int | None = None,
    closures: Sequence[PlaceClosure] = (),
) -> list[str]:
    """Return the sections as markup, none without a graph; pictures stay below half a megabyte together.

    Times are those since `began_ns`; None: since the first keyframe. Refused `closures` are a layer of the graph.
    """
    if graph is None or not len(graph.stamps_ns):
        return []
    began_ns = int(graph.stamps_ns[0]) if began_ns is None else began_ns
    loops, left = list[str](), _MOST_BYTES
    for place in places:
        left -= len(place.older.picture.jpeg) + len(place.newer.picture.jpeg)
        if left >= 0:
            loops.append(_loop(place, began_ns))
    measured = graph.T_first_second is not None
    drawn = keyframe_map(graph, grid, trajectory, _refused_pairs(graph, closures))
    told = _MATCH_CAPTION if measured else _LOOP_CAPTION
    return [
        page.section(
            "Graph of nodes" if measured else "Keyframes",
            page.figure(drawn, caption=_NODE_CAPTION if measured else _GRAPH_CAPTION),
            _pictures(views, left, began_ns, _NODE_PICTURE_CAPTION if measured else _PICTURE_CAPTION),
        ),
        page.section("Places seen again", *loops, f'<p class="soft">{told}</p>' if loops else ""),
    ]


def _refused_pairs(graph: KeyframeGraph, closures: Sequence[PlaceClosure]) -> NDArray[np.int64]:
    """Return the rows (P, 2) of nodes between which closures were refused and no other was accepted."""
    if graph.ids is None:
        return np.zeros((0, 2), dtype=np.int64)
    row_of = {node: row for row, node in enumerate(graph.ids.tolist())}
    tied = {(int(a), int(b)) for a, b in graph.pairs}
    pairs = {
        (row_of[one.older_node], row_of[one.node])
        for one in closures
        if not one.accepted and one.older_node in row_of and one.node in row_of
    }
    return np.array(sorted(pairs - tied), dtype=np.int64).reshape(-1, 2)


def _pictures(views: Sequence[KeyframeView], most_bytes: int, began_ns: int, caption: str) -> str:
    """Return as many of the pictures as have room, spread evenly."""
    size = max((len(view.picture.jpeg) for view in views), default=1)
    room = min(len(views), max(0, most_bytes) // size)
    if not room:
        return ""
    chosen = [views[i] for i in np.unique(np.rint(np.linspace(0, len(views) - 1, room)).astype(int)).tolist()]
    boxes = "".join(
        f"<div>{_drawing([(view.picture, 0, view.places)], '')}{_when(view, began_ns)} · {len(view.places):,} of {view.num_features:,} key points</div>"
        for view in chosen
    )
    return page.figure(f'<div class="thumbs shots">{boxes}</div>', "What the camera saw", caption)


def _loop(place: PlaceView, began_ns: int) -> str:
    older, newer = place.older, place.newer
    across = older.picture.width + _GAP
    every = max(1, -(-len(older.places) // _MOST_MATCHES))
    # In the order of the rows: neighbours of neighbours are left out alike in all parts of the picture.
    order = np.lexsort((older.places[:, 0], older.places[:, 1]))[::every]
    ends = np.column_stack([older.places[order] + 0.5, newer.places[order] + [across + 0.5, 0.5]])
    lines = "".join(
        f'<path class="match k{i % 6}" d="M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}"/>' for i, (a, b, c, d) in enumerate(ends)
    )
    drawing = _drawing([(older.picture, 0, older.places[order]), (newer.picture, across, newer.places[order])], lines)
    shown = "" if every == 1 else f", {len(order):,} of them drawn"
    common = f"{len(older.places):,} common points{shown}."
    told = f"{_WORDS[place.kind]}: {common}"
    if place.kind == "refused":
        told = f"Refused: {place.reason}." + (f" {common}" if len(order) else "")
    return page.figure(drawing, f"{_when(older, began_ns)} and {_when(newer, began_ns)}", told)


def _drawing(pictures: Sequence[tuple[Picture, int, NDArray[np.float64]]], lines: str) -> str:
    """Return pictures side by side with dots at places (N, 2) of each, and lines over all."""
    parts = []
    for picture, left, places in pictures:
        data = base64.b64encode(picture.jpeg).decode("ascii")
        parts.append(
            f'<image x="{left}" y="0" width="{picture.width}" height="{picture.height}" href="data:image/jpeg;base64,{data}"/>'
        )
        points = "".join(f"M{x + left + 0.5:.1f} {y + 0.5:.1f}h0" for x, y in places.tolist())
        parts.append(f'<path class="rim" d="{points}"/><path class="point" d="{points}"/>' if points else "")
    width = max(left + picture.width for picture, left, _ in pictures)
    height = max(picture.height for picture, _, _ in pictures)
    return (
        f'<svg class="shot" viewBox="0 0 {width} {height}" role="img" aria-label="what the camera saw">'
        f"{''.join(parts)}{lines}</svg>"
    )


def _when(view: KeyframeView, began_ns: int) -> str:
    """Return the name of a picture and when it was taken."""
    when = _seconds(view.stamp_ns, began_ns) if view.of_this_run else "an earlier session"
    return f"{view.name} ({when})" if view.name else when


def _seconds(stamp_ns: int, began_ns: int) -> str:
    return f"{(stamp_ns - began_ns) / 1e9:.1f} s"
