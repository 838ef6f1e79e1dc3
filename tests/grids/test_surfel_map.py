# SPDX-License-Identifier: MIT
"""The map of planes equals a naive twin built on dicts and NumPy's eigenvectors."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.grids.surfel_map import SurfelMap

pytestmark = pytest.mark.kernels


def naive_planes(points, size, levels):
    """Mean, normal and variance by (level, cell), for cells whose points lie in a plane."""
    planes = {}
    for level in range(levels):
        edge = size * 2**level
        cells = {}
        for p in points:
            cells.setdefault(tuple(np.floor(p / edge).astype(int)), []).append(p)
        for cell, members in cells.items():
            n = len(members)
            if n < 6:
                continue
            values, vectors = np.linalg.eigh(np.cov(np.array(members).T, bias=True))
            thin = max(values[0], 0.0) * n / (n - 3)
            if thin < 0.003 * edge**2 + 1e-4 and values[1] > 9 * thin and values[1] > 0.006 * edge**2:
                planes[level, cell] = np.mean(members, axis=0), vectors[:, 0], thin
    return planes


def scene(seed=0, n=1200):
    rng = np.random.default_rng(seed)
    floor = np.column_stack([rng.uniform(-4, 4, (n, 2)), rng.normal(0, 0.01, n)])
    wall = np.column_stack([rng.normal(3.3, 0.01, n), rng.uniform(-4, 4, n), rng.uniform(0, 3, n)])
    bush = rng.normal([-2, -2, 1], 0.3, (200, 3))
    return np.concatenate([floor, wall, bush])


def planes_of(surfels):
    rows = surfels.planes[: len(surfels)]
    return rows[rows[:, 6] >= 0]


def test_planes_equal_the_naive_twin():
    points = scene()
    surfels = SurfelMap(0.4, 3, capacity=10**6)
    # In one go a voxel is fitted once, with all of its points.
    surfels.add(points)
    expected = naive_planes(points, 0.4, 3)
    found = planes_of(surfels)
    assert len(found) == len(expected) > 100
    order = sorted(expected)
    means = np.array([expected[key][0] for key in order])
    for row in found:
        nearest = order[int(np.argmin(np.linalg.norm(means - row[:3], axis=1)))]
        mean, normal, thin = expected[nearest]
        np.testing.assert_allclose(row[:3], mean, atol=1e-9)
        assert abs(row[3:6] @ normal) == pytest.approx(1.0, abs=1e-6)
        assert row[6] == pytest.approx(thin, rel=1e-6, abs=1e-12)


def test_a_full_voxel_keeps_the_plane_that_was_seen_first():
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(0.01, 0.99, (100, 2)), 0.3 + rng.normal(0, 0.002, 100)])
    surfels = SurfelMap(1.0, 1, capacity=100)
    surfels.add(flat)
    before = planes_of(surfels).copy()
    surfels.add(flat + np.array([0, 0, 0.2]))
    np.testing.assert_array_equal(planes_of(surfels), before)
    assert before[0, 2] == pytest.approx(0.3, abs=1e-3)


def test_what_lies_behind_is_forgotten_and_the_rest_is_found_again():
    points = scene(2)
    surfels = SurfelMap(0.4, 2)
    surfels.add(points)
    before = len(surfels)
    surfels.forget_beyond(np.array([3.0, 0.0, 0.0]), 2.0)
    assert 0 < len(surfels) < before / 2
    kept = len(surfels)
    near = points[np.abs(points - [3.0, 0.0, 0.0]).max(axis=1) < 1.5]
    surfels.add(near)
    assert len(surfels) == kept, "voxels that were kept are found in the table"


def test_wrong_settings_are_refused():
    for size, levels, capacity in ((0.0, 1, 100), (0.4, 5, 100), (0.4, 1, 2)):
        with pytest.raises(ValueError, match="surfel map"):
            SurfelMap(size, levels, capacity)
