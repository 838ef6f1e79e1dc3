# SPDX-License-Identifier: MIT
"""Pictures for a mesh: each triangle takes its colours from the view that shows it best.

After Waechter, Moehrle and Goesele, "Let There Be Color! Large-Scale Texturing of 3D Reconstructions", ECCV 2014, in small: views are
judged by the area of the triangle in them, neighbours agree on views by majority, and views are made equally bright.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.grids.depth_mesh import Mesh
from slamcli.vision.posed_view import DepthViews, PosedView

_KEPT = 4
"""Views that each triangle remembers."""
_GOOD = 0.5
"""Share of the area in the best view from which another view is as good."""
_ROUNDS = 6
_BORDER_PX, _NEAREST_M = 2.0, 0.1
_ATLAS_PX, _MOST_VIEWS = 8192, 120
_PALETTE_STEPS, _PALETTE_PX = 16, 4
"""Colours of triangles that no view shows: so many of each channel, each a square of so many pixels."""
_GAINS = (0.7, 1.4)


class TexturedMesh(NamedTuple):
    """Triangles in the map frame, and the picture that lies on them."""

    vertices: NDArray[np.float32]
    """float32 (V, 3), metres."""
    triangles: NDArray[np.int32]
    """int32 (F, 3), rows of `vertices`."""
    places: NDArray[np.float32]
    """float32 (P, 2): u to the right and v up, shares of the picture."""
    corners: NDArray[np.int64]
    """int64 (F, 3), rows of `places` of each triangle's corners."""
    picture: NDArray[np.uint8]
    """uint8 (H, W, 3), red, green, blue."""


def textured(mesh: Mesh, views: DepthViews, tolerance_m: float) -> TexturedMesh:
    """Return a mesh with pictures.

    Parameters
    ----------
    views
        Gone through twice: to choose, and to take the pictures. Of many the 120 that show most triangles best are used.
    tolerance_m
        How far the depth of a view may lie from the mesh that it shows.
    """
    if len(mesh.triangles) == 0:
        none = np.zeros((0, 2), np.float32), np.zeros((0, 3), np.int64), np.zeros((1, 1, 3), np.uint8)
        return TexturedMesh(mesh.vertices, mesh.triangles, *none)
    ranking = _Ranking(mesh, tolerance_m)
    for number, view in enumerate(views):
        ranking.add(number, view)
    choice = ranking.choice()
    return _painted(mesh, choice, views)


class _Ranking:
    """The best views of every triangle."""

    def __init__(self, mesh: Mesh, tolerance_m: float) -> None:
        self._mesh, self._tolerance = mesh, tolerance_m
        self._areas = np.zeros((len(mesh.triangles), _KEPT), dtype=np.float32)
        self._views = np.full((len(mesh.triangles), _KEPT), -1, dtype=np.int32)

    def add(self, number: int, view: PosedView) -> None:
        """Rank a view."""
        pixels, shown = _shown(self._mesh.vertices, view, self._tolerance)
        rows = np.flatnonzero(shown[self._mesh.triangles].all(axis=1))
        a, b, c = np.swapaxes(pixels[self._mesh.triangles[rows]], 0, 1)
        # Seen from the front, corners run clockwise: y points down in images.
        area = ((c - a)[:, 0] * (b - a)[:, 1] - (c - a)[:, 1] * (b - a)[:, 0]) / 2.0
        rows, area = rows[area > 0.0], area[area > 0.0].astype(np.float32)
        place = (self._areas[rows] >= area[:, None]).sum(axis=1)
        for slot in range(_KEPT - 1, -1, -1):
            at = rows[place == slot]
            self._areas[at, slot + 1 :] = self._areas[at, slot:-1].copy()
            self._views[at, slot + 1 :] = self._views[at, slot:-1].copy()
            self._areas[at, slot], self._views[at, slot] = area[place == slot], number

    def choice(self) -> NDArray[np.int32]:
        """Return the view of every triangle; -1 where none shows it."""
        used, counts = np.unique(self._views[:, 0][self._views[:, 0] >= 0], return_counts=True)
        if len(used) > _MOST_VIEWS:
            kept = used[np.argsort(-counts, kind="stable")[:_MOST_VIEWS]]
            gone = ~np.isin(self._views, kept)
            order = np.argsort(gone, axis=1, kind="stable")
            self._views[gone], self._areas[gone] = -1, 0.0
            self._views = np.take_along_axis(self._views, order, axis=1)
            self._areas = np.take_along_axis(self._areas, order, axis=1)
        chosen = self._views[:, 0].copy()
        beside = _neighbours(self._mesh.triangles)
        usable = (self._views >= 0) & (self._areas >= _GOOD * self._areas[:, :1])
        for _ in range(_ROUNDS):
            around = np.where(beside >= 0, chosen[beside], -2)
            votes = (self._views[:, :, None] == around[:, None, :]).sum(axis=2) * usable
            best = np.argmax(votes, axis=1)
            row = np.arange(len(chosen))
            better = votes[row, best] > (around == chosen[:, None]).sum(axis=1)
            chosen = np.where(better, self._views[row, best], chosen)
        return chosen


