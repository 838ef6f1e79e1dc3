# SPDX-License-Identifier: MIT
"""Files of OctoMap: ``.bt`` (free or occupied, two bits for each child) and ``.ot`` (log odds).

After the header, ``.ot`` holds every node before its children: its log odds (float32) and a byte with a bit for each child that
there is. ``.bt`` holds of every inner node two bits for each child: 0 unknown, 1 free, 2 occupied, 3 has children of its own. Child
i lies higher in x where bit 0 of i is set, in y for bit 1, in z for bit 2.
"""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError, UsageError
from slamcli.grids.octree import DEPTH, REACH_CELLS, Octree
from slamcli.outputs import atomic_file

_FIRST = {".bt": "# Octomap OcTree binary file", ".ot": "# Octomap OcTree file"}
_LEAST, _MOST = math.log(0.1192 / 0.8808), math.log(0.971 / 0.029)
"""OctoMap's limits, which free and occupied stand for in ``.bt``."""


def write_octomap(path: str | os.PathLike[str], octree: Octree) -> None:
    """Write a tree, whole or not at all; cubes of eight equal leaves become one.

    Parameters
    ----------
    path
        Its suffix says the format: ``.bt`` or ``.ot``.
    octree
        Leaves farther than 32,768 of the smallest cubes from the origin are left out: the format does not reach there.

    Raises
    ------
    UsageError
        If the suffix is another one, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in _FIRST:
        raise UsageError(f"{path}: octrees are written as .bt or .ot")
    binary = path.suffix == ".bt"
    tree = octree.within_reach()
    values = tree.log_odds.astype(np.float32)
    if binary:
        values = np.where(tree.occupied, np.float32(1.0), np.float32(-1.0))
    nodes = _Nodes(tree.indices + REACH_CELLS, tree.edges, values)
    header = [
        _FIRST[path.suffix], "# (feel free to add / change comments, but leave the first line as it is!)", "#", "id OcTree",
        f"size {len(nodes.values)}", f"res {octree.resolution_m:g}", "data", "",
    ]  # fmt: skip
    with atomic_file(path, "wb") as stream:
        stream.write("\n".join(header).encode("ascii"))
        stream.write(nodes.binary() if binary else nodes.full())


class _Nodes:
    """All nodes of a pruned tree, each before its children."""

    def __init__(self, keys: NDArray[np.int64], edges: NDArray[np.int64], values: NDArray[np.float32]) -> None:
        levels = (DEPTH - np.log2(np.maximum(edges, 1)).astype(np.int64)) if len(edges) else np.zeros(0, np.int64)
        codes, kinds = _interleaved(keys), np.where(values > 0.0, 2, 1).astype(np.int64)
        found = []
        below = (
            np.zeros(0, np.int64),
            np.zeros(0, np.float32),
            np.zeros(0, np.int64),
            np.zeros(0, np.int64),
            np.zeros(0, np.int64),
        )
        for level in range(DEPTH, 0, -1):
            here = levels == level
            code, value, kind, mask, bits = (
                np.concatenate([inner, leaf]) for inner, leaf in zip(
                    below, (codes[here], values[here], kinds[here], np.zeros(here.sum(), np.int64), np.zeros(here.sum(), np.int64)),
                    strict=True,
                )
            )  # fmt: skip
            order = np.argsort(code)
            code, value, kind, mask, bits = code[order], value[order], kind[order], mask[order], bits[order]
            below, kept = _parents(code, value, kind, level)
            found.append((code[kept], value[kept], mask[kept], bits[kept], np.full(int(kept.sum()), level)))
        found.append((below[0], below[1], below[3], below[4], np.zeros(len(below[0]), np.int64)))
        codes, self.values, self._mask, self._bits, depths = (np.concatenate(part) for part in zip(*found, strict=True))
        order = np.lexsort((depths, codes))
        self.values, self._mask, self._bits = self.values[order], self._mask[order], self._bits[order]

    def full(self) -> bytes:
        """Return log odds and children of every node."""
        table = np.empty(len(self.values), dtype=[("value", "<f4"), ("children", "u1")])
        table["value"], table["children"] = self.values, self._mask
        return table.tobytes()

    def binary(self) -> bytes:
        """Return two bytes for every inner node."""
        return self._bits[self._mask > 0].astype("<u2").tobytes()


Level = tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]


def _parents(
    code: NDArray[np.int64], value: NDArray[np.float32], kind: NDArray[np.int64], level: int
) -> tuple[Level, NDArray[np.bool_]]:
    """Return the nodes above those of a level (sorted by code), and which of the level's nodes stay: not eight equal leaves.

    A node is its code, its log odds (the highest of its children), its two bits for ``.bt``, a bit and two bits for each child.
    """
    shift = 3 * (DEPTH - level)
    parent, child = (code >> (shift + 3)) << (shift + 3), (code >> shift) & 7
    parents, first, counts = np.unique(parent, return_index=True, return_counts=True)
    if len(parents) == 0:
        return (parents, value, kind, kind, kind), np.zeros(0, dtype=np.bool_)
    highest, lowest = np.maximum.reduceat(value, first), np.minimum.reduceat(value, first)
    leaves = np.maximum.reduceat(kind, first) < 3
    equal = (counts == 8) & leaves & (highest == lowest)
    mask = np.add.reduceat(1 << child, first)
    bits = np.add.reduceat(kind << (2 * child), first)
    above = np.where(equal, kind[first], 3)
    kept = ~np.repeat(equal, counts)
    return (parents, highest, above, np.where(equal, 0, mask), np.where(equal, 0, bits)), kept


def _interleaved(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the path from the root to each key (N, 3) of 16 bits: three bits a level, x lowest."""
    code = np.zeros(len(keys), dtype=np.int64)
    for bit in range(DEPTH):
        for axis in range(3):
            code |= ((keys[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def read_octomap(path: str | os.PathLike[str]) -> Octree:
    """Return the tree in a ``.bt`` or ``.ot`` file of the type OcTree; nothing in it counts as ground.

    Raises
    ------
    FormatError
        If there is no such file, its header is another one, or the data end early.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read as an octree: {error.strerror or error}") from error
    found = re.match(rb"# Octomap OcTree( binary)? file\n(?:[^\n]*\n){0,50}?data\n", data)
    if found is None:
        raise FormatError(f"{path}: neither a .bt nor a .ot file of OctoMap")
    fields = dict(re.findall(r"^(id|res|size) (\S+)", found.group().decode("ascii", "replace"), re.MULTILINE))
    try:
        resolution = float(fields["res"])
    except (KeyError, ValueError) as error:
        raise FormatError(f"{path}: its header says no resolution (res)") from error
    if fields.get("id") != "OcTree" or not (math.isfinite(resolution) and resolution > 0.0):
        raise FormatError(f"{path}: an octree of type {fields.get('id')} and resolution {resolution:g}, not OcTree")
    body = data[found.end() :]
    try:
        leaves = _binary_leaves(body) if found.group(1) else _full_leaves(body)
    except IndexError as error:
        raise FormatError(f"{path}: the data end early") from error
    columns = np.array(leaves, dtype=np.float64).reshape(-1, 5)
    return Octree(
        resolution_m=resolution, indices=columns[:, :3].astype(np.int64) - REACH_CELLS, edges=columns[:, 3].astype(np.int64),
        log_odds=columns[:, 4].astype(np.float32), ground=np.zeros(len(columns), dtype=np.bool_),
    )  # fmt: skip


Leaf = tuple[int, int, int, int, float]


def _binary_leaves(body: bytes) -> list[Leaf]:
    leaves: list[Leaf] = []
    waiting = [(0, 0, 0, 1 << DEPTH)] if body else []
    at = 0
    while waiting:
        x, y, z, edge = waiting.pop()
        bits, half = body[at] | body[at + 1] << 8, edge >> 1
        if half == 0:
            raise IndexError
        at += 2
        inner = []
        for child in range(8):
            kind = bits >> (2 * child) & 3
            place = (x + half * (child & 1), y + half * (child >> 1 & 1), z + half * (child >> 2), half)
            if kind == 3:
                inner.append(place)
            elif kind:
                leaves.append((*place, _LEAST if kind == 1 else _MOST))
        waiting.extend(reversed(inner))
    return leaves


def _full_leaves(body: bytes) -> list[Leaf]:
    leaves: list[Leaf] = []
    waiting = [(0, 0, 0, 1 << DEPTH)] if body else []
    at = 0
    while waiting:
        x, y, z, edge = waiting.pop()
        mask, half = body[at + 4], edge >> 1
        if mask and half == 0:
            raise IndexError
        if not mask:
            leaves.append((x, y, z, edge, float(np.frombuffer(body, "<f4", 1, at)[0])))
        at += 5
        waiting.extend(
            (x + half * (child & 1), y + half * (child >> 1 & 1), z + half * (child >> 2), half)
            for child in range(7, -1, -1)
            if mask >> child & 1
        )
    return leaves
