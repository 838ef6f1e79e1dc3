# SPDX-License-Identifier: MIT
from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import DataError, EstimationError
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.submap_drawing import draw_submaps

pytestmark = pytest.mark.kernels

FREE, WALL = 32767, 1  # costs 0.9 and 0.1


def naive(grids, poses, grid) -> np.ndarray:
    """The same by looping over cells and submaps in plain Python."""
    out = np.full(grid.cells.shape, -1)
    for (row, column), _ in np.ndenumerate(out):
        total = weight = 0.0
        x0, y0 = grid.origin[0] + (column + 0.5) * grid.resolution_m, grid.origin[1] + (row + 0.5) * grid.resolution_m
        for submap, (tx, ty, yaw) in zip(grids, poses, strict=True):
            p = submap.probabilities()
            x = math.cos(yaw) * (x0 - tx) + math.sin(yaw) * (y0 - ty)
            y = -math.sin(yaw) * (x0 - tx) + math.cos(yaw) * (y0 - ty)
            u, v = (
                (x - submap.origin[0]) / submap.resolution_m - 0.5,
                (y - submap.origin[1]) / submap.resolution_m - 0.5,
            )
            for i in (math.floor(v), math.floor(v) + 1):
                for j in (math.floor(u), math.floor(u) + 1):
                    if 0 <= i < p.shape[0] and 0 <= j < p.shape[1] and not np.isnan(p[i, j]):
                        w = (1 - abs(u - j)) * (1 - abs(v - i))
                        weight += w
                        total += w * math.log(p[i, j] / (1 - p[i, j]))
        if weight >= 0.499:
            out[row, column] = 100 if total > 0 else 0 if total < 0 else -1
    return out


@pytest.mark.parametrize("seed", range(5))
def test_equals_the_naive_drawing(seed: int) -> None:
    random = np.random.default_rng(seed)
    grids, poses = [], random.normal(size=(3, 3))
    for _ in range(3):
        cells = random.integers(1, 32768, random.integers(3, 9, 2)).astype(np.uint16)
        cells[random.random(cells.shape) < 0.2] = 0
        grids.append(ProbabilityGrid(cells, 0.1, (float(random.normal()), float(random.normal()))))
    grid = draw_submaps(grids, poses, 0.07, margin_cells=2, occupied_probability=0.5, free_probability=0.5)
    expected = naive(grids, poses, grid)
    assert (grid.cells != expected).mean() < 0.002  # a cell whose log odds cancel may fall to either side
    assert {-1, 0, 100} == set(np.unique(grid.cells).tolist())


def test_one_grid_at_the_origin_is_drawn_as_it_is() -> None:
    cells = np.array([[FREE, FREE, 0], [FREE, WALL, WALL]], np.uint16)
    grid = draw_submaps([ProbabilityGrid(cells, 0.5, (1.0, -2.0))], np.zeros((1, 3)), 0.5, "world", margin_cells=1)
    assert grid.cells.tolist() == [[-1] * 5, [-1, 0, 0, -1, -1], [-1, 0, 100, 100, -1], [-1] * 5]
    assert grid.origin == (0.5, -2.5, 0.0)
    assert grid.frame_id == "world"


def test_moving_all_submaps_moves_the_map() -> None:
    cells = np.array([[FREE, 0], [WALL, FREE]], np.uint16)
    grid = draw_submaps(
        [ProbabilityGrid(cells, 1.0, (0.0, 0.0))], np.array([[5.0, 3.0, math.pi / 2]]), 1.0, margin_cells=0
    )
    assert grid.cells.tolist() == [[100, 0], [0, -1]]
    assert grid.origin == (3.0, 3.0, 0.0)


def test_the_majority_of_submaps_counts_and_thresholds_leave_doubt_unknown() -> None:
    grids = [ProbabilityGrid(np.array([[value]], np.uint16), 1.0, (0.0, 0.0)) for value in (WALL, WALL, FREE)]
    assert draw_submaps(grids, np.zeros((3, 3)), 1.0, margin_cells=0).cells.tolist() == [[100]]
    doubtful = draw_submaps(
        grids, np.zeros((3, 3)), 1.0, margin_cells=0, occupied_probability=0.7, free_probability=0.3
    )
    assert doubtful.cells.tolist() == [[-1]]


def test_nothing_to_draw_or_broken_poses() -> None:
    empty = ProbabilityGrid(np.zeros((2, 2), np.uint16), 0.05, (0.0, 0.0))
    with pytest.raises(EstimationError, match="no submap has a known cell"):
        draw_submaps([empty], np.zeros((1, 3)), 0.05)
    with pytest.raises(DataError, match="not finite"):
        draw_submaps([empty], np.full((1, 3), np.nan), 0.05)
    known = ProbabilityGrid(np.ones((2, 2), np.uint16), 0.05, (0.0, 0.0))
    with pytest.raises(DataError, match="would be"):
        draw_submaps([known, known], np.array([[0.0, 0, 0], [1e6, 1e6, 0]]), 0.05)
    with pytest.raises(DataError, match="poses are broken"):
        draw_submaps([known], np.array([[1e300, 0.0, 0.0]]), 0.05)


def test_rounding_does_not_decide_where_the_map_begins() -> None:
    cells = np.full((4, 3), FREE, np.uint16)
    maps = [
        draw_submaps([ProbabilityGrid(cells, 0.05, (1.5 + off, 0.35 - off))], np.zeros((1, 3)), 0.05)
        for off in (0.0, 1e-13, -1e-13)
    ]
    for other in maps[1:]:
        assert other.origin == maps[0].origin
        np.testing.assert_array_equal(other.cells, maps[0].cells)
