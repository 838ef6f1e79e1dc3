# SPDX-License-Identifier: MIT
"""Drawing on an array of pixels: anti-aliased strokes and marks, text, and PNG bytes, without a plotting library.

A plotting library needs half a second to load and as long to draw, which is more than a whole map of a small recording
takes. What a map needs is lines, a few marks and labels.

An image is uint8 (H, W, 3), red-green-blue, row 0 on top. Pixel coordinates are x to the right and y down; the centre
of the top left pixel is (0.5, 0.5).
"""

from __future__ import annotations

import functools
import io
import math
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Pixels = NDArray[np.uint8]
_CHUNK = 500_000
"""Pixels that are looked at together: bounds memory."""
_SMALL_RADIUS = 12.0
_MAX_SAMPLES = 1_000_000


def stroke(
    image: Pixels,
    points_px: ArrayLike,
    colours: ArrayLike,
    width_px: float,
    *,
    opacity: float = 1.0,
) -> None:
    """Draw a polyline onto `image`, later parts over earlier ones.

    Parameters
    ----------
    image
        uint8 (H, W, 3), drawn on in place.
    points_px
        float64 (N, 2), x and y in pixels; what lies outside of the image or is not finite is left out.
    colours
        (3,) one colour, or (N, 3) one for each point, 0 to 255.
    width_px
        Width of the line; its ends are round.
    opacity
        0 to 1, of the line as a whole: where it crosses itself it gets no darker.
    """
    points = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
    shades = np.broadcast_to(np.asarray(colours, dtype=np.float64), (len(points), 3))
    finite = np.isfinite(points).all(axis=1)
    points, shades = points[finite], shades[finite]
    if len(points) == 0:
        return
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    step = max(0.5, width_px / 8, along[-1] / _MAX_SAMPLES)
    s = np.linspace(0.0, along[-1], int(along[-1] / step) + 2)
    samples = np.column_stack([np.interp(s, along, points[:, i]) for i in (0, 1)])
    shade = np.column_stack([np.interp(s, along, shades[:, i]) for i in (0, 1, 2)])
    _stamp(image, samples, shade, width_px / 2, opacity)


def disc(image: Pixels, centre_px: ArrayLike, radius_px: float, colour: ArrayLike, *, opacity: float = 1.0) -> None:
    """Draw a filled disc onto `image`; centre (2,), colour (3,)."""
    centre = np.asarray(centre_px, dtype=np.float64).reshape(1, 2)
    _stamp(image, centre, np.asarray(colour, dtype=np.float64).reshape(1, 3), radius_px, opacity)


def dots(image: Pixels, centres_px: ArrayLike, radius_px: float, colour: ArrayLike) -> None:
    """Draw filled discs of one size onto `image`; centres (N, 2), colour (3,)."""
    centres = np.asarray(centres_px, dtype=np.float64).reshape(-1, 2)
    centres = centres[np.isfinite(centres).all(axis=1)]
    shade = np.broadcast_to(np.asarray(colour, dtype=np.float64), (len(centres), 3))
    _stamp(image, centres, shade, radius_px, 1.0)


def circle(image: Pixels, centre_px: ArrayLike, radius_px: float, colour: ArrayLike, width_px: float) -> None:
    """Draw the outline of a circle onto `image`."""
    turn = np.linspace(0.0, 2 * np.pi, max(24, int(radius_px * 4)))
    ring = np.asarray(centre_px, dtype=np.float64) + radius_px * np.column_stack([np.cos(turn), np.sin(turn)])
    stroke(image, ring, colour, width_px)


def fill(image: Pixels, box: tuple[float, float, float, float], colour: ArrayLike) -> None:
    """Fill the pixels of `box` (left, top, right, bottom), rounded to whole pixels."""
    left, top, right, bottom = (max(0, round(v)) for v in box)
    image[top:bottom, left:right] = np.asarray(colour, dtype=np.uint8)


def text(
    image: Pixels, at_px: tuple[float, float], words: str, size_px: int, colour: ArrayLike, anchor: str = "la"
) -> None:
    """Write one line of text onto `image`.

    `anchor` is two letters: l, m or r (which part of the text stands at x), then a (top), m (middle) or s (baseline).
    """
    mask = text_mask(words, size_px)
    if mask.size == 0:
        return
    ascent, height = _metrics(size_px)
    left = round(at_px[0] - {"l": 0.0, "m": mask.shape[1] / 2, "r": float(mask.shape[1])}[anchor[0]])
    top = round(at_px[1] - {"a": 0.0, "m": height / 2, "s": float(ascent)}[anchor[1]])
    y0, x0 = max(0, top), max(0, left)
    part = mask[y0 - top :, x0 - left :][: max(0, image.shape[0] - y0), : max(0, image.shape[1] - x0)]
    _blend(image[y0 : y0 + part.shape[0], x0 : x0 + part.shape[1]], part, np.asarray(colour, dtype=np.float32))


def text_width(words: str, size_px: int) -> int:
    """Return the width in pixels that :func:`text` needs."""
    return int(text_mask(words, size_px).shape[1])


