# SPDX-License-Identifier: MIT
"""The pictures that maps are kept in: PGM without any library, everything else through Pillow."""

from __future__ import annotations

import io
import re
import struct
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError, UsageError
from slamcli.outputs import atomic_file

MAX_PIXELS = 2**28
"""Largest picture that is read: 16384 x 16384. A header that claims more is damage, not a map."""
_MAX_FILE_BYTES = 2**30
_MAX_PNM_HEADER_BYTES = 1 << 16
_TOKEN = re.compile(rb"(?:\s|#[^\n]*(?:\n|$))*([^\s#]+)")
_NAMES = {".png": "PNG", ".bmp": "BMP", ".tif": "TIFF", ".tiff": "TIFF", ".webp": "WEBP"}
_OPTIONS: dict[str, dict[str, Any]] = {".webp": {"lossless": True, "exact": True}, ".png": {"compress_level": 2}}
_SUFFIXES = (".pgm", *_NAMES)
_PILLOW_FORMATS = ("PNG", "BMP", "TIFF", "WEBP", "JPEG", "GIF", "PPM")


@dataclass(frozen=True, slots=True, eq=False)
class MapImage:
    """A picture as map servers see it, top row first."""

    channel_sum: NDArray[np.uint16]
    """uint16 (H, W): sum of the colour channels, 0 to 255 each."""
    num_channels: int
    """How many channels were added up: 1 (grey) or 3 (colour)."""
    alpha: NDArray[np.uint8] | None = None
    """uint8 (H, W): opacity, 0 to 255; None if the picture has no alpha channel."""

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return int(self.channel_sum.shape[0]), int(self.channel_sum.shape[1])


def read_image(path: Path) -> MapImage:
    """Read the picture of a map.

    PGM (P2, P5; any maxval up to 65535) is decoded here, everything else by Pillow. Values are brought to 0..255 as
    SDL_image does: ``value * 255 // maxval`` for 8 bits; 16 bits are rounded.

    Raises
    ------
    FormatError
        If there is no such file, or it is not a picture, is cut short, or claims an absurd size.
    """
    if not path.is_file():
        raise FormatError(_missing(path))
    size = path.stat().st_size
    if size > _MAX_FILE_BYTES:
        raise FormatError(f"{path}: {size} bytes are too many for the picture of a map")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from error
    if data[:2] in (b"P2", b"P5"):
        return MapImage(_decode_pgm(data, path).astype(np.uint16), 1)
    return _decode_with_pillow(data, path)


def write_image(path: Path, grey: NDArray[np.uint8], alpha: NDArray[np.uint8] | None = None, comment: str = "") -> None:
    """Write grey values (H, W), top row first, in the format that the suffix names; whole or not at all.

    Raises
    ------
    UsageError
        If the suffix names no known format, or `alpha` is given and the format has none.
    """
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise UsageError(f"{path}: map pictures are written as {', '.join(_SUFFIXES)}")
    if alpha is not None and suffix not in (".png", ".tif", ".tiff", ".webp"):
        raise UsageError(f"{path}: {suffix} cannot mark unknown cells (no transparency): write a .png")
    if suffix == ".pgm":
        note = f"# {comment}\n" if comment else ""
        encoded = f"P5\n{note}{grey.shape[1]} {grey.shape[0]}\n255\n".encode("ascii") + grey.tobytes()
    else:
        encoded = _encode_with_pillow(suffix, grey, alpha)
    with atomic_file(path, "wb") as stream:
        stream.write(encoded)


def _missing(path: Path) -> str:
    if path.exists():
        return f"{path}: not a file"
    beside = (
        sorted(p.name for p in path.parent.glob("*") if p.suffix.lower() in _SUFFIXES) if path.parent.is_dir() else []
    )
    hint = f"; pictures there: {', '.join(beside[:5])}" if beside else ""
    return f"{path}: the map's picture does not exist{hint}"


def _decode_pgm(data: bytes, path: Path) -> NDArray[np.uint8]:
    width, height, maxval, offset = _pgm_header(data, path)
    count = width * height
    if data[:2] == b"P5":
        dtype = np.dtype(np.uint8) if maxval < 256 else np.dtype(">u2")
        if len(data) - offset < count * dtype.itemsize:
            raise FormatError(
                f"{path}: cut short: {width} x {height} pixels need {count * dtype.itemsize} bytes, {len(data) - offset} are there"
            )
        values = np.frombuffer(data, dtype, count, offset)
    else:
        values = _ascii_values(data, offset, count, path)
    if values.size and int(values.max()) > maxval:
        raise FormatError(f"{path}: a pixel is {int(values.max())}, more than the maxval {maxval} of its header")
    return _to_bytes(values.reshape(height, width), maxval)


