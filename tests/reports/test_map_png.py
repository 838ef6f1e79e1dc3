# SPDX-License-Identifier: MIT
"""The picture of a map, checked pixel by pixel where a cell's colour is known."""

import io
import sys

import numpy as np
import pytest
from PIL import Image

from slamcli.grids import OccupancyGrid
from slamcli.reports.figures import map as map_figure
from slamcli.reports.figures import map_png, plane
from slamcli.trajectory import Trajectory

UNKNOWN, FREE, WALL = (208, 214, 222), (255, 255, 255), (24, 26, 32)


def pixels(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def painted(grid: OccupancyGrid, max_pixels: int = 2000) -> np.ndarray:
    view = map_figure._choose_view(grid, np.zeros((0, 2)), max_pixels)
    return map_figure.paint_cells(grid, view)


def colour_at(grid: OccupancyGrid, picture: np.ndarray, row: int, column: int, max_pixels: int = 2000) -> tuple:
    view = map_figure._choose_view(grid, np.zeros((0, 2)), max_pixels)
    x, y = view.pixels(grid.cell_to_map([(row, column)]))[0]
    return tuple(int(v) for v in picture[int(y), int(x)])


def planar(points, seconds=10.0):
    points = np.asarray(points, dtype=float)
    stamps = np.linspace(0, seconds * 1e9, len(points)).astype(np.int64)
    return Trajectory.from_se2(stamps, np.column_stack([points, np.zeros(len(points))]))


@pytest.fixture
def small():
    cells = np.zeros((10, 10), dtype=np.int8)
    cells[0, :] = 100
    cells[5, 5] = -1
    cells[7, 2] = 50
    return OccupancyGrid(cells, 0.1, (1.0, -2.0, 0.0))


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_every_kind_of_cell_has_its_colour(small, yaw):
    grid = OccupancyGrid(small.cells, small.resolution_m, (1.0, -2.0, yaw))
    picture = painted(grid)
    assert colour_at(grid, picture, 0, 3) == WALL
    assert colour_at(grid, picture, 3, 3) == FREE
    assert colour_at(grid, picture, 5, 5) == UNKNOWN
    grey = colour_at(grid, picture, 7, 2)
    assert all(abs(g - (255 + w) / 2) <= 1 for g, w in zip(grey, WALL, strict=True))


def test_y_points_up(small):
    picture = painted(small)
    rows = np.flatnonzero((picture == WALL).all(axis=2).any(axis=1))
    assert rows.min() > picture.shape[0] / 2  # row 0 of the grid is at the bottom


@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_downsampling_keeps_walls_of_one_cell(yaw):
    cells = np.zeros((4000, 3000), dtype=np.int8)
    cells[1777, :] = 100
    grid = OccupancyGrid(cells, 0.05, (-10.0, 3.0, yaw))
    picture = painted(grid, max_pixels=500)
    assert max(picture.shape[:2]) <= 530
    for column in range(0, 3000, 37):
        view = map_figure._choose_view(grid, np.zeros((0, 2)), 500)
        x, y = view.pixels(grid.cell_to_map([(1777, column)]))[0].astype(int)
        assert (picture[y, x] == WALL).all(), column


def test_crops_to_what_is_known_and_drawn():
    cells = np.full((1000, 1000), -1, dtype=np.int8)
    cells[500:520, 600:640] = 0
    grid = OccupancyGrid(cells, 0.05)
    alone = map_figure._choose_view(grid, np.zeros((0, 2)), 2000)
    assert alone.width_px * alone.metres_per_px == pytest.approx(42 * 0.05)
    assert alone.left_m == pytest.approx(599 * 0.05)
    wider = map_figure._choose_view(grid, np.array([[0.0, 0.0]]), 2000)
    assert wider.left_m < 0
    assert wider.bottom_m < 0


@pytest.mark.parametrize("shape", [(1, 1), (10, 10), (1, 500), (500, 1), (0, 0), (0, 5)])
def test_any_shape_gives_a_picture(shape):
    assert pixels(map_png(OccupancyGrid(np.full(shape, -1, dtype=np.int8), 0.05))).shape[2] == 3
    assert min(pixels(map_png(OccupancyGrid(np.zeros(shape, dtype=np.int8), 0.05))).shape[:2]) > 20


def test_same_input_gives_the_same_bytes_and_no_metadata(small):
    arguments = dict(trajectory=planar([(1.2, -1.8), (1.8, -1.2)]), title="twice")
    first = map_png(small, **arguments)
    assert first == map_png(small, **arguments)
    assert Image.open(io.BytesIO(first)).info == {}


def test_trajectory_runs_from_dark_blue_to_orange(small):
    trajectory = planar([(1.2, -1.5), (1.5, -1.5), (1.8, -1.5)])
    view = map_figure._choose_view(small, np.zeros((0, 2)), 2000)
    picture = map_figure.paint_cells(small, view)
    plane.draw_trajectory(picture, view.pixels(trajectory.positions_m[:, :2]), trajectory.stamps_ns, 2.0)
    (x0, y0), (x1, y1) = view.pixels([(1.2, -1.5), (1.8, -1.5)]).astype(int)
    assert tuple(picture[y0, x0]) == (41, 5, 147)
    assert tuple(picture[y1, x1]) == (249, 149, 65)


@pytest.mark.parametrize(
    "points", [[(1.5, -1.5)], [(1.5, -1.5)] * 4, [(1.5, -1.5), (1e7, 1e7)], np.zeros((0, 2)), [(-3e5, 0.0), (1.0, 2.0)]]
)
def test_odd_trajectories_are_drawn(small, points):
    assert max(pixels(map_png(small, trajectory=planar(points), truth=planar(points))).shape) < 2500


def test_backward_stamps_are_drawn(small):
    trajectory = Trajectory.from_se2([5, 4, 3, 1], [[1.2, -1.5, 0], [1.3, -1.5, 0], [1.4, -1.5, 0], [1.5, -1.4, 0]])
    assert pixels(map_png(small, trajectory=trajectory)).size


def test_path_start_and_goal(small):
    path = np.array([(1.2, -1.8), (1.5, -1.5), (1.8, -1.2)])
    plain = pixels(map_png(small))
    drawn = pixels(
        map_png(small, path=path, start=(1.2, -1.8, 0.3), goal=(1.8, -1.2), footprint_radius_m=0.05, title="<a> \n b")
    )
    assert (drawn == (0, 114, 178)).all(axis=2).sum() > 100
    assert not (plain == (0, 114, 178)).all(axis=2).any()
    gap = np.array([(1.2, -1.8), (np.nan, np.nan), (1.8, -1.2)])
    assert pixels(map_png(small, path=gap)).size


def test_loads_no_plotting_library():
    import subprocess

    code = "import sys, slamcli.reports.figures, slamcli.reports.html; print(sorted({'matplotlib','scipy','cv2','numba'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
