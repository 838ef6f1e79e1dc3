# SPDX-License-Identifier: MIT
"""The two nearest of many 256 bit descriptors, while descriptors come and go.

References
----------
M. Norouzi, A. Punjani, D. J. Fleet, "Fast search in Hamming space with multi-index hashing", CVPR 2012,
doi:10.1109/CVPR.2012.6248043.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _binary_index_kernels as kernels

FAR = kernels.FAR
"""The distance to a descriptor that is not there."""
_SMALL_TAIL = 2048
"""Descriptors that are compared with one by one before the tables are built again, at least."""
_TAIL_SHARE = 48
"""A tail may be that part of the whole: comparing with it costs less than the tables."""
_FOUND = 0.98
"""Probability with which a descriptor nearer than the second nearest would have been found, when a search ends early."""
_SPREAD = 3.0
"""Standard deviations by which the 64 bits of a sketch may be off from a quarter of the distance to beat."""


@dataclass(frozen=True, slots=True, eq=False)
class NearestTwo:
    """What was found for each of M queries."""

    rows: NDArray[np.int64]
    """(M, 2), the nearest first; -1 where there is none."""
    distances: NDArray[np.int64]
    """(M, 2), bits that differ; 257 where there is none."""


class BinaryIndex:
    """Descriptors in numbered rows; the number of a descriptor stays, that of a removed one is given away again.

    Every descriptor is in 16 tables, by each of its 16 parts of 16 bits. A search looks into the buckets of the query's parts and
    into those that differ from them in one bit, and compares what lies there in full: all descriptors within 31 bits are found,
    and by chance most beyond (two equal descriptors of 256 bits that differ in 50 share such a part with 92 %). It ends before
    all buckets were seen when what is left would hardly hold a nearer one. New descriptors are compared with one by one until the
    tables are built again. The answer depends on the sequence of calls only. About 290 bytes for a descriptor, and 4 MiB.
    """

    def __init__(self) -> None:
        self._descriptors = np.zeros((0, 4), np.uint64)
        self._alive = np.zeros(0, np.bool_)
        self._free: list[int] = []
        self._tail: list[int] = []
        self._num_sorted = 0
        self._starts = np.zeros((kernels.TABLES, kernels.BUCKETS + 1), np.int32)
        self._members = np.zeros((kernels.TABLES, 0), np.int32)
        self._sketches = np.zeros((kernels.TABLES, 0), np.uint64)
        self._size = 0
        self._count = 0

    def __len__(self) -> int:
        """Return the number of descriptors."""
        return self._count

    def descriptors(self, rows: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return uint8 (N, 32), those in some rows."""
        return np.ascontiguousarray(self._descriptors[rows]).view(np.uint8).reshape(-1, 32)

    def add(self, descriptors: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Take descriptors in and return their rows, int64 (N,).

        Raises
        ------
        DataError
            If they are not uint8 (N, 32).
        """
        packed = pack(descriptors)
        reused = min(len(packed), len(self._free))
        rows = [self._free.pop() for _ in range(reused)] + list(range(self._size, self._size + len(packed) - reused))
        self._size += len(packed) - reused
        self._descriptors = _grown(self._descriptors, self._size)
        self._alive = _grown(self._alive, self._size)
        taken = np.array(rows, np.int64)
        self._descriptors[taken] = packed
        self._alive[taken] = True
        self._tail.extend(rows)
        self._count += len(rows)
        return taken

    def remove(self, rows: NDArray[np.int64]) -> None:
        """Forget the descriptors in some rows.

        Raises
        ------
        DataError
            If one of them is not there.
        """
        gone = np.unique(np.asarray(rows, np.int64))
        if len(gone) and (gone[0] < 0 or gone[-1] >= self._size or not self._alive[gone].all()):
            raise DataError("binary index: a row to be removed holds no descriptor")
        self._alive[gone] = False
        self._free.extend(reversed(gone.tolist()))
        self._count -= len(gone)
        # Entries of a removed row stay in the tables. When the row is given away they lead to the new descriptor, which is compared
        # with in full: an entry too many costs time, never a wrong answer.
        left = set(gone.tolist())
        self._tail = [row for row in self._tail if row not in left]

    def nearest_two(self, queries: NDArray[np.uint8], *, exact: bool = False) -> NearestTwo:
        """Return the two nearest descriptors of each query, of equally near ones those of the lowest rows.

        Parameters
        ----------
        queries
            uint8 (M, 32).
        exact
            Whether all descriptors are compared with.

        Raises
        ------
        DataError
            If the queries are not uint8 (M, 32).
        """
        packed = pack(queries)
        nearest = np.full((len(packed), 2), -1, np.int64)
        distances = np.full((len(packed), 2), FAR, np.int64)
        with np.errstate(over="ignore"):
            if exact:
                kernels.search_all(
                    packed, self._descriptors, np.flatnonzero(self._alive[: self._size]), nearest, distances
                )
                return NearestTwo(nearest, distances)
            if len(self._tail) > max(_SMALL_TAIL, self._count // _TAIL_SHARE):
                self._sort()
            kernels.search_all(packed, self._descriptors, np.array(self._tail, np.int64), nearest, distances)
            if self._num_sorted:
                tables = (self._starts, self._members, self._sketches)
                kernels.search(
                    packed, self._descriptors, self._alive, *tables, _LIMITS, _ENOUGH, nearest, distances
                )  # fmt: skip
        return NearestTwo(nearest, distances)

    def _sort(self) -> None:
        """Put every descriptor into the tables."""
        rows = np.flatnonzero(self._alive[: self._size])
        if len(rows) > self._members.shape[1]:
            room = len(rows) + len(rows) // 4
            self._members = np.zeros((kernels.TABLES, room), np.int32)
            self._sketches = np.zeros((kernels.TABLES, room), np.uint64)
        kernels.build(self._descriptors, rows, self._starts, self._members, self._sketches)
        self._num_sorted = len(rows)
        self._tail = []


def pack(descriptors: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Return descriptors, uint8 (N, 32), as uint64 (N, 4).

    Raises
    ------
    DataError
        If they are something else.
    """
    if descriptors.ndim != 2 or descriptors.shape[1] != 32 or descriptors.dtype != np.uint8:
        raise DataError(f"descriptors are {descriptors.dtype} {descriptors.shape}, not uint8 (N, 32)")
    return np.require(descriptors, requirements=["C", "W"]).view(np.uint64)


def _grown(array: NDArray[Any], size: int) -> NDArray[Any]:
    """Return the array with at least `size` rows, doubled where it has to grow."""
    if size <= len(array):
        return array
    grown = np.zeros((max(size, 2 * len(array)), *array.shape[1:]), array.dtype)
    grown[: len(array)] = array
    return grown


def _sketch_limits() -> NDArray[np.int64]:
    """How many of the 64 bits of a sketch may differ, for each distance to beat: a sample of a quarter of the bits."""
    distances = np.arange(kernels.FAR + 1, dtype=np.float64)
    share = np.minimum(distances, 128.0) / 256.0
    limits = np.ceil(distances / 4 + _SPREAD * np.sqrt(64 * share * (1 - share)))
    limits[kernels.FAR :] = 64  # nothing found yet: everything is looked at
    return np.minimum(limits, 64).astype(np.int64)


def _enough() -> NDArray[np.int64]:
    """Up to which distance of the second nearest a search ends, for each number of rounds done: 0, the equal parts, 1 to 16."""
    enough = [-1]
    for flips in range(16):
        reach = 0
        while reach < 128 and _found(reach + 1, flips) >= _FOUND:
            reach += 1
        enough.append(reach)
    return np.array(enough, np.int64)


def _found(distance: int, flips: int) -> float:
    """Probability that a descriptor was seen when the first `flips` bits of each part were turned."""
    wrong = distance / 256
    part = (1 - wrong) ** 16 + flips * wrong * (1 - wrong) ** 15
    return 1 - (1 - part) ** kernels.TABLES if part < 1 else 1.0


_LIMITS = _sketch_limits()
_ENOUGH = _enough()


def warm() -> None:
    """Compile the kernels of this module."""
    index = BinaryIndex()
    index.add(np.zeros((3, 32), np.uint8))
    index.nearest_two(np.zeros((1, 32), np.uint8), exact=True)
    index._sort()  # noqa: SLF001
    index.nearest_two(np.zeros((1, 32), np.uint8))
