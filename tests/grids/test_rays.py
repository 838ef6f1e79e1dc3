# SPDX-License-Identifier: MIT
"""Free cells along rays, by hand and against a naive twin."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.grids.rays import free_cells, swept_ends

pytestmark = pytest.mark.kernels
NONE = np.zeros((0, 2))


def naive_free(start, hits, ends, cell):
    """Walk along every ray in tiny steps."""
    hit = {tuple(c) for c in np.floor(hits / cell).astype(int).tolist()}
    free = set()
    for end in np.concatenate([hits, ends]):
        for share in np.linspace(0.0, 1.0, 20001):
            at = tuple(np.floor((start + share * (end - start)) / cell).astype(int).tolist())
            if at in hit:
                break
            free.add(at)
    return free


def test_cells_up_to_a_hit():
    cells = free_cells(np.array([0.5, 0.5]), np.array([[3.5, 0.5]]), NONE, 1.0)
    assert cells.tolist() == [[0, 0], [1, 0], [2, 0]]


def test_cells_of_an_open_ray_include_its_end_on_both_sides_of_zero():
    cells = free_cells(np.array([0.5, 0.5]), NONE, np.array([[-1.5, 0.5]]), 1.0)
    assert cells.tolist() == [[-2, 0], [-1, 0], [0, 0]]


def test_a_ray_does_not_pass_what_another_hit():
    cells = free_cells(np.array([0.5, 0.5]), np.array([[2.5, 0.6]]), np.array([[5.5, 0.5]]), 1.0)
    assert cells.tolist() == [[0, 0], [1, 0]]


def test_no_rays_no_cells():
    assert free_cells(np.zeros(2), NONE, NONE, 0.05).shape == (0, 2)


@pytest.mark.parametrize("seed", range(4))
def test_free_cells_are_those_of_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    start = rng.uniform(-3, 3, 2)
    hits, ends = start + rng.normal(0, 3, (12, 2)), start + rng.normal(0, 3, (5, 2))
    found = {tuple(cell) for cell in free_cells(start, hits, ends, 0.25).tolist()}
    expected = naive_free(start, hits, ends, 0.25)
    # The walk misses cells whose corner a ray just cuts.
    assert len(found ^ expected) <= 2
    assert expected - found == set()


def test_the_order_of_rays_does_not_matter():
    rng = np.random.default_rng(7)
    hits = rng.normal(0, 3, (40, 2))
    np.testing.assert_array_equal(
        free_cells(np.zeros(2), hits, NONE, 0.1), free_cells(np.zeros(2), hits[::-1].copy(), NONE, 0.1)
    )


def test_swept_rays_fill_the_way_the_scanner_turned():
    hits = np.array([[1.0, 0.0], [0.0, 1.0]])
    ends = swept_ends(np.zeros(2), hits, 2.0, 0.5)
    assert len(ends) == 4  # a quarter of a turn: as many as cells along the reach
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), 2.0)
    np.testing.assert_allclose(np.arctan2(ends[:, 1], ends[:, 0]), np.arange(1, 5) * math.pi / 8)
    back = swept_ends(np.zeros(2), hits[::-1], 2.0, 0.5)
    np.testing.assert_allclose(
        np.arctan2(back[:, 1], back[:, 0]), math.pi / 2 - np.arange(1, 5) * math.pi / 8, atol=1e-12
    )
    assert len(swept_ends(np.zeros(2), hits[:1], 2.0, 0.5)) == 0


def test_broken_ranges_are_refused():
    with pytest.raises(DataError, match="its ranges are broken"):
        free_cells(np.zeros(2), np.array([[1e6, 1e6]]), NONE, 0.05)
