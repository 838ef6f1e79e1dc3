# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import se2
from slamcli.grids.occupancy import OccupancyGrid

ORIGINS = [(0.0, 0.0, 0.0), (-12.5, 7.25, 0.0), (3.0, -2.0, 0.3), (1.0, 1.0, np.pi)]


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("dtype", [np.uint8, np.int64, np.float32, np.float64])
def test_cells_and_points(origin: tuple[float, float, float], dtype: type) -> None:
    grid = OccupancyGrid(np.zeros((4, 5), dtype=np.int8), 0.05, origin)
    rng = np.random.default_rng(1)
    cells = rng.integers(0, 200, (500, 2)).astype(dtype)
    local = (cells[:, ::-1].astype(np.float64) + 0.5) * 0.05
    points = grid.cell_to_map(cells)
    np.testing.assert_allclose(points, se2.transform_points(np.array(origin), local), rtol=0, atol=1e-12)
    found = grid.map_to_cell(points)
    assert found.dtype == np.int64
    np.testing.assert_array_equal(found, cells.astype(np.int64))
    np.testing.assert_array_equal(grid.map_to_cell(np.asfortranarray(points)), found)


def test_one_none_and_points_outside() -> None:
    grid = OccupancyGrid(np.zeros((4, 5), dtype=np.int8), 0.5, (1.0, 2.0, np.pi / 2))
    np.testing.assert_allclose(grid.cell_to_map([0, 1]), [[0.75, 2.75]], atol=1e-12)
    np.testing.assert_array_equal(grid.map_to_cell([1.1, 1.9]), [[-1, -1]])
    assert grid.cell_to_map([]).shape == grid.map_to_cell([]).shape == (0, 2)
