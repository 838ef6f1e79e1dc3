# SPDX-License-Identifier: MIT
"""The points of PCD files (Point Cloud Library, version 0.7 and earlier)."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.formats.ply import text_columns

_KINDS = {("F", 4): "<f4", ("F", 8): "<f8"} | {
    (letter, size): f"<{letter.lower()}{size}" for letter in "IU" for size in (1, 2, 4, 8)
}
_ENCODINGS = ("ascii", "binary", "binary_compressed")
_LONGEST_HEADER = 1 << 16
_MOST_POINTS = 1 << 32


@dataclass(frozen=True, slots=True)
class _Header:
    names: list[str]
    kinds: list[str]
    counts: list[int]
    points: int
    encoding: str
    body: int
    """Offset of the first byte after the header."""

    @property
    def sizes(self) -> list[int]:
        """Bytes of each field of one point."""
        return [np.dtype(kind).itemsize * count for kind, count in zip(self.kinds, self.counts, strict=True)]


def read_pcd_columns(data: bytes, path: Path) -> dict[str, NDArray[Any]]:
    """Return the fields of one value by name, each (N,).

    Raises
    ------
    FormatError
        If the header is none, or the body does not hold what it declares.
    """
    header = _header(data, path)
    if header.encoding == "ascii":
        return _text(data, header, path)
    size = sum(header.sizes)
    if header.encoding == "binary":
        _check_size(path, header.points, size, len(data) - header.body)
        starts, strides = np.cumsum([0, *header.sizes])[:-1], [size] * len(header.names)
        body = data[header.body :]
    else:
        body = _unpacked(data[header.body :], header.points * size, path)
        starts = np.cumsum([0, *(size * header.points for size in header.sizes)])[:-1]
        strides = header.sizes  # field after field
    columns: dict[str, NDArray[Any]] = {}
    for name, kind, count, start, stride in zip(
        header.names, header.kinds, header.counts, starts, strides, strict=True
    ):
        if count == 1 and name != "_":
            there = np.ndarray((header.points,), kind, body, int(start), (stride,)) if header.points else np.zeros(0)
            columns.setdefault(name, there)
    return columns


def pcd_bytes(columns: Mapping[str, NDArray[np.float32]], colours: NDArray[np.uint8] | None) -> bytes:
    """Return a binary file of float32 columns (N,) and colours (N, 3), which stand as PCL has them: packed in one float."""
    layout = [(name, "<f4") for name in columns] + ([("rgb", "<u4")] if colours is not None else [])
    table = np.empty(len(next(iter(columns.values()))), dtype=layout)
    for name, values in columns.items():
        table[name] = values
    if colours is not None:
        red, green, blue = colours.T.astype(np.uint32)
        table["rgb"] = (red << 16) | (green << 8) | blue
    names = [name for name, _ in layout]
    header = [
        "# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join('4' for _ in names)}", f"TYPE {' '.join('F' for _ in names)}",
        f"COUNT {' '.join('1' for _ in names)}", f"WIDTH {len(table)}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(table)}", "DATA binary", "",
    ]  # fmt: skip
    return "\n".join(header).encode("ascii") + table.tobytes()


def _header(data: bytes, path: Path) -> _Header:
    """Return what the lines up to DATA declare."""
    entries: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in entries:
        end = data.find(b"\n", at, at + _LONGEST_HEADER)
        if end < 0 or end > _LONGEST_HEADER:
            raise FormatError(f"{path}: neither a PLY nor a PCD file (it begins with neither's header)")
        words = data[at:end].decode("latin-1").split()
        if words and not words[0].startswith("#"):
            entries.setdefault(words[0].upper(), words[1:])
        at = end + 1
    names = entries.get("FIELDS") or entries.get("COLUMNS") or []
    sizes, counts = (_numbers(entries, key, len(names), path) for key in ("SIZE", "COUNT"))
    letters = entries.get("TYPE", [])
    kinds = [_KINDS.get((letter, size), "") for letter, size in zip(letters, sizes, strict=False)]
    if len(kinds) != len(names) or not names or "" in kinds:
        raise FormatError(f"{path}: FIELDS, SIZE and TYPE of this PCD file do not declare points")
    width, height = (_numbers(entries, key, 1, path)[0] for key in ("WIDTH", "HEIGHT"))
    points = _numbers(entries, "POINTS", 1, path)[0] if "POINTS" in entries else width * height
    encoding = (entries["DATA"] or [""])[0].lower()
    if encoding not in _ENCODINGS:
        raise FormatError(f"{path}: DATA {encoding[:40]} of this PCD file is none of {', '.join(_ENCODINGS)}")
    if points > _MOST_POINTS:
        raise FormatError(f"{path}: {points} points are more than a file can hold")
    return _Header(names, kinds, counts, points, encoding, at)


def _numbers(entries: Mapping[str, list[str]], key: str, count: int, path: Path) -> list[int]:
    words = entries.get(key)
    if words is None and key in ("COUNT", "HEIGHT"):
        words = ["1"] * count
    if words is None or len(words) != count or not all(word.isdecimal() and len(word) < 13 for word in words):
        raise FormatError(f"{path}: {key} of this PCD file is not {count} whole number{'s' if count != 1 else ''}")
    return [int(word) for word in words]


def _check_size(path: Path, points: int, size: int, there: int) -> None:
    if size == 0 or points * size > there:
        raise FormatError(f"{path}: {points} points of {size} bytes are declared, {max(there, 0)} bytes are there")


def _text(data: bytes, header: _Header, path: Path) -> dict[str, NDArray[Any]]:
    lines = [line for line in data[header.body :].splitlines() if line.strip()][: header.points]
    width = sum(header.counts)
    if width > 10_000:
        raise FormatError(f"{path}: {width} numbers for a point are too many")
    names: list[str] = []
    for name, count in zip(header.names, header.counts, strict=True):
        names.extend([name if count == 1 else "_"] * count)
    columns = text_columns(names, lines, header.points, path)
    columns.pop("_", None)
    return columns


def _unpacked(body: bytes, size: int, path: Path) -> bytes:
    """Return the body of a compressed file: two sizes, then LZF (liblzf's format) of all fields, one after the other."""
    if len(body) < 8:
        raise FormatError(f"{path}: the compressed points are missing")
    packed, declared = struct.unpack("<II", body[:8])
    if declared < size or packed > len(body) - 8 or declared > 300 * packed + 64:
        raise FormatError(
            f"{path}: {packed} compressed bytes of {declared} are declared for points of {size}, {len(body) - 8} are there"
        )
    try:
        points = _lzf(body[8 : 8 + packed], declared)
    except (IndexError, ValueError) as error:
        raise FormatError(f"{path}: the compressed points are damaged") from error
    return points


def _lzf(packed: bytes, size: int) -> bytes:
    """Return what LZF packed: runs of literals, and copies of what came before."""
    out = bytearray()
    at = 0
    while at < len(packed):
        control = packed[at]
        at += 1
        if control < 32:
            literals = packed[at : at + control + 1]
            if len(literals) != control + 1:
                raise ValueError("literals end early")
            out += literals
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[at]
            at += 1
        begin = len(out) - ((control & 31) << 8) - packed[at] - 1
        at += 1
        if begin < 0:
            raise ValueError("a copy from before the beginning")
        length += 2
        source = bytes(out[begin : begin + length])
        # A copy may reach into itself: then what is there repeats.
        out += (source * (length // len(source) + 1))[:length]
    if len(out) != size:
        raise ValueError("another size than declared")
    return bytes(out)
