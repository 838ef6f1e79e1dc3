# SPDX-License-Identifier: MIT
"""Who sees which point: a table by keyframe and feature, with the list of each point's cells kept beside it.

What is asked of a few points costs what these points' own observations cost, however large the map is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.orbslam3 import _sighting_kernels as kernels
from slamcli.orbslam3.rows import Rows

Ids = NDArray[np.int64]


class Sightings(NamedTuple):
    """Who sees chosen points, by `row_of_point` (P,), -1 for others: `offsets` (R + 1,), `keyframes` (M,), `features` (M,)."""

    row_of_point: Ids
    offsets: Ids
    keyframes: Ids
    features: Ids


class SightingTable:
    """The one table of observations of a map."""

    def __init__(self) -> None:
        self._seen, self._before, self._after = (Rows((1,), np.int64, -1) for _ in range(3))
        self._heads, self._changed = Rows((), np.int64, -1), Rows((), np.bool_, fill=True)

    @property
    def seen(self) -> Ids:
        """int64 (K, F), the point that each feature of each keyframe sees, -1 for none; to be read only."""
        values = self._seen.values.view()
        values.flags.writeable = False
        return values

    @property
    def changed(self) -> NDArray[np.bool_]:
        """Points (P,) that others see than when their mark was last taken away; to be written to."""
        return self._changed.values

    def add_keyframe(self, points: Ids) -> None:
        """Append a keyframe whose features see `points` (F,), -1 for none."""
        for rows in self._tables:
            rows.widen(len(points))
            rows.append(np.full((1, rows.values.shape[1]), -1))
        self.write(len(self._seen) - 1, np.arange(len(points)), points)

    def add_points(self, count: int) -> None:
        """Append points that nothing sees."""
        self._heads.append(np.full(count, -1))
        self._changed.append(np.ones(count, dtype=np.bool_))

    def append(self, other: SightingTable, first_point: int) -> None:
        """Append another table, whose points, which are here already, got numbers higher by `first_point`."""
        theirs = np.where(other.seen >= 0, other.seen + first_point, -1)
        for rows in self._tables:
            rows.widen(theirs.shape[1])
            rows.append(np.full((len(theirs), rows.values.shape[1]), -1))
        self._seen.values[len(self._seen) - len(theirs) :, : theirs.shape[1]] = theirs
        self._link()

    def restore(self, seen: Ids) -> None:
        """Take over a table (K, F) of the same keyframes and points."""
        self._seen.values[...] = seen
        self._link()

    def write(self, keyframes: ArrayLike, features: Ids, points: ArrayLike) -> None:
        """Let features (N,) of keyframes (N,) see points (N,), -1 for none; one keyframe or point stands for N."""
        n = len(features)
        kernels.write(
            self._seen.values, self._before.values, self._after.values, self._heads.values, self.changed,
            _spread(keyframes, n), np.ascontiguousarray(features, dtype=np.int64), _spread(points, n),
        )  # fmt: skip

    def clear(self, points: Ids) -> None:
        """Let nothing see some points."""
        _, cells = kernels.list_cells(self._after.values, self._heads.values, np.ascontiguousarray(points))
        self.write(cells >> kernels.SHIFT, cells & kernels.FEATURE, -1)

    def move(self, points: Ids, replaced_by: Ids) -> None:
        """Let who sees some points see what stands for them by `replaced_by` (P,); a keyframe sees nothing twice by that."""
        _, cells = kernels.list_cells(self._after.values, self._heads.values, points)
        kernels.move(
            self._seen.values, self._before.values, self._after.values, self._heads.values, self.changed, np.sort(cells), replaced_by,
        )  # fmt: skip

    def of(self, points: Ids) -> tuple[Ids, Ids, Ids]:
        """Return who sees points (R,): offsets (R + 1,), keyframes (M,) and features (M,), increasing within a row."""
        offsets, cells = kernels.list_cells(self._after.values, self._heads.values, np.ascontiguousarray(points))
        return offsets, cells >> kernels.SHIFT, cells & kernels.FEATURE

    def count(self, points: Ids, right: NDArray[np.float64]) -> Ids:
        """Return (R,): how often points (R,) are seen, twice where a right column (K, F) is no NaN."""
        return kernels.count_cells(self._after.values, self._heads.values, right, np.ascontiguousarray(points))

    def count_shared(self, points: Ids) -> Ids:
        """Return (K,): how many features of each keyframe see one of some points, each given once."""
        return kernels.count_shared(self._after.values, self._heads.values, points, len(self._seen))

    @property
    def _tables(self) -> tuple[Rows, Rows, Rows]:
        return self._seen, self._before, self._after

    def _link(self) -> None:
        kernels.link_all(
            self._seen.values, len(self._seen), self._before.values, self._after.values, self._heads.values
        )
        self.changed[:] = True


def _spread(values: ArrayLike, count: int) -> NDArray[Any]:
    """Return int64 (N,) values, of which one stands for all."""
    return np.ascontiguousarray(np.broadcast_to(np.asarray(values, dtype=np.int64), (count,)))
