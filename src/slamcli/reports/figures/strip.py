# SPDX-License-Identifier: MIT
"""Pictures beside each other: what a recording's cameras saw at a few moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.reports import scales
from slamcli.reports.figures import plane, raster
from slamcli.reports.figures.raster import Pixels

_WIDTH = 200
_GAP = 8
_SIZE = 14


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StripRow:
    """One camera."""

    label: str
    pictures: Sequence[Pixels]
    """uint8 (H, W, 3), red-green-blue."""
    captions: Sequence[str]


def strip_image(rows: Sequence[StripRow]) -> Pixels:
    """Return uint8 (H, W, 3): one row of pictures per camera, each 200 pixels wide, on white."""
    drawn = [_row(row) for row in rows if row.pictures]
    if not drawn:
        return np.full((0, 0, 3), 255, dtype=np.uint8)
    page = np.full((sum(len(row) for row in drawn), max(row.shape[1] for row in drawn), 3), 255, dtype=np.uint8)
    top = 0
    for row in drawn:
        page[top : top + len(row), : row.shape[1]] = row
        top += len(row)
    return page


def shrunk(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return pixels (H, W) or (H, W, 3) at about the strip's width: every pixel the mean of a block, none in between."""
    step = max(1, round(pixels.shape[1] / _WIDTH))
    height, width = (size // step * step for size in pixels.shape[:2])
    blocks = pixels[:height, :width].reshape(height // step, step, width // step, step, *pixels.shape[2:])
    return np.asarray(blocks.mean(axis=(1, 3)).round(), dtype=np.uint8)


def depth_colours(depth_m: NDArray[np.float32], farthest_m: float) -> Pixels:
    """Return depth, float32 (H, W) in metres, as colours: dark is near, bright is far, grey is none."""
    known = np.isfinite(depth_m) & (depth_m > 0)
    share = np.where(known, np.clip(np.nan_to_num(depth_m) / max(farthest_m, 1e-6), 0, 1), 0)
    colours = np.asarray(scales.time_colours(share.reshape(-1)), dtype=np.float64).reshape(*depth_m.shape, 3)
    colours[~known] = 225
    return colours.round().astype(np.uint8)


def _row(row: StripRow) -> Pixels:
    cells: list[Any] = [picture[:, :_WIDTH] for picture in row.pictures]
    height = max(cell.shape[0] for cell in cells)
    page = np.full((height + 4 * _SIZE, _GAP + len(cells) * (_WIDTH + _GAP), 3), 255, dtype=np.uint8)
    raster.text(page, (_GAP, 0.4 * _SIZE), row.label, _SIZE, plane.INK)
    top = round(1.9 * _SIZE)
    for number, (cell, caption) in enumerate(zip(cells, row.captions, strict=True)):
        left = _GAP + number * (_WIDTH + _GAP)
        page[top : top + cell.shape[0], left : left + cell.shape[1]] = cell
        raster.text(page, (left, top + height + 0.2 * _SIZE), caption, _SIZE, plane.INK)
    return page
