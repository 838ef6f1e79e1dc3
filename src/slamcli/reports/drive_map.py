# SPDX-License-Identifier: MIT
"""The ways of a robot that drove itself, in layers over the map."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from slamcli.evaluation.drive_story import DriveStory
from slamcli.grids import OccupancyGrid
from slamcli.grids.crop import box_of_bounds, crop
from slamcli.reports.layers import Layer, Place, ground, layered_drawing, polyline, thinned

Array = NDArray[np.float64]

_MOST_PLANS = 60
_MARGIN_M = 4.0


def drive_map(story: DriveStory) -> str:
    """Return the drawing with switches for its layers, or nothing if the robot never was anywhere."""
    if not len(story.truth):
        return ""
    goals = np.array([goal.goal[:2] for goal in story.goals]).reshape(-1, 2)
    hold = np.concatenate([story.truth[:, :2], goals, *(plan[:, :2] for plan in story.plans)])
    place, below = ground(_part(story.grid, hold), hold)
    layers = [below] if below is not None else []
    layers += [
        _people(story, place),
        _plans(story, place),
        _ways("where it thought it was", _known(story.estimate), place, "believed"),
        _ways("where it was", [story.truth[:, :2]], place, "driven"),
        _marks("recoveries", _places(story, "recovery"), place, "recovery"),
        _marks("collisions", _places(story, "collision"), place, "collision"),
        _goals(story, place),
    ]
    return layered_drawing([layer for layer in layers if layer.markup], place, "the robot's way")


def _part(grid: OccupancyGrid | None, points_m: Array) -> OccupancyGrid | None:
    """Return the map around points (N, 2): of a large one the rest is not worth its room."""
    if grid is None or not grid.cells.size:
        return None
    low, high = points_m.min(axis=0) - _MARGIN_M, points_m.max(axis=0) + _MARGIN_M
    r0, c0, r1, c1 = box_of_bounds(grid, (float(low[0]), float(low[1]), float(high[0]), float(high[1])))
    if r1 <= 0 or c1 <= 0 or r0 >= grid.height or c0 >= grid.width:
        return None
    return crop(grid, (r0, c0, r1, c1))


def _known(poses: Array) -> list[Array]:
    known = np.isfinite(poses).all(axis=1)
    return [poses[known, :2]] if known.any() else []


def _people(story: DriveStory, place: Place) -> Layer:
    ways = [part for way in story.people_ways() for part in _inside(way, place)]
    return _ways(f"people ({len(ways)})" if len(ways) > 1 else "people", ways, place, "person")


def _inside(way: Array, place: Place) -> list[Array]:
    """Return the parts of a way that lie on the drawing."""
    at, frame = place(way), place.frame
    x_in = (at[:, 0] >= frame.left) & (at[:, 0] <= frame.right)
    inside = x_in & (at[:, 1] >= frame.top) & (at[:, 1] <= frame.bottom)
    cuts = np.flatnonzero(np.diff(inside.astype(np.int64))) + 1
    return [part for part, kept in zip(np.split(way, cuts), np.split(inside, cuts), strict=True) if kept[0]]


def _plans(story: DriveStory, place: Place) -> Layer:
    every = max(1, -(-len(story.plans) // _MOST_PLANS))
    label = f"plans ({len(story.plans)})" if len(story.plans) != 1 else "plan"
    return _ways(label, [plan[:, :2] for plan in story.plans[::every]], place, "planned")


def _ways(label: str, ways: Sequence[Array], place: Place, key: str) -> Layer:
    markup = "".join(f'<path class="{key}" d="{polyline(thinned(place(way)))}"/>' for way in ways if len(way) > 1)
    return Layer(label, markup, key=key)


def _places(story: DriveStory, kind: str) -> list[tuple[Array, str]]:
    return [(story.place_at(e.time_s), f"{e.time_s:.1f} s: {e.message}") for e in story.events if e.kind == kind]


def _marks(label: str, places: Sequence[tuple[Array, str]], place: Place, key: str) -> Layer:
    """Return crosses with words that show when pointed at."""
    parts = []
    for at, words in places:
        x, y = place(at[None])[0].tolist()
        cross = f"M{x - 5:.1f} {y - 5:.1f}l10 10m0 -10l-10 10"
        parts.append(f'<path class="{key}" d="{cross}"><title>{escape(words)}</title></path>')
    return Layer(f"{label} ({len(parts)})", "".join(parts), key=key)


def _goals(story: DriveStory, place: Place) -> Layer:
    """Return a ring for the start and for each goal, with its name."""
    named = [("start", story.truth[0, :2], True)]
    named += [(goal.name, np.array(goal.goal[:2]), goal.succeeded) for goal in story.goals]
    parts = []
    for name, at, good in named:
        x, y = place(at[None])[0].tolist()
        ring = f"M{x - 5:.1f} {y:.1f}a5 5 0 1 0 10 0a5 5 0 1 0 -10 0"
        parts.append(f'<path class="{"reached" if good else "missed"}" d="{ring}"/>')
        parts.append(f'<text class="name" x="{x:.1f}" y="{y - 8:.1f}" text-anchor="middle">{escape(name)}</text>')
    return Layer("goals", "".join(parts), key="reached")
