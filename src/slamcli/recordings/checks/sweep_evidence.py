# SPDX-License-Identifier: MIT
"""What the sweeps of a range sensor showed: when they began and ended, and what they held."""

from __future__ import annotations

import zlib
from array import array
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import LaserScan, PointCloud


@dataclass(slots=True)
class SweepEvidence:
    """Times and contents of the sweeps of one topic, in recorded order."""

    timed: bool = False
    """Whether any of them took time."""
    num_repeats: int = 0
    """Sweeps with exactly the readings of the one before."""
    first_repeat_ns: int | None = None
    _first: array[int] = field(default_factory=lambda: array("q"))
    _last: array[int] = field(default_factory=lambda: array("q"))
    _num_points: array[int] = field(default_factory=lambda: array("q"))
    _checksum: int | None = None

    @property
    def first_ns(self) -> NDArray[np.int64]:
        """int64 (N,), when the first point of each sweep was measured."""
        return np.array(self._first, dtype=np.int64)

    @property
    def last_ns(self) -> NDArray[np.int64]:
        """int64 (N,), when the last one was."""
        return np.array(self._last, dtype=np.int64)

    @property
    def num_points(self) -> NDArray[np.int64]:
        """int64 (N,), readings that are distances."""
        return np.array(self._num_points, dtype=np.int64)

    def see(self, _message: Any, sweep: LaserScan | PointCloud) -> None:
        """Take a sweep in."""
        begins, ends, num, readings = _scanned(sweep) if isinstance(sweep, LaserScan) else _clouded(sweep)
        self._first.append(sweep.stamp_ns + _within(begins))
        self._last.append(sweep.stamp_ns + _within(ends))
        self._num_points.append(num)
        self.timed |= ends > begins
        checksum = zlib.crc32(readings.tobytes())
        if num and checksum == self._checksum:
            self.num_repeats += 1
            self.first_repeat_ns = self.first_repeat_ns if self.first_repeat_ns is not None else sweep.stamp_ns
        self._checksum = checksum


def _scanned(scan: LaserScan) -> tuple[float, float, int, NDArray[Any]]:
    length_ns = max(scan.num_beams - 1, 0) * scan.time_increment_s * 1e9
    num = int(np.count_nonzero(np.isfinite(scan.ranges_m) & (scan.ranges_m > 0)))
    return min(length_ns, 0.0), max(length_ns, 0.0), num, scan.ranges_m


def _clouded(cloud: PointCloud) -> tuple[float, float, int, NDArray[Any]]:
    times = cloud.offset_ns
    if times is None or len(times) == 0:
        return 0.0, 0.0, len(cloud.points_m), cloud.points_m
    return float(times.min()), float(times.max()), len(cloud.points_m), cloud.points_m


def _within(offset_ns: float) -> int:
    """Return an offset as a whole number; what no sweep lasts for becomes a day."""
    return round(min(max(offset_ns if offset_ns == offset_ns else 0.0, -8.64e13), 8.64e13))
