# SPDX-License-Identifier: MIT
"""A film of a result: the map grows, and on it the way, the robot, what it sees, and particles or the graph."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.pipelines.replay import Replay
from slamcli.pipelines.replay_tracks import GraphTrack
from slamcli.reports.figures import plane, raster
from slamcli.reports.figures.map import map_layer
from slamcli.reports.film import write_film
from slamcli.reports.film_painter import PEN, UNKNOWN, map_indices, write_words

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

FRAME_S = 0.1
_MOST_FRAMES = 200
_MOST_PIXELS = 640
_LEAST_WIDTH = 240
_HEADER_PX, _FOOTER_PX, _KEY_PX = 26, 24, 12
_MOST_PARTICLES = 300
_ARROW_PX = 11.0
_NEW_SHARE = 0.02
"""For which share of the film a loop is shown."""
_KEY = (("plan", "way"), ("trail", "truth"), ("scan", "scan"), ("estimate", "particles"), ("local plan", "new loops"))


def write_growth_film(target: Path, replay: Replay, *, title: str | None = None) -> dict[str, Any]:
    """Write a film of at most 200 frames as the suffix says (.gif or .mp4), and return its size for ``--json``.

    A second of it is a like share of the recorded time. The same replay gives the same GIF.

    Raises
    ------
    UsageError, DependencyError, ProcessError
        As `slamcli.reports.film.write_film`.
    """
    painter = _GrowthPainter(replay, replay.name if title is None else title)
    frames = frame_poses(replay.trajectory.stamps_ns)
    write_film(target, painter.frames(frames), frame_s=FRAME_S)
    width, height = painter.size
    return {"frames": len(frames), "width_px": width, "height_px": height, "growth": replay.growth}


def frame_poses(stamps_ns: NDArray[np.int64]) -> list[int]:
    """Return the last pose that each frame shows, of evenly spread times."""
    known = np.maximum.accumulate(stamps_ns)
    times = np.linspace(float(known[0] - known[0]), float(known[-1] - known[0]), min(_MOST_FRAMES, len(known)))
    places = np.searchsorted(known - known[0], np.rint(times).astype(np.int64), side="right") - 1
    return [*dict.fromkeys(np.clip(places, 0, len(known) - 1).tolist())]


class _GrowthPainter:
    """Draws moments of one replay, all of the same size.

    Parameters
    ----------
    replay
        The result.
    title
        What stands above it.
    """

    def __init__(self, replay: Replay, title: str) -> None:
        self._replay, self._title = replay, title
        self._way = replay.trajectory.positions_m[:, :2]
        shown = self._way if replay.truth is None else np.concatenate([self._way, replay.truth.positions_m[:, :2]])
        if replay.grid is not None:
            colours, self._view = map_layer(replay.grid, shown, _MOST_PIXELS)
            self._ground = map_indices(colours)
            self._seen = _seen_pixels(replay, self._view, self._ground != UNKNOWN)
        else:
            self._view = plane.fit_view(shown, _MOST_PIXELS)
            self._ground = np.zeros((self._view.height_px, self._view.width_px), dtype=np.uint8)
            self._seen = np.zeros(self._ground.shape, dtype=np.int64)
        self._known_ns = np.maximum.accumulate(replay.trajectory.stamps_ns)
        self._footer = _footer(self.size[0], _pens(replay))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of frames in pixels."""
        return max(self._view.width_px, _LEAST_WIDTH), self._view.height_px + _HEADER_PX + _FOOTER_PX

    def frames(self, poses: list[int]) -> Iterator[Pixels]:
        """Yield a frame for each pose, uint8 (H, W), indices of `film_painter.palette`."""
        return (self._frame(i) for i in poses)

    def _frame(self, i: int) -> Pixels:
        from PIL import Image, ImageDraw

        time = int(self._known_ns[i])
        frame = np.zeros(self.size[::-1], dtype=np.uint8)
        frame[_HEADER_PX:-_FOOTER_PX] = UNKNOWN
        below = np.where(self._seen <= i, self._ground, np.uint8(UNKNOWN))
        frame[_HEADER_PX:-_FOOTER_PX, : below.shape[1]] = below
        self._dots(frame, self._particles(time), "estimate", 2)
        self._dots(frame, self._scan(i), "scan", 2)
        picture = Image.fromarray(frame)
        draw = ImageDraw.Draw(picture)
        self._graph(draw, time)
        if self._replay.truth is not None:
            truth = self._replay.truth
            self._line(draw, truth.positions_m[truth.stamps_ns <= time, :2], "trail")
        self._line(draw, self._way[: i + 1], "plan")
        self._robot(draw, i)
        drawn = np.array(picture)
        drawn[:_HEADER_PX], drawn[-_FOOTER_PX:] = 0, self._footer
        drawn[_HEADER_PX - 1] = 3
        passed = f"{(time - int(self._known_ns[0])) / 1e9:.1f} s"
        write_words(drawn, 8, passed, 15, _HEADER_PX)
        write_words(drawn, drawn.shape[1] - 8 - raster.text_width(self._title, 15), self._title, 15, _HEADER_PX)
        return drawn

    def _particles(self, time_ns: int) -> Array:
        track = self._replay.particles
        if track is None or time_ns < track.stamps_ns[0]:
            return np.zeros((0, 2))
        step = track.poses[int(np.searchsorted(track.stamps_ns, time_ns, side="right")) - 1, :, :2]
        there = step[np.isfinite(step).all(axis=1)].astype(np.float64)
        return there[:: max(1, math.ceil(len(there) / _MOST_PARTICLES))]

    def _scan(self, i: int) -> Array:
        """Return the points (N, 2) of the last scan up to a pose."""
        track = self._replay.scans
        place = -1 if track is None else int(np.searchsorted(track.pose_index, i, side="right")) - 1
        if track is None or place < 0:
            return np.zeros((0, 2))
        return track.points_m[track.offsets[place] : track.offsets[place + 1]].astype(np.float64)

    def _graph(self, draw: Any, time_ns: int) -> None:
        """Draw the loops that were closed just now: all of them would hide the map."""
        graph = self._replay.graph
        if graph is None:
            return
        since = time_ns - _NEW_SHARE * float(self._known_ns[-1] - self._known_ns[0])
        its = (graph.kinds == GraphTrack.KINDS.index("loop")) & (graph.edge_stamps_ns <= time_ns)
        its &= graph.edge_stamps_ns > since
        for ends in graph.positions_m[graph.edges[its]][:, :, :2]:
            self._line(draw, ends, "local plan", 1)

    def _robot(self, draw: Any, i: int) -> None:
        """Draw an arrow that is as large on every map."""
        pose = self._replay.trajectory.poses_se2[i]
        reach = _ARROW_PX * self._view.metres_per_px
        outline = reach * np.array([[1.0, 0.0], [-0.7, 0.7], [-0.35, 0.0], [-0.7, -0.7]])
        at = self._pixels(se2.transform_points(pose, outline))
        draw.polygon([tuple(point) for point in at.tolist()], fill=PEN["robot"], outline=PEN["rim"])

    def _line(self, draw: Any, points_m: Array, pen: str, width: int = 2) -> None:
        if len(points_m) > 1:
            draw.line([tuple(point) for point in self._pixels(points_m).tolist()], fill=PEN[pen], width=width)

    def _dots(self, frame: Pixels, points_m: Array, pen: str, size: int) -> None:
        at = np.round(self._pixels(points_m) - (size - 1) / 2).astype(np.int64)
        for dx in range(size):
            for dy in range(size):
                x, y = at[:, 0] + dx, at[:, 1] + dy
                inside = (x >= 0) & (y >= _HEADER_PX) & (x < frame.shape[1]) & (y < frame.shape[0] - _FOOTER_PX)
                frame[y[inside], x[inside]] = PEN[pen]

    def _pixels(self, points_m: Array) -> Array:
        """Return where points are for Pillow, whose whole numbers are the centres of pixels."""
        return self._view.pixels(points_m) + np.array([-0.5, _HEADER_PX - 0.5])


