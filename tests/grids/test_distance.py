# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.grids.distance import least_distance, nearest_cell, squared_distance

pytestmark = pytest.mark.kernels


def naive_squared(mask: np.ndarray) -> np.ndarray:
    sources = np.argwhere(mask)
    cells = np.argwhere(np.ones_like(mask))
    return ((cells[:, None] - sources[None]) ** 2).sum(axis=2).min(axis=1).reshape(mask.shape)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [0.01, 0.1, 0.6])
def test_equals_the_naive_field(seed: int, share: float) -> None:
    random = np.random.default_rng(seed)
    mask = random.random((random.integers(1, 30), random.integers(1, 30))) < share
    mask.flat[random.integers(mask.size)] = True
    np.testing.assert_array_equal(squared_distance(mask), naive_squared(mask))


def test_no_source_is_minus_one_everywhere() -> None:
    assert (squared_distance(np.zeros((3, 5), dtype=bool)) == -1).all()
    assert squared_distance(np.zeros((0, 5), dtype=bool)).shape == (0, 5)


def test_wrong_mask() -> None:
    with pytest.raises(DataError, match="bool"):
        squared_distance(np.zeros((3, 3)))


@pytest.mark.parametrize("seed", range(20))
def test_nearest_cell_equals_naive(seed: int) -> None:
    random = np.random.default_rng(seed)
    mask = random.random((12, 17)) < 0.05
    point = tuple(float(v) for v in random.uniform(-10, 25, 2))
    found = nearest_cell(mask, point)
    sources = np.argwhere(mask)
    if not len(sources):
        assert found is None
        return
    best = np.sqrt(((sources - np.array(point)) ** 2).sum(axis=1)).min()
    assert np.hypot(found[0] - point[0], found[1] - point[1]) == pytest.approx(best)


def test_nearest_cell_of_a_point_far_away() -> None:
    mask = np.zeros((4, 4), dtype=bool)
    mask[3, 0] = True
    assert nearest_cell(mask, (1e6, -1e6)) == (3, 0)
    assert nearest_cell(np.zeros((4, 4), dtype=bool), (0.0, 0.0)) is None
    with pytest.raises(DataError, match="finite"):
        nearest_cell(mask, (float("nan"), 0.0))


def test_least_distance_is_to_the_edge_of_the_cell() -> None:
    mask = np.zeros((9, 9), dtype=bool)
    mask[4, 8] = True
    squared = squared_distance(mask)
    assert least_distance(mask, squared, [[4.0, 0.0]]) == 7.5
    assert least_distance(mask, squared, [[4.0, 0.0], [4.2, 6.9]]) == pytest.approx(0.6)
    assert least_distance(mask, squared, [[0.0, 7.0]]) == pytest.approx(np.hypot(3.5, 0.5))
    assert least_distance(np.zeros_like(mask), squared_distance(np.zeros_like(mask)), [[0, 0]]) == np.inf


def test_least_distance_equals_the_naive_one() -> None:
    random = np.random.default_rng(4)
    for share in (0.002, 0.02, 0.3):
        for _ in range(40):
            mask = random.random(random.integers(3, 40, 2)) < share
            mask[0, 0] = True
            points = random.random((random.integers(1, 30), 2)) * mask.shape - 0.5
            naive = min(np.hypot(*np.maximum(np.abs(np.argwhere(mask) - point) - 0.5, 0.0).T).min() for point in points)
            assert least_distance(mask, squared_distance(mask), points) == pytest.approx(naive, abs=1e-12)
