# SPDX-License-Identifier: MIT
"""Maps against maps: a known building, moved, thinned and broken."""

import numpy as np
import pytest

from slamcli.errors import EstimationError, UsageError
from slamcli.evaluation.map_errors import map_errors
from slamcli.evaluation.map_layers import map_layers
from slamcli.evaluation.map_registration import register
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid

CELL = 0.05


def building():
    """Two rooms of different size with a door between them, and a pillar; 8 m by 6 m."""
    cells = np.full((140, 180), -1, dtype=np.int8)
    cells[10:130, 10:170] = 0
    for rows, columns in [
        ((10, 11), (10, 170)), ((129, 130), (10, 170)), ((10, 130), (10, 11)), ((10, 130), (169, 170)),
        ((10, 60), (70, 71)), ((78, 130), (70, 71)), ((30, 38), (120, 128)), ((90, 91), (100, 140)),
    ]:  # fmt: skip
        cells[slice(*rows), slice(*columns)] = 100
    return OccupancyGrid(cells, CELL, (-1.0, -2.0, 0.0))


def seen_from(grid, T, cell=CELL):
    """Return the map drawn in another frame: T takes points of the map's frame to the new one."""
    corners = se2.transform_points(
        T, grid.cell_to_map([[0, 0], [0, grid.width], [grid.height, 0], [grid.height, grid.width]])
    )
    low, high = corners.min(axis=0) - 0.5, corners.max(axis=0) + 0.5
    width, height = np.ceil((high - low) / cell).astype(int)
    empty = OccupancyGrid(np.full((height, width), -1, dtype=np.int8), cell, (*low.tolist(), 0.0))
    rc = np.indices((height, width)).reshape(2, -1).T
    source = grid.map_to_cell(se2.transform_points(se2.inverse(T), empty.cell_to_map(rc)))
    inside = grid.contains(source)
    values = np.full(len(rc), -1, dtype=np.int8)
    values[inside] = grid.cells[source[inside, 0], source[inside, 1]]
    return OccupancyGrid(values.reshape(height, width), cell, empty.origin)


def layers(grid):
    return map_layers(grid, "map")


def test_a_map_equals_itself():
    m = layers(building())
    found = register(m, m)
    np.testing.assert_allclose(found.T_reference_map, 0, atol=1e-9)
    errors = map_errors(m, m, found.T_reference_map, tolerance_m=0.1)
    assert errors.accuracy == errors.completeness == errors.f_score == 1
    assert errors.to_reference_m.max() < 1e-9
    assert (errors.agreement, errors.occupied_iou, errors.free_iou, errors.coverage) == (1, 1, 1, 1)
    assert errors.ssim == pytest.approx(1)


@pytest.mark.parametrize("T", [[0.4, -0.3, 0.05], [12.0, 5.0, 1.9], [-30.0, 8.0, -3.1], [0.0, 0.0, np.pi / 2]])
def test_registration_finds_the_pose(T):
    truth, moved = layers(building()), layers(seen_from(building(), np.array(T)))
    found = register(moved, truth)
    x, y, yaw = se2.compose(T, found.T_reference_map)
    corner = se2.compose(found.T_reference_map, T)
    assert np.hypot(x, y) < 0.3 * np.hypot(*T[:2]) + CELL / 2
    assert abs(yaw) < np.radians(0.3)
    for point in ([0, 0], [7, 4]):
        back = se2.transform_points(corner, [point])[0]
        assert (
            np.abs(back - point).max() < 0.7 * CELL
        )  # drawing on other cells shifts up to half a cell along each axis
    errors = map_errors(moved, truth, found.T_reference_map, tolerance_m=0.1)
    assert errors.accuracy > 0.99
    assert errors.completeness > 0.99
    assert errors.agreement > 0.98


