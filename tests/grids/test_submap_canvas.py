# SPDX-License-Identifier: MIT
"""What is drawn bit by bit is what is drawn at once."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError, EstimationError
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.submap_canvas import SubmapCanvas
from slamcli.grids.submap_drawing import draw_submaps
from slamcli.grids.tsdf_grid import TsdfGrid

pytestmark = pytest.mark.kernels


def some_grid(random, size=(12, 40)) -> ProbabilityGrid:
    cells = random.integers(1, 32768, random.integers(*size, 2)).astype(np.uint16)
    cells[random.random(cells.shape) < 0.3] = 0
    return ProbabilityGrid(cells, 0.1, (float(random.normal()), float(random.normal())))


def same(grid, grids, poses) -> float:
    """Share of cells that are not as the naive drawing of everything at once has them."""
    whole = draw_submaps(grids, poses, 0.1)
    row, column = grid.map_to_cell([np.add(whole.origin[:2], 0.05)])[0]
    inside = grid.cells[row : row + whole.height, column : column + whole.width]
    assert (grid.cells >= 0).sum() == (inside >= 0).sum()
    return float((inside != whole.cells).mean())


@pytest.mark.parametrize("seed", range(4))
def test_growing_moving_and_settling_equals_drawing_at_once(seed: int) -> None:
    random = np.random.default_rng(seed)
    canvas = SubmapCanvas()
    grids: list[ProbabilityGrid] = []
    poses = np.zeros((0, 3))
    for _ in range(12):
        grids.append(some_grid(random))
        poses = np.vstack([poses, random.normal(0, 2, 3)])
        if random.random() < 0.5:
            moved = random.random(len(poses)) < random.choice([0.2, 0.9])
            poses = poses + moved[:, None] * random.normal(0, 1, poses.shape)
        finished = max(len(grids) - 2, 0)
        assert same(canvas.draw(grids, poses, finished), grids, poses) < 0.002
        grids[finished:] = [some_grid(random) for _ in grids[finished:]]  # open ones are drawn into
        assert same(canvas.draw(grids, poses, finished), grids, poses) < 0.002


def test_a_hair_is_not_drawn_and_the_origin_stays() -> None:
    random = np.random.default_rng(0)
    canvas, grids = SubmapCanvas("m"), [some_grid(random) for _ in range(3)]
    poses = np.zeros((3, 3))
    first = canvas.draw(grids, poses, 3)
    second = canvas.draw(grids, poses + np.array([0.019, 0.0, 0.0005]), 3)
    assert np.array_equal(first.cells, second.cells)
    assert first.origin == second.origin
    assert second.frame_id == "m"
    third = canvas.draw(grids, poses + np.array([0.021, 0.0, 0.0]), 3)
    assert not np.array_equal(first.cells, third.cells)


def test_signed_distances_are_drawn_as_a_whole() -> None:
    distances = TsdfGrid.empty(0.1, (0.0, 0.0), 0.3, 10.0)
    random = np.random.default_rng(1)
    grids, poses = [some_grid(random), distances], np.zeros((2, 3))
    assert np.array_equal(SubmapCanvas().draw(grids, poses, 1).cells, draw_submaps(grids, poses, 0.1).cells)


def test_nothing_to_draw_or_broken_poses() -> None:
    with pytest.raises(EstimationError, match="no submap yet"):
        SubmapCanvas().draw([], np.zeros((0, 3)), 0)
    empty = ProbabilityGrid(np.zeros((4, 4), np.uint16), 0.1, (0.0, 0.0))
    with pytest.raises(EstimationError, match="no submap has a known cell"):
        SubmapCanvas().draw([empty], np.zeros((1, 3)), 0)
    with pytest.raises(DataError, match="not finite"):
        SubmapCanvas().draw([empty], np.full((1, 3), np.nan), 0)
    far = [some_grid(np.random.default_rng(2)) for _ in range(2)]
    with pytest.raises(DataError, match="too large"):
        SubmapCanvas().draw(far, np.array([[0.0, 0.0, 0.0], [1e5, 1e5, 0.0]]), 2)
