# SPDX-License-Identifier: MIT
"""Arrays that grow by rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Rows:
    """An array (N, ...) whose rows are appended in amortised constant time."""

    def __init__(self, shape: tuple[int, ...], dtype: Any, fill: Any = 0) -> None:
        self.fill = fill
        """What cells hold that nothing was written to."""
        self._data: NDArray[Any] = np.full((16, *shape), fill, dtype=dtype)
        self._length = 0

    def __len__(self) -> int:
        return self._length

    @property
    def values(self) -> NDArray[Any]:
        """The rows (N, ...), a view that writes through; it is outdated by the next `append`."""
        return self._data[: self._length]

    def append(self, rows: NDArray[Any]) -> None:
        """Append rows (M, ...)."""
        needed = self._length + len(rows)
        if needed > len(self._data):
            self._grow(needed, self._data.shape[1:])
        self._data[self._length : needed] = rows
        self._length = needed

    def widen(self, width: int) -> None:
        """Make the second axis at least `width` long; new cells hold the fill value."""
        if self._data.shape[1] < width:
            self._grow(len(self._data), (width, *self._data.shape[2:]))

    def _grow(self, needed: int, shape: tuple[int, ...]) -> None:
        size = max(needed, len(self._data) * (2 if needed > len(self._data) else 1))
        data = np.full((size, *shape), self.fill, dtype=self._data.dtype)
        corner = tuple(slice(0, n) for n in self._data.shape)
        data[corner] = self._data
        self._data = data