def _shown(
    vertices: NDArray[np.float32], view: PosedView, tolerance_m: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the pixels (V, 2) of vertices, and which of them the view shows: in front of it, within the image, nothing before them."""
    T = se3.inverse(view.T_map_camera)
    points = vertices.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    shown = points[:, 2] > _NEAREST_M
    pixels = view.camera.project(np.where(shown[:, None], points, 1.0))
    height, width = view.depth.shape
    shown &= ((pixels >= _BORDER_PX) & (pixels <= (width - 1 - _BORDER_PX, height - 1 - _BORDER_PX))).all(axis=1)
    column, row = np.rint(pixels[shown]).astype(np.int64).T
    depth = view.depth[row, column]
    shown[shown] = (depth > 0.0) & (np.abs(depth - points[shown, 2]) <= tolerance_m)
    return pixels, shown


def _neighbours(triangles: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return int64 (F, 3): the triangle across each edge; -1 where there is none, or more than one."""
    count = len(triangles)
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    _, number, counts = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(number.ravel(), kind="stable")
    paired = counts[number.ravel()[order]] == 2
    pairs = order[paired].reshape(-1, 2)
    across = np.full(3 * count, -1, dtype=np.int64)
    across[pairs[:, 0]], across[pairs[:, 1]] = pairs[:, 1] % count, pairs[:, 0] % count
    return across.reshape(3, count).T


def _painted(mesh: Mesh, choice: NDArray[np.int32], views: DepthViews) -> TexturedMesh:
    """Return the mesh with the pictures of the chosen views side by side, and colours of its own where there is none."""
    used = np.unique(choice[choice >= 0])
    sheet: _Sheet | None = None
    pixels = np.zeros((len(mesh.triangles), 3, 2))
    for number, view in enumerate(views):
        if number not in used:
            continue
        if sheet is None:
            sheet = _Sheet(len(used), view.colour.shape[1], view.colour.shape[0])
        rows = np.flatnonzero(choice == number)
        seen = _shown(mesh.vertices[mesh.triangles[rows]].reshape(-1, 3), view, np.inf)[0].reshape(-1, 3, 2)
        slot = int(np.searchsorted(used, number))
        picture = _evened(view.colour, seen.reshape(-1, 2), mesh.colours[mesh.triangles[rows]].reshape(-1, 3))
        pixels[rows] = sheet.put(slot, picture, seen)
    if sheet is None:
        sheet = _Sheet(0, 1, 1)
    rest = np.flatnonzero(choice < 0)
    pixels[rest] = sheet.plain(mesh.colours[mesh.triangles[rest]].astype(np.float64).mean(axis=1))[:, None]
    height, width = sheet.picture.shape[:2]
    flat = np.column_stack([pixels[..., 0].ravel() / width, 1.0 - pixels[..., 1].ravel() / height]).astype(np.float32)
    places, corners = np.unique(flat, axis=0, return_inverse=True)
    return TexturedMesh(mesh.vertices, mesh.triangles, places, corners.reshape(-1, 3), sheet.picture)


def _evened(colour: NDArray[np.uint8], pixels: NDArray[np.float64], wanted: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image as bright as the mesh's own colours, which are means of all views, are where it is used."""
    column, row = np.rint(pixels).astype(np.int64).T
    there = colour[np.clip(row, 0, colour.shape[0] - 1), np.clip(column, 0, colour.shape[1] - 1)]
    gain = np.clip((wanted.mean(axis=0) + 1.0) / (there.mean(axis=0) + 1.0), *_GAINS)
    return np.rint(np.clip(colour * gain, 0.0, 255.0)).astype(np.uint8)


class _Sheet:
    """The picture: colours at the top, the views' images below in rows."""

    def __init__(self, count: int, width: int, height: int) -> None:
        self._top = _PALETTE_PX * int(_PALETTE_STEPS**1.5)
        self._columns = max(1, math.ceil(math.sqrt(count * height / width)))
        rows = math.ceil(count / self._columns)
        room = (_ATLAS_PX - self._top) / max(rows * height, 1)
        self._scale = min(1.0, _ATLAS_PX / (self._columns * width), room)
        self._size = max(1, int(width * self._scale)), max(1, int(height * self._scale))
        size = max(self._top, self._columns * self._size[0])
        self.picture = np.zeros((self._top + rows * self._size[1], size, 3), dtype=np.uint8)
        shades = np.linspace(0.0, 255.0, _PALETTE_STEPS).round().astype(np.uint8)
        palette = np.stack(np.meshgrid(shades, shades, shades, indexing="ij"), axis=-1)
        palette = palette.reshape(int(_PALETTE_STEPS**1.5), -1, 3)
        self.picture[: self._top, : self._top] = palette.repeat(_PALETTE_PX, axis=0).repeat(_PALETTE_PX, axis=1)

    def put(self, slot: int, image: NDArray[np.uint8], pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Put an image into its place; return where pixels (..., 2) of it lie on the sheet."""
        width, height = self._size
        x, y = slot % self._columns * width, self._top + slot // self._columns * height
        small = (
            image
            if image.shape[:2] == (height, width)
            else cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        )
        self.picture[y : y + height, x : x + width] = small
        ratio = np.array([width / image.shape[1], height / image.shape[0]])
        return (pixels + 0.5) * ratio + (x, y)

    def plain(self, colours: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where on the sheet colours (N, 3) lie."""
        steps = np.rint(colours / 255.0 * (_PALETTE_STEPS - 1)).astype(np.int64)
        number = (steps[:, 0] * _PALETTE_STEPS + steps[:, 1]) * _PALETTE_STEPS + steps[:, 2]
        wide = int(_PALETTE_STEPS**1.5)
        return (np.column_stack([number % wide, number // wide]) + 0.5) * _PALETTE_PX