def _seen_pixels(replay: Replay, view: plane.View, known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return int64 (H, W): the pose at which each pixel of the map is shown first."""
    seen, grid = replay.first_seen, replay.grid
    if seen is None or grid is None:
        return np.zeros(known.shape, dtype=np.int64)
    x = view.left_m + (np.arange(view.width_px) + 0.5) * view.metres_per_px
    y = view.bottom_m + (view.height_px - np.arange(view.height_px) - 0.5) * view.metres_per_px
    centres = np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))])
    cells = grid.map_to_cell(centres)
    inside = grid.contains(cells)
    found = np.full(len(cells), -1, dtype=np.int64)
    found[inside] = seen[cells[inside, 0], cells[inside, 1]]
    at = found.reshape(known.shape)
    if (at >= 0).all() or not (at >= 0).any():
        return np.maximum(at, 0)
    from scipy import ndimage

    # A pixel may hold several cells: a wall that is kept in it, and an unknown cell in its middle.
    nearest = ndimage.distance_transform_edt(at < 0, return_distances=False, return_indices=True)
    return np.asarray(at[tuple(nearest)], dtype=np.int64)


def _pens(replay: Replay) -> set[str]:
    """Return the pens that the replay needs."""
    there = {"plan": True, "trail": replay.truth is not None, "scan": replay.scans is not None}
    there |= {"estimate": replay.particles is not None, "local plan": _has_loops(replay)}
    return {pen for pen, is_there in there.items() if is_there}


def _has_loops(replay: Replay) -> bool:
    graph = replay.graph
    return graph is not None and bool((graph.kinds == GraphTrack.KINDS.index("loop")).any())


def _footer(width: int, pens: set[str]) -> Pixels:
    """Return a strip (_FOOTER_PX, width) that says what colours mean, as much of it as there is room for."""
    strip = np.zeros((_FOOTER_PX, width), dtype=np.uint8)
    strip[0] = 3
    left = 8
    for pen, words in _KEY:
        length = raster.text_width(words, _KEY_PX)
        if pen in pens and left + 22 + length <= width:
            strip[_FOOTER_PX // 2 - 2 : _FOOTER_PX // 2 + 3, left : left + 14] = PEN[pen]
            write_words(strip, left + 18, words, _KEY_PX, _FOOTER_PX)
            left += 34 + length
    return strip
