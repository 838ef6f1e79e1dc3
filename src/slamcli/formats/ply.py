# SPDX-License-Identifier: MIT
"""The vertices of PLY files (Stanford triangle format, version 1.0)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError

_KINDS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_LONGEST_HEADER = 1 << 16


@dataclass(slots=True)
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]]
    has_lists: bool = False


def read_ply_columns(data: bytes, path: Path) -> dict[str, NDArray[Any]]:
    """Return the scalar properties of the vertices by name, each (N,).

    Raises
    ------
    FormatError
        If the header is none, or the body does not hold what it declares.
    """
    order, elements, body = _header(data, path)
    before: list[_Element] = []
    for element in elements:
        if element.name == "vertex":
            read = _text_columns if order == "" else _binary_columns
            return read(data, body, before, element, path, order)
        before.append(element)
    raise FormatError(
        f"{path}: a PLY file without vertices (it has {', '.join(e.name for e in elements) or 'nothing'})"
    )


def ply_bytes(
    columns: Mapping[str, NDArray[np.float32]],
    colours: NDArray[np.uint8] | None,
    triangles: NDArray[np.int32] | None = None,
) -> bytes:
    """Return a binary file of float32 columns (N,), colours (N, 3), and triangles (F, 3) of the points."""
    layout = [(name, "<f4") for name in columns] + ([(name, "u1") for name in _RGB] if colours is not None else [])
    table = np.empty(len(next(iter(columns.values()))), dtype=layout)
    for name, values in columns.items():
        table[name] = values
    for i, name in enumerate(_RGB if colours is not None else ()):
        table[name] = colours[:, i]  # type: ignore[index]
    properties = [f"property {'float' if kind == '<f4' else 'uchar'} {name}" for name, kind in layout]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}", *properties]
    faces = np.empty(0 if triangles is None else len(triangles), dtype=[("count", "u1"), ("corners", "<i4", (3,))])
    if triangles is not None:
        faces["count"], faces["corners"] = 3, triangles
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    return "\n".join([*header, "end_header", ""]).encode("ascii") + table.tobytes() + faces.tobytes()


_RGB = ("red", "green", "blue")


def _header(data: bytes, path: Path) -> tuple[str, list[_Element], int]:
    """Return byte order ("" for text), elements in their order, and where the body begins."""
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    newline = data.find(b"\n", end)
    if data[:3] != b"ply" or end < 0 or newline < 0:
        raise FormatError(f"{path}: not a PLY file (no line end_header)")
    order, elements = None, list[_Element]()
    for number, line in enumerate(data[:end].decode("latin-1").splitlines(), start=1):
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdecimal() and len(words[2]) < 15:
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[:2] == ["property", "list"] and len(words) == 5 and elements:
            elements[-1].has_lists = True
        elif words[:1] == ["property"] and len(words) == 3 and elements and words[1] in _KINDS:
            elements[-1].properties.append((words[2], _KINDS[words[1]]))
        elif words and words[0] not in ("ply", "comment", "obj_info"):
            raise FormatError(f"{path}, line {number}: {line.strip()[:60]!r} is no line of a PLY header")
    if order is None:
        raise FormatError(
            f"{path}: a PLY file that does not say its format (ascii, binary_little_endian, binary_big_endian)"
        )
    return order, elements, newline + 1


def _binary_columns(
    data: bytes, body: int, before: list[_Element], vertex: _Element, path: Path, order: str
) -> dict[str, NDArray[Any]]:
    lists = [element.name for element in (*before, vertex) if element.has_lists]
    if lists:
        raise FormatError(f"{path}: lists in or before the vertices (of {lists[0]}) cannot be read")
    start = body + sum(e.count * sum(np.dtype(kind).itemsize for _, kind in e.properties) for e in before)
    offsets = np.cumsum([0] + [np.dtype(kind).itemsize for _, kind in vertex.properties]).tolist()
    _check_size(path, vertex.count, offsets[-1], len(data) - start)
    columns: dict[str, NDArray[Any]] = {}
    for (name, kind), offset in zip(vertex.properties, offsets, strict=False):
        column = (
            np.ndarray((vertex.count,), order + kind, data, start + offset, (offsets[-1],))
            if vertex.count
            else np.zeros(0)
        )
        columns.setdefault(name, column)
    return columns


def _check_size(path: Path, count: int, size: int, there: int) -> None:
    if size == 0 or count * size > there:
        raise FormatError(f"{path}: {count} points of {size} bytes are declared, {max(there, 0)} bytes are there")


def _text_columns(
    data: bytes, body: int, before: list[_Element], vertex: _Element, path: Path, _order: str
) -> dict[str, NDArray[Any]]:
    if vertex.has_lists:
        raise FormatError(f"{path}: lists in the vertices cannot be read")
    skipped = sum(element.count for element in before)
    lines = [line for line in data[body:].splitlines() if line.strip()][skipped : skipped + vertex.count]
    return text_columns([name for name, _ in vertex.properties], lines, vertex.count, path)


def text_columns(names: list[str], lines: list[bytes], count: int, path: Path) -> dict[str, NDArray[Any]]:
    """Return float64 columns (count,) by name, of lines with one number for each name.

    Raises
    ------
    FormatError
        If lines or numbers are missing, or something is no number.
    """
    if len(lines) != count:
        raise FormatError(f"{path}: {count} points are declared, {len(lines)} are there")
    words = b" ".join(lines).split()
    if len(words) != count * len(names):
        raise FormatError(
            f"{path}: {count} points of {len(names)} numbers are declared, {len(words)} numbers are there"
        )
    try:
        table = np.array([float(word) for word in words], dtype=np.float64).reshape(count, len(names))
    except ValueError as error:
        raise FormatError(f"{path}: a point is no row of numbers ({str(error)[:80]})") from error
    return {name: table[:, i] for i, name in reversed(list(enumerate(names)))}
