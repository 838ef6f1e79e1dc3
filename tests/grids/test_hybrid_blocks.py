# SPDX-License-Identifier: MIT
"""The 3D probability grid equals a naive twin that keeps its cells in a dict."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.grids.hybrid_blocks import HybridBlocks, probability_of, value_of

pytestmark = pytest.mark.kernels


def lround(value):
    return math.floor(abs(value) + 0.5) * (1 if value >= 0 else -1)


class NaiveGrid:
    """Cells as a dict of values; update by odds in float32, each cell once per scan."""

    def __init__(self, resolution):
        self.resolution, self.cells = resolution, {}

    def insert(self, origin, points, hit, miss, free):
        done = set()

        def update(cell, probability):
            if cell in done:
                return
            done.add(cell)
            odds = np.float32(probability) / (np.float32(1) - np.float32(probability))
            if cell not in self.cells:
                new = np.float32(probability)
            else:
                old = probability_of(np.array([self.cells[cell]], dtype=np.uint16))[0]
                together = odds * old / (np.float32(1) - old)
                new = together / (np.float32(1) + together)
            self.cells[cell] = int(value_of(np.array([new], dtype=np.float32))[0])

        ends = [tuple(lround(c / self.resolution) for c in p) for p in points]
        start = tuple(lround(c / self.resolution) for c in origin)
        for end in ends:
            update(end, hit)
        for end in ends:
            delta = [e - s for e, s in zip(end, start, strict=True)]
            samples = max(abs(d) for d in delta)
            for k in range(max(0, samples - free), samples):
                update(tuple(s + int(d * k / samples) for s, d in zip(start, delta, strict=True)), miss)


def scans(seed=0, n=12, points=300):
    rng = np.random.default_rng(seed)
    for _ in range(n):
        yield rng.normal(0, 0.5, 3), rng.normal(0, 3.0, (points, 3)) + np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("free", [0, 2, 5])
def test_inserting_equals_the_naive_twin(free):
    grid, twin = HybridBlocks(0.25), NaiveGrid(0.25)
    for origin, points in scans():
        grid.insert(origin, points, 0.55, 0.49, free)
        twin.insert(origin, points, 0.55, 0.49, free)
    record = grid.record()
    expected = sorted(twin.cells)
    assert record.indices.tolist() == [list(cell) for cell in expected]
    assert record.values.tolist() == [twin.cells[cell] for cell in expected]


def test_record_and_back_is_the_same_grid():
    grid = HybridBlocks(0.1)
    for origin, points in scans(1):
        grid.insert(origin, points, 0.55, 0.49, 2)
    record = grid.record()
    again = HybridBlocks.from_record(record).record()
    np.testing.assert_array_equal(again.indices, record.indices)
    np.testing.assert_array_equal(again.values, record.values)
    assert np.array_equal(grid.probabilities(record.indices.astype(np.int64)), probability_of(record.values))
    assert grid.probabilities(np.array([[10**5, 0, 0]]))[0] == np.float32(0.1)


def test_hits_raise_and_misses_lower():
    grid = HybridBlocks(0.1)
    for _ in range(200):
        grid.insert(np.zeros(3), np.array([[1.0, 0.0, 0.0]]), 0.55, 0.49, 2)
    p = grid.probabilities(np.array([[10, 0, 0], [9, 0, 0], [8, 0, 0], [7, 0, 0]]))
    assert p[0] == pytest.approx(0.9, abs=1e-3)
    assert p[1] == p[2] == pytest.approx(0.1, abs=1e-3)
    assert len(grid.record().values) == 3


def test_interpolation_meets_the_cells_and_its_gradient_is_that_of_differences():
    grid = HybridBlocks(0.2)
    for origin, points in scans(2):
        grid.insert(origin, points, 0.55, 0.49, 2)
    cells = grid.record().indices[:50].astype(np.int64)
    values, _ = grid.interpolate(cells * 0.2 + 1e-9)
    np.testing.assert_allclose(values, grid.probabilities(cells), atol=1e-6)
    points = np.random.default_rng(4).normal(0, 2.0, (200, 3))
    values, gradients = grid.interpolate(points)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        slope = (grid.interpolate(points + step)[0] - grid.interpolate(points - step)[0]) / 2e-6
        np.testing.assert_allclose(gradients[:, axis], slope, atol=1e-5)


def test_values_are_cartographers():
    # mapping/probability_values.h: 16 bits, 1 is 0.1, 32767 is 0.9, 0 is unknown
    assert value_of(np.array([0.1, 0.9, 0.0, 1.0, 0.5], dtype=np.float32)).tolist() == [1, 32767, 1, 32767, 16384]
    assert probability_of(np.array([0, 1, 32767], dtype=np.uint16)).tolist() == pytest.approx([0.1, 0.1, 0.9])
