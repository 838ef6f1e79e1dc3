# SPDX-License-Identifier: MIT
"""Maps that share tiles are written to by several threads: the order in which these run must not matter."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.grids.tiles import TiledMaps

pytestmark = pytest.mark.kernels


class Backwards:
    """An executor that runs what it was given last first, as threads may."""

    def __init__(self):
        self._waiting = []

    def submit(self, work, *arguments):
        self._waiting.append((work, arguments))
        return self

    def result(self):
        while self._waiting:
            work, arguments = self._waiting.pop()
            work(*arguments)


def cells_of(maps: TiledMaps) -> np.ndarray:
    return np.stack([maps.cells[table] for table in maps.tables])


def test_the_last_owner_of_a_shared_tile_waits_for_those_who_copy_it():
    rng = np.random.default_rng(3)
    serial = TiledMaps(4, 0.05, (-5.0, -5.0, 5.0, 5.0))
    threads = TiledMaps(4, 0.05, (-5.0, -5.0, 5.0, 5.0), Backwards(), 4)
    start = np.zeros((50, 2))
    for _ in range(5):
        angles = rng.uniform(-np.pi, np.pi, 50)
        ends = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(0.5, 4.0, (50, 1))
        poses = rng.normal(0, 0.1, (4, 3))
        parents = np.sort(rng.integers(0, 4, 4))
        for maps in (serial, threads):
            maps.add_scan(poses, start, ends, np.ones(50, dtype=bool))
            maps.resample(parents)
        np.testing.assert_array_equal(cells_of(threads), cells_of(serial))
