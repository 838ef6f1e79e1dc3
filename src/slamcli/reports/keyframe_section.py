# SPDX-License-Identifier: MIT
"""The parts of a report that show what a camera saw: pictures of keyframes, both sides of loops, the graph from above."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.posegraph.keyframe_graph import KeyframeGraph
from slamcli.reports import page
from slamcli.reports.keyframe_map import keyframe_map
from slamcli.trajectory import Trajectory
from slamcli.vision.pictures import KeyframeView, Picture, PlaceView

_MOST_BYTES = 420_000
"""Of all pictures together, before their third more as text."""
_MOST_MATCHES = 80
"""Lines of a loop; of more matches every so manieth is drawn."""
_GAP = 12

_GRAPH_CAPTION = (
    "Switches above show and hide what is drawn. Keyframes are tied where they share points of the map; the spanning tree hangs each on the "
    "one it was made beside. Where the camera came back and no line ties old and new keyframes, a loop was not found."
)
_PICTURE_CAPTION = (
    "Dots are key points that see a point of the map. Few dots, or dots on one side only, are places where the track hangs by little: "
    "blank walls, blur, darkness, or nothing near enough."
)
_LOOP_CAPTION = "Points of the final map that both keyframes see. Lines that cross wildly are wrong matches."


def keyframe_sections(
    graph: KeyframeGraph | None,
    views: Sequence[KeyframeView],
    places: Sequence[PlaceView],
    grid: OccupancyGrid | None,
    trajectory: Trajectory | None,
    began_ns: int | None = None,
) -> list[str]:
    """Return the sections as markup, none without a graph; pictures stay below half a megabyte together.

    Times are those since `began_ns`; None: since the first keyframe.
    """
    if graph is None or not len(graph.stamps_ns):
        return []
    began_ns = int(graph.stamps_ns[0]) if began_ns is None else began_ns
    loops, left = list[str](), _MOST_BYTES
    for place in places:
        left -= len(place.older.picture.jpeg) + len(place.newer.picture.jpeg)
        if left >= 0:
            loops.append(_loop(place, began_ns))
    return [
        page.section(
            "Keyframes",
            page.figure(keyframe_map(graph, grid, trajectory), caption=_GRAPH_CAPTION),
            _pictures(views, left, began_ns),
        ),
        page.section("Places seen again", *loops, f'<p class="soft">{_LOOP_CAPTION}</p>' if loops else ""),
    ]


def _pictures(views: Sequence[KeyframeView], most_bytes: int, began_ns: int) -> str:
    """Return as many of the pictures as have room, spread evenly."""
    size = max((len(view.picture.jpeg) for view in views), default=1)
    room = min(len(views), max(0, most_bytes) // size)
    if not room:
        return ""
    chosen = [views[i] for i in np.unique(np.rint(np.linspace(0, len(views) - 1, room)).astype(int)).tolist()]
    boxes = "".join(
        f"<div>{_drawing([(view.picture, 0, view.places)], '')}{_seconds(view.stamp_ns, began_ns)} · {len(view.places):,} of {view.num_features:,} key points</div>"
        for view in chosen
    )
    return page.figure(f'<div class="thumbs shots">{boxes}</div>', "What the camera saw", _PICTURE_CAPTION)


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
    words = "a loop was closed" if place.kind == "loop" else "two maps were joined"
    shown = "" if every == 1 else f", {len(order):,} of them drawn"
    return page.figure(
        drawing,
        f"{_seconds(older.stamp_ns, began_ns)} and {_seconds(newer.stamp_ns, began_ns)}",
        f"Here {words}: {len(older.places):,} common points{shown}.",
    )


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


def _seconds(stamp_ns: int, began_ns: int) -> str:
    return f"{(stamp_ns - began_ns) / 1e9:.1f} s"