def test_refinement_does_not_depend_on_where_the_origin_is():
    """In coordinates of a survey the least turn about the origin is kilometres: the middle of the walls must be turned about."""
    truth, grid = layers(building()), seen_from(building(), np.array([0.05, -0.03, np.radians(0.5)]))
    near = register(layers(grid), truth, search=False)
    away = [
        OccupancyGrid(g.cells, g.resolution_m, (g.origin[0] + 448_000.0, g.origin[1] + 5_400_000.0, g.origin[2]))
        for g in (grid, truth.grid)
    ]
    far = register(layers(away[0]), layers(away[1]), search=False)
    assert near.overlap > 0.9
    assert far.overlap == pytest.approx(near.overlap, abs=1e-4)
    middle, away_m = np.array([[3.0, 1.0]]), np.array([448_000.0, 5_400_000.0])
    there = se2.transform_points(far.T_reference_map, middle + away_m) - away_m
    np.testing.assert_allclose(there, se2.transform_points(near.T_reference_map, middle), atol=1e-3)


def test_same_input_same_output():
    truth, moved = layers(building()), layers(seen_from(building(), np.array([3.0, 1.0, 0.9])))
    a, b = register(moved, truth), register(moved, truth)
    assert a.T_reference_map.tobytes() == b.T_reference_map.tobytes()


def test_other_resolution_is_no_matter():
    truth, moved = layers(building()), layers(seen_from(building(), np.array([3.0, 1.0, 0.9]), cell=0.08))
    found = register(moved, truth)
    assert se2.compose([3.0, 1.0, 0.9], found.T_reference_map)[2] == pytest.approx(0, abs=np.radians(0.5))
    assert map_errors(moved, truth, found.T_reference_map, tolerance_m=0.16).f_score > 0.98


def test_a_missing_room_costs_completeness_not_accuracy():
    half = building()
    half.cells[:, 70:] = -1
    truth, part = layers(building()), layers(half)
    found = register(part, truth)
    np.testing.assert_allclose(found.T_reference_map[:2], 0, atol=CELL)
    errors = map_errors(part, truth, found.T_reference_map, tolerance_m=0.1)
    assert errors.accuracy > 0.99
    assert 0.3 < errors.completeness < 0.5
    assert errors.coverage == pytest.approx(60 / 160, abs=0.01)


def test_a_doubled_wall_costs_accuracy_not_completeness():
    doubled = building()
    doubled.cells[20:120, 150] = 100
    errors = map_errors(layers(doubled), layers(building()), np.zeros(3), tolerance_m=0.1)
    assert errors.accuracy < 0.9
    assert errors.completeness > 0.999
    assert errors.to_reference_m.max() == pytest.approx(19 * CELL)
    assert errors.to_map_m.max() == 0


def test_wall_distances_are_the_shift():
    wall = np.zeros((60, 60), dtype=np.int8)
    wall[30, :] = 100
    moved = OccupancyGrid(wall, 0.1, (0.0, 0.25, 0.0))
    errors = map_errors(layers(moved), layers(OccupancyGrid(wall, 0.1)), np.zeros(3), tolerance_m=0.2)
    assert errors.to_reference_m == pytest.approx(np.full(60, 0.25))
    assert errors.accuracy == 0


def test_inside_of_solid_blocks_is_no_wall():
    solid = np.full((50, 50), 100, dtype=np.int8)
    solid[20:30, 20:30] = 0
    assert len(layers(OccupancyGrid(solid, 0.1)).walls_m) == 44
    drawing = np.full((50, 50), -1, dtype=np.int8)
    drawing[10] = 100
    assert len(layers(OccupancyGrid(drawing, 0.1)).walls_m) == 50


def test_maps_that_cannot_be_compared():
    empty = OccupancyGrid(np.zeros((20, 20), dtype=np.int8), 0.1)
    with pytest.raises(EstimationError, match="no occupied cell"):
        layers(empty)
    m = layers(building())
    with pytest.raises(EstimationError, match="know no cell in common"):
        map_errors(m, m, np.array([100.0, 0, 0]), tolerance_m=0.1)
    with pytest.raises(UsageError, match="must be a positive number"):
        map_errors(m, m, np.zeros(3), tolerance_m=0)
    far = OccupancyGrid(building().cells, CELL, (500.0, 0.0, 0.0))
    with pytest.raises(EstimationError, match="no wall of one map comes near"):
        register(layers(far), m, search=False)