@functools.lru_cache(maxsize=512)
def text_mask(words: str, size_px: int) -> NDArray[np.float32]:
    """Return the coverage float32 (h, w), 0 to 1, of one line of text."""
    from PIL import Image, ImageDraw

    # Line breaks and control characters would draw boxes or several lines.
    line = "".join(c if c.isprintable() else " " for c in words)
    font = _font(size_px)
    width = round(font.getlength(line))
    if width == 0:
        return np.zeros((0, 0), dtype=np.float32)
    picture = Image.new("L", (width, _metrics(size_px)[1]))
    ImageDraw.Draw(picture).text((0, 0), line, fill=255, font=font)
    return np.asarray(picture, dtype=np.float32) / np.float32(255)


def png(image: Pixels) -> bytes:
    """Return the image as PNG without any metadata: the same pixels give the same bytes."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(stream, "PNG", compress_level=4)
    return stream.getvalue()


def _stamp(image: Pixels, centres: NDArray[Any], shade: NDArray[Any], radius: float, opacity: float) -> None:
    """Lay discs over each other and blend their union onto the image, the later disc's colour on top."""
    height, width = image.shape[:2]
    reach = radius + 1.0
    inside = ((centres > -reach) & (centres < np.array([width, height]) + reach)).all(axis=1)
    centres, shade = centres[inside], shade[inside]
    if len(centres) == 0:
        return
    left, top = np.maximum(np.floor(centres.min(axis=0) - reach), 0).astype(np.int64)
    right, bottom = np.minimum(np.ceil(centres.max(axis=0) + reach), [width, height]).astype(np.int64)
    coverage = np.zeros((bottom - top, right - left), dtype=np.float32)
    owner = np.zeros(coverage.shape, dtype=np.int64)
    cover = _cover_small if radius <= _SMALL_RADIUS else _cover_large
    cover(coverage, owner, centres - np.array([left, top]), radius)
    rows, columns = np.nonzero(coverage)
    weight = coverage[rows, columns, None] * np.float32(opacity)
    below = image[rows + top, columns + left].astype(np.float32)
    mixed = below + (shade[owner[rows, columns]].astype(np.float32) - below) * weight
    image[rows + top, columns + left] = np.round(mixed).astype(np.uint8)


def _cover_small(
    coverage: NDArray[np.float32], owner: NDArray[np.int64], centres: NDArray[np.float64], radius: float
) -> None:
    """Lay many small discs into `coverage`, all pixels around thousands of them at once; `owner` is the last disc there."""
    height, width = coverage.shape
    span = np.arange(-math.ceil(radius + 1), math.ceil(radius + 1) + 1)
    dx, dy = (d.ravel() for d in np.meshgrid(span, span))
    chunk = max(1, _CHUNK // len(dx))
    for first in range(0, len(centres), chunk):
        part = centres[first : first + chunk]
        x = np.floor(part[:, :1]).astype(np.int64) + dx
        y = np.floor(part[:, 1:]).astype(np.int64) + dy
        distance = np.hypot(x + 0.5 - part[:, :1], y + 0.5 - part[:, 1:])
        share = np.clip(radius + 0.5 - distance, 0.0, 1.0).astype(np.float32)
        hit = (share > 0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
        cell = (y * width + x)[hit]
        np.maximum.at(coverage.reshape(-1), cell, share[hit])
        owner.reshape(-1)[cell] = np.broadcast_to(np.arange(first, first + len(part))[:, None], hit.shape)[hit]


def _cover_large(
    coverage: NDArray[np.float32], owner: NDArray[np.int64], centres: NDArray[np.float64], radius: float
) -> None:
    """Lay few large discs into `coverage`, one by one and only as far as the image reaches."""
    height, width = coverage.shape
    for i, (x, y) in enumerate(centres.tolist()):
        x0, x1 = max(0, math.floor(x - radius - 1)), min(width, math.ceil(x + radius + 1))
        y0, y1 = max(0, math.floor(y - radius - 1)), min(height, math.ceil(y + radius + 1))
        if x0 >= x1 or y0 >= y1:
            continue
        distance = np.hypot(np.arange(x0, x1) + 0.5 - x, (np.arange(y0, y1) + 0.5 - y)[:, None])
        share = np.clip(radius + 0.5 - distance, 0.0, 1.0).astype(np.float32)
        owner[y0:y1, x0:x1][share > 0] = i
        np.maximum(coverage[y0:y1, x0:x1], share, out=coverage[y0:y1, x0:x1])


def _blend(region: Pixels, mask: NDArray[np.float32], colour: NDArray[np.float32]) -> None:
    below = region.astype(np.float32)
    region[:] = np.round(below + (colour - below) * mask[..., None]).astype(np.uint8)


@functools.lru_cache(maxsize=16)
def _font(size_px: int) -> Any:
    """Return DejaVu Sans, which matplotlib carries; Pillow's own font where matplotlib is not installed."""
    from PIL import ImageFont

    package = find_spec("matplotlib")
    if package is not None and package.origin is not None:
        path = Path(package.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
        if path.is_file():
            return ImageFont.truetype(str(path), size_px)
    return ImageFont.load_default(size_px)


def _metrics(size_px: int) -> tuple[int, int]:
    """Return ascent and line height in pixels."""
    ascent, descent = _font(size_px).getmetrics()
    return int(ascent), int(ascent + descent)
