# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from slamcli.cartographer import TIER
from slamcli.cartographer.parameters import CartographerParameters, Extensions3d
from slamcli.cartographer.state_map_3d import draw_state_3d, planar_grids, state_cloud
from slamcli.errors import DataError, EstimationError
from slamcli.geometry import se3
from slamcli.grids.hybrid_grid import HybridGrid
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap

STEP = 0.1
SETTINGS = Extensions3d()


def a_room(slope: float = 0.0, T_map_submap: np.ndarray | None = None) -> MapState:
    """A room of 6 x 4 m with a floor that rises along x, walls of 2.5 m, a ceiling, and a table; two nodes in it."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(-30, 31), np.arange(-20, 21)))
    floor = np.column_stack([x, y, np.rint(slope * x)])
    ceiling = floor + np.array([0, 0, 25])
    edge = (np.abs(x) == 30) | (np.abs(y) == 20)
    walls = np.concatenate([floor[edge] + np.array([0, 0, z]) for z in range(25)])
    table = floor[(np.abs(x - 10) <= 3) & (np.abs(y) <= 2)] + np.array([0, 0, 7])
    voxels = np.unique(np.concatenate([floor, ceiling, walls, table]), axis=0).astype(np.int32)
    free = np.array([[0, 0, 5]], np.int32)
    values = np.full(len(voxels), 30000, np.uint16)
    grid = HybridGrid(np.concatenate([voxels, free]), np.append(values, np.uint16(2000)), STEP)
    T_local = se3.from_se2([5.0, 5.0, 0.0])
    T_map = T_local if T_map_submap is None else T_map_submap
    submap = Submap(id=Id(0, 0), T_local_submap=T_local, T_map_submap=T_map, num_range_data=2, finished=True,
                    high_resolution=grid, low_resolution=grid, rotational_histogram=np.zeros(4, np.float32))  # fmt: skip
    nodes, constraints = [], []
    for number, at in enumerate([-2.0, 0.0]):
        T = se3.from_rotation_translation(np.eye(3), [at, 0.0, slope * at + 0.3])
        nodes.append(Node(id=Id(0, number), stamp_ns=number, T_local_node=T_local @ T, T_map_node=T_map @ T,
                          gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]), points_m=np.zeros((0, 3), np.float32)))  # fmt: skip
        constraints.append(Constraint(submap=submap.id, node=Id(0, number), T_submap_node=T, translation_weight=1.0,
                                      rotation_weight=1.0, kind="intra"))  # fmt: skip
    return MapState(nodes=tuple(nodes), submaps=(submap,), constraints=tuple(constraints))


@pytest.mark.parametrize("slope", [0.0, 0.15])
def test_walls_and_furniture_stand_and_the_floor_is_free_on_slopes_too(slope: float) -> None:
    grid = draw_state_3d(SETTINGS, a_room(slope), "map")
    assert grid.resolution_m == SETTINGS.projection_resolution
    centres = np.array([[x, y] for x in np.arange(-3, 3.05, 0.1) for y in np.arange(-2, 2.05, 0.1)]) + 5.0
    cells = grid.map_to_cell(centres + 0.01)  # one of the four cells of a voxel
    found = grid.cells[cells[:, 0], cells[:, 1]]
    away = np.abs(centres - 5.0)
    wall = (away[:, 0] > 2.95) | (away[:, 1] > 1.95)
    table = (np.abs(centres[:, 0] - 6.0) < 0.35) & (away[:, 1] < 0.25)
    assert (found[wall] == 100).all()
    assert (found[table] == 100).all()
    assert (found[~wall & ~table] != 0).sum() <= 4  # in the corners two walls weigh more than the floor
    assert (found[~wall & ~table] >= 0).all()
    assert (grid.cells == 100).sum() <= 4 * (wall.sum() + table.sum() + 4)


def test_the_map_moves_with_the_submap() -> None:
    grid = draw_state_3d(SETTINGS, a_room(T_map_submap=se3.from_se2([20.0, 0.0, np.pi / 2])), "world")
    assert grid.frame_id == "world"
    rows, columns = np.nonzero(grid.cells == 100)
    corners = grid.cell_to_map(np.column_stack([rows, columns]))
    np.testing.assert_allclose(corners.min(axis=0), [18.0, -3.0], atol=0.11)
    np.testing.assert_allclose(corners.max(axis=0), [22.0, 3.0], atol=0.11)


def test_the_cloud_has_the_occupied_voxels_in_the_map() -> None:
    state = a_room()
    cloud = state_cloud(state, "map")
    assert cloud is not None
    assert len(cloud.points_m) == len(state.submaps[0].high_resolution.indices) - 1
    np.testing.assert_allclose(cloud.points_m.min(axis=0), [2.0, 3.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(cloud.points_m.max(axis=0), [8.0, 7.0, 2.5], atol=1e-6)


def test_the_tier_draws_it() -> None:
    drawing = TIER.draw(CartographerParameters(), a_room(), "map")
    assert drawing.cloud is not None
    assert (drawing.grid.cells == 100).sum() > 200


def test_nothing_to_draw_and_broken_voxels() -> None:
    empty = MapState(nodes=(), submaps=(), constraints=())
    with pytest.raises(EstimationError, match="no submap of the state has a path"):
        draw_state_3d(SETTINGS, empty, "map")
    assert state_cloud(empty, "map") is None
    state = a_room()
    unseen = MapState(nodes=state.nodes, submaps=state.submaps, constraints=())
    assert planar_grids(SETTINGS, unseen) == {}
    far = HybridGrid(np.array([[-(10**6)] * 3, [10**6] * 3], np.int32), np.full(2, 30000, np.uint16), STEP)
    object.__setattr__(state.submaps[0], "high_resolution", far)
    with pytest.raises(DataError, match="200000 x 200000 m"):
        draw_state_3d(SETTINGS, state, "map")
