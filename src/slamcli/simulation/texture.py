# SPDX-License-Identifier: MIT
"""Pictures on the surfaces of a world that a camera can follow: noise of several octaves, figures, letters and posters.

Every surface has a picture of its own, drawn from the world's seed, so that no place looks like another. Pictures carry a
pyramid of halved copies (mip levels), from which rays far away or at a slant read without aliasing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation import _texture_kernels

_FIGURE_CELL = 34.0
"""One figure for each square of so many texels a side, on a busy surface."""
_SMALLEST, _LARGEST = 4.0, 70.0
_POSTER_CELL = 420.0
_OCTAVES = ((256.0, 26.0), (64.0, 18.0), (16.0, 12.0), (5.0, 9.0))
"""Texels between values, and amplitude in grey levels, of the noise."""
_LEVELS = 14


@dataclass(frozen=True, slots=True, eq=False)
class Album:
    """The pictures of all surfaces with their mip levels, one behind the other."""

    texels: NDArray[np.uint8]
    """(N, C), C = 3 red, green, blue or 1 grey."""
    levels: NDArray[np.int64]
    """(T, 14, 3): of each picture and level where it begins in `texels`, its width and height; small ones repeat the last."""

    def grey(self) -> Album:
        """Return the same pictures in grey (Rec. 601)."""
        grey = np.empty((len(self.texels), 1), np.uint8)
        for begin in range(0, len(self.texels), 1 << 20):
            part = slice(begin, begin + (1 << 20))
            grey[part, 0] = np.rint(self.texels[part] @ np.array([0.299, 0.587, 0.114], np.float32))
        return Album(grey, self.levels)


def make_album(sizes: NDArray[np.int64], plain: NDArray[np.bool_], busy: NDArray[np.float64], seed: int) -> Album:
    """Return a picture for each surface.

    Parameters
    ----------
    sizes
        int64 (T, 2), width and height in texels.
    plain
        bool (T,), surfaces of one colour without any texture.
    busy
        float64 (T,), density of figures, 1 as on a full shelf.
    seed
        Of all draws; picture i depends on `seed` and i only.
    """
    counts = [_level_sizes(int(w), int(h)) for w, h in sizes]
    total = sum(w * h for levels in counts for w, h in levels)
    texels = np.empty((total, 3), np.uint8)
    table = np.empty((len(sizes), _LEVELS, 3), np.int64)
    begin = 0
    for i, levels in enumerate(counts):
        rng = np.random.default_rng([seed, i])
        picture = _picture(levels[0], bool(plain[i]), float(busy[i]), rng)
        for k in range(_LEVELS):
            width, height = levels[min(k, len(levels) - 1)]
            if k >= len(levels):
                table[i, k] = table[i, k - 1]
                continue
            if k:
                finer, picture = picture, np.empty((height, width, 3), np.uint8)
                _texture_kernels.shrink(finer, picture)
            texels[begin : begin + width * height] = picture.reshape(-1, 3)
            table[i, k] = begin, width, height
            begin += width * height
    return Album(texels, table)


def _level_sizes(width: int, height: int) -> list[tuple[int, int]]:
    sizes = [(width, height)]
    while max(sizes[-1]) > 1 and len(sizes) < _LEVELS:
        sizes.append(((sizes[-1][0] + 1) // 2, (sizes[-1][1] + 1) // 2))
    return sizes


def _picture(size: tuple[int, int], plain: bool, busy: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    width, height = size
    canvas = np.empty((height, width, 3), np.float32)
    canvas[:] = _colours(1, rng, 90.0, 200.0, 0.15)[0]
    if not plain:
        for step, weight in _OCTAVES:
            lattice = rng.random((int(height / step) + 2, int(width / step) + 2), dtype=np.float32) - np.float32(0.5)
            _texture_kernels.add_octave(canvas, lattice, step, 2.0 * weight)
        figures = [_scattered(width, height, busy, rng)]
        figures.extend(_poster(width, height, rng) for _ in range(rng.poisson(width * height / _POSTER_CELL**2)))
        _texture_kernels.paint(canvas, np.concatenate(figures))
    picture = np.empty((height, width, 3), np.uint8)
    _texture_kernels.to_bytes(canvas, picture)
    return picture


def _colours(count: int, rng: np.random.Generator, low: float, high: float, hue: float) -> NDArray[np.float64]:
    """Return colours (count, 3) of a brightness from `low` to `high`, and of a hue of so much of it."""
    bright = rng.uniform(low, high, (count, 1))
    return np.clip(bright * (1.0 + hue * rng.uniform(-1.0, 1.0, (count, 3))), 0.0, 255.0)


def _scattered(width: int, height: int, busy: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return figures (D, 12) all over a picture: large ones first, small ones over them."""
    count = int(rng.poisson(busy * width * height / _FIGURE_CELL**2))
    sizes = np.sort(np.exp(rng.uniform(np.log(_SMALLEST), np.log(_LARGEST), count)))[::-1]
    figures = np.empty((count, 12))
    figures[:, 0] = rng.choice(np.array([0, 0, 1, 2, 3, 3, 4, 5, 6, 6, 7]), count)
    figures[:, 1], figures[:, 2] = rng.uniform(0, width, count), rng.uniform(0, height, count)
    figures[:, 3], figures[:, 4] = sizes * rng.uniform(0.4, 1.0, count), sizes * rng.uniform(0.4, 1.0, count)
    turn = rng.uniform(0.0, 2 * np.pi, count)
    figures[:, 5], figures[:, 6] = np.cos(turn), np.sin(turn)
    dark = rng.random((count, 1)) < 0.5
    figures[:, 7:10] = np.where(dark, _colours(count, rng, 10.0, 80.0, 0.6), _colours(count, rng, 150.0, 250.0, 0.4))
    figures[:, 10] = rng.uniform(0.6, 1.0, count)
    figures[:, 11] = rng.integers(1, 1 << 15, count)
    return figures