def _pgm_header(data: bytes, path: Path) -> tuple[int, int, int, int]:
    header, numbers, position = data[:_MAX_PNM_HEADER_BYTES], [], 2
    for what in ("width", "height", "maxval"):
        match = _TOKEN.match(header, position)
        if match is None or not match[1].isdigit() or len(match[1]) > 9:
            raise FormatError(f"{path}: PGM header: no {what}")
        numbers.append(int(match[1]))
        position = match.end()
    width, height, maxval = numbers
    _check_size(width, height, 1, path)
    if not 0 < maxval < 65536:
        raise FormatError(f"{path}: PGM header: maxval {maxval} is not between 1 and 65535")
    return width, height, maxval, position + 1


def _ascii_values(data: bytes, offset: int, count: int, path: Path) -> NDArray[np.int64]:
    text = re.sub(rb"#[^\n]*", b"", data[offset:])
    tokens = text.split(maxsplit=count)[:count]
    try:
        values = np.array([int(token) for token in tokens], dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise FormatError(f"{path}: a pixel is not a number") from error
    if len(values) < count or (count and int(values.min()) < 0):
        raise FormatError(f"{path}: cut short: {count} pixels announced, {len(values)} are there")
    return values


def _to_bytes(values: NDArray[Any], maxval: int) -> NDArray[np.uint8]:
    if maxval == 255:
        return values.astype(np.uint8)
    table = np.arange(maxval + 1, dtype=np.int64) * 255
    table = table // maxval if maxval < 256 else (2 * table + maxval) // (2 * maxval)
    return table.astype(np.uint8)[values]


def _check_size(width: int, height: int, num_channels: int, path: Path) -> None:
    if width < 1 or height < 1 or width * height * num_channels > MAX_PIXELS:
        raise FormatError(f"{path}: {width} x {height} pixels: no map has this size (limit: {MAX_PIXELS} values)")


def _decode_with_pillow(data: bytes, path: Path) -> MapImage:
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            # Pillow warns of large pictures and odd tags; the size is checked here, before anything is decoded.
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=_PILLOW_FORMATS) as image:
                _check_size(*image.size, 1, path)
                pixels = _pixels(image)
    except Image.DecompressionBombError as error:
        raise FormatError(f"{path}: no map has this size ({' '.join(str(error).split())[:60]})") from error
    except UnidentifiedImageError as error:
        raise FormatError(f"{path}: not a picture that can be read ({', '.join(_PILLOW_FORMATS)}, PGM)") from error
    except (OSError, SyntaxError, ValueError, IndexError, KeyError, TypeError, EOFError, struct.error) as error:
        raise FormatError(
            f"{path}: the picture is damaged or cut short ({' '.join(str(error).split())[:80]})"
        ) from error
    return _split_channels(pixels, path)


def _pixels(image: Any) -> NDArray[np.uint8]:
    """Return the pixels as map servers get them: palettes resolved, 16 bits brought to 8."""
    if image.mode.startswith("I"):
        return _to_bytes(np.clip(np.asarray(image, dtype=np.int64), 0, 65535), 65535)
    if image.mode == "P":
        image = image.convert("RGBA" if "transparency" in image.info else "RGB")
    elif image.mode not in ("L", "LA", "RGB", "RGBA"):
        image = image.convert("L" if image.mode == "1" else "RGB")
    return np.array(image, dtype=np.uint8)


def _split_channels(pixels: NDArray[np.uint8], path: Path) -> MapImage:
    if pixels.ndim == 2:
        return MapImage(pixels.astype(np.uint16), 1)
    num_channels = pixels.shape[2]
    alpha = np.ascontiguousarray(pixels[:, :, -1]) if num_channels in (2, 4) else None
    colours = num_channels if alpha is None else num_channels - 1
    if colours not in (1, 3):
        raise FormatError(f"{path}: {num_channels} channels, expected grey or colour, with or without alpha")
    return MapImage(pixels[:, :, :colours].sum(axis=2, dtype=np.uint16), colours, alpha)


def _encode_with_pillow(suffix: str, grey: NDArray[np.uint8], alpha: NDArray[np.uint8] | None) -> bytes:
    from PIL import Image

    pixels = grey if alpha is None else np.dstack([grey, grey, grey, alpha])
    stream = io.BytesIO()
    options = _OPTIONS.get(suffix, {})
    try:
        Image.fromarray(pixels).save(stream, _NAMES[suffix], **options)
    except (OSError, ValueError) as error:
        raise UsageError(f"a {suffix} picture of {grey.shape[1]} x {grey.shape[0]} pixels cannot be written") from error
    return stream.getvalue()