def _poster(width: int, height: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return figures (D, 12) of a bright sheet with figures in its upper half and lines of letters in the lower."""
    half_w = rng.uniform(50.0, 120.0)
    half_h = half_w * rng.uniform(0.7, 1.4)
    x, y = rng.uniform(0, width), rng.uniform(0, height)
    sheet = np.array([[0.0, x, y, half_w, half_h, 1.0, 0.0, *_colours(1, rng, 200.0, 250.0, 0.2)[0], 1.0, 0.0]])
    art = _scattered(int(2 * half_w), int(half_h), 2.5, rng)
    art[:, 3:5] = np.minimum(art[:, 3:5], half_w / 3)
    art[:, 1] = np.clip(art[:, 1], half_w / 3, 2 * half_w - half_w / 3) + x - half_w
    art[:, 2] = np.clip(art[:, 2], half_h / 3, half_h) + y - half_h
    tall = rng.uniform(4.0, 8.0)
    columns, rows = int(2 * half_w / (2.2 * tall)) - 1, max(int(half_h / (2.6 * tall)) - 1, 1)
    count = max(columns, 1) * rows
    letters = np.zeros((count, 12))
    letters[:, 0], letters[:, 5], letters[:, 10] = 6, 1.0, 1.0
    letters[:, 1] = x - half_w + 2.2 * tall * (np.tile(np.arange(max(columns, 1)), rows) + 0.8)
    letters[:, 2] = y + 2.6 * tall * (np.repeat(np.arange(rows), max(columns, 1)) + 0.9)
    letters[:, 3], letters[:, 4] = 0.6 * tall, tall
    letters[:, 7:10] = _colours(1, rng, 10.0, 60.0, 0.5)
    letters[:, 11] = rng.integers(1, 1 << 15, count)
    return np.concatenate([sheet, art, letters])


def warm() -> None:
    """Compile the kernels of this module."""
    make_album(np.array([[3, 2]]), np.zeros(1, np.bool_), np.ones(1), 0)
