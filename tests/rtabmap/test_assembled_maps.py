# SPDX-License-Identifier: MIT
"""All maps of a few nodes, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.parameters import as_dict, resolve
from slamcli.rtabmap.grid_settings import above_floor, assembly_settings, local_grid_settings
from slamcli.rtabmap.maps import build_maps
from slamcli.rtabmap.node_points import colours_at, with_depth
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import NodeImages, NodeScan
from slamcli.vision.pinhole import Pinhole

T_BASE_CAMERA = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]])
CAMERA = Pinhole(fx=32.0, fy=32.0, cx=32.0, cy=24.0, width=64, height=48)


def parameters(**values):
    return resolve(
        RtabmapParameters, as_dict(RtabmapParameters()), {name.replace("__", "/"): v for name, v in values.items()}
    )


def wall(metres=2.0):
    """A red wall that fills the image, above a floor."""
    v = np.arange(48.0)[:, None] * np.ones((1, 64))
    down = (v - 24.0) / 32.0
    with np.errstate(divide="ignore"):
        floor = np.where(down > 0, 1.0 / down, np.inf)
    depth = np.minimum(floor, metres).astype(np.float32)
    colour = np.zeros((48, 64, 3), np.uint8)
    colour[..., 0] = 200
    return NodeImages(colour=colour, camera=CAMERA, T_base_camera=T_BASE_CAMERA, depth=depth)


def at_x(x):
    T = np.eye(4)
    T[0, 3] = x
    return T


HEIGHTS = {
    "Grid__NormalsSegmentation": False,
    "Grid__MaxGroundHeight": 0.05,
    "Grid__DepthDecimation": 1,
    "Grid__CellSize": 0.1,
}


def test_grid_cloud_and_octree_of_two_nodes():
    images = {1: wall(), 2: wall(1.5)}
    given = parameters(**HEIGHTS, Grid__RayTracing=True)
    seen = []
    maps = build_maps(
        [(2, at_x(0.55)), (1, at_x(0.05))], lambda i: (images[i], None), given, map_frame="world", stamp_ns=5,
        keep=lambda i, grid: seen.append((i, len(grid.obstacles))),
    )  # fmt: skip
    assert [i for i, _ in seen] == [1, 2]  # in the order of their ids
    _, column = np.nonzero(maps.grid.cells == 100)
    assert np.unique(column * 0.1 + maps.grid.origin[0]).round(6).tolist() == [2.0]
    assert maps.grid.frame_id == "world"
    wall_points = maps.cloud.points_m[maps.cloud.points_m[:, 2] > 0.2]
    np.testing.assert_allclose(wall_points[:, 0], 2.05, atol=1e-5)
    assert (maps.cloud.colours == [200, 0, 0]).all()
    assert (maps.cloud.frame_id, maps.cloud.stamp_ns) == ("world", 5)
    tree = maps.octree
    assert set(tree.indices[tree.occupied & ~tree.ground][:, 0].tolist()) == {20}
    assert tree.indices[tree.ground][:, 2].max() <= 0
    between = (tree.indices == [10, 0, 9]).all(axis=1)
    np.testing.assert_allclose(tree.log_odds[between], 2 * np.log(0.4 / 0.6), rtol=1e-5)


def test_an_octree_on_request_leaves_the_grid_as_it_is():
    plain = build_maps([(1, np.eye(4))], lambda _: (wall(), None), parameters(**HEIGHTS))
    asked = build_maps([(1, np.eye(4))], lambda _: (wall(), None), parameters(**HEIGHTS), octree=True)
    assert plain.octree is None
    np.testing.assert_array_equal(plain.grid.cells, asked.grid.cells)
    assert (~asked.octree.occupied).sum() > 100


def test_nodes_are_chosen_by_number_and_height():
    poses = [(i, at_x(float(i))) for i in (1, 2, 3)]
    read = []

    def sensors(i):
        read.append(i)
        return wall(), None

    build_maps(poses, sensors, parameters(**HEIGHTS, GridGlobal__MaxNodes=2))
    assert read == [2, 3]


def test_a_planar_scan_has_a_grid_alone():
    scan = NodeScan(points=np.array([[1.0, 0.0, 0.2]], np.float32), planar=True, T_base_sensor=np.eye(4))
    maps = build_maps([(1, np.eye(4))], lambda _: (None, scan), parameters(Grid__Sensor=0), octree=True)
    assert int((maps.grid.cells == 100).sum()) == 1
    assert (maps.cloud, maps.octree) == (None, None)


def test_a_sweep_is_coloured_where_the_camera_sees():
    points = np.array([[2.0, 0.0, 1.0], [2.0, 0.5, 1.2], [-2.0, 0.0, 1.0]], np.float32)
    scan = NodeScan(points=points, planar=False, T_base_sensor=np.eye(4))
    maps = build_maps([(1, np.eye(4))], lambda _: (wall(), scan), parameters(Grid__Sensor=0))
    assert sorted(map(tuple, maps.cloud.colours.tolist())) == [(128, 128, 128), (200, 0, 0), (200, 0, 0)]
    alone = build_maps([(1, np.eye(4))], lambda _: (None, scan), parameters(Grid__Sensor=0))
    assert alone.cloud.colours is None
    colours, seen = colours_at(points.astype(float), replace(wall(), colour=np.full((48, 64), 7, np.uint8)))
    assert (colours[:2].tolist(), seen.tolist()) == ([[7, 7, 7]] * 2, [True, True, False])


def test_nothing_seen_no_maps():
    maps = build_maps([(1, np.eye(4))], lambda _: (None, None), parameters(), octree=True)
    assert (maps.grid, maps.cloud, maps.octree) == (None, None, None)
    maps = build_maps([], lambda _: (None, None), parameters())
    assert maps.grid is None
    off = build_maps([(1, np.eye(4))], lambda _: (wall(), None), parameters(RGBD__CreateOccupancyGrid=False))
    assert off.grid is None
    assert off.cloud is not None


def test_depth_of_a_stereo_pair():
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 255, (120, 400), dtype=np.uint8)
    disparity = 20
    left, right = texture[:, :320], texture[:, disparity : 320 + disparity]
    camera = Pinhole(fx=200.0, fy=200.0, cx=160.0, cy=60.0, width=320, height=120, baseline_m=0.1)
    images = NodeImages(colour=left, camera=camera, T_base_camera=np.eye(4), right=right)
    for semi_global in (False, True):
        depth = with_depth(images, semi_global=semi_global).depth
        inner = depth[20:100, 180:290]
        assert np.median(inner) == pytest.approx(1.0)
        assert (np.abs(inner - 1.0) < 0.02).mean() > 0.95
    assert with_depth(replace(images, right=None)) is None
    assert with_depth(None) is None
    assert with_depth(wall()).depth is not None


def test_limits_follow_from_the_floor_where_the_user_left_them_alone():
    settings = local_grid_settings(parameters())
    above = above_floor(settings, -1.5)
    assert (above.ground.max_ground_height_m, above.max_obstacle_height_m) == pytest.approx((-1.35, 0.5))
    assert above.map_frame_projection
    assert above_floor(settings, -2.0).max_obstacle_height_m == 1e-6
    for name, value in (("MaxObstacleHeight", 1.0), ("MapFrameProjection", True), ("MaxGroundHeight", 0.2)):
        given = local_grid_settings(parameters(**{f"Grid__{name}": value}))
        assert above_floor(given, -1.5) == given
    assert local_grid_settings(parameters(Grid__MaxObstacleHeight=-1.0)).max_obstacle_height_m == 0.0


def test_settings_that_exclude_each_other_are_off():
    assert local_grid_settings(parameters(Grid__NormalsSegmentation=False)).ground.max_ground_height_m == 0.05
    high = local_grid_settings(parameters(Grid__MaxGroundHeight=0.5, Grid__MaxObstacleHeight=0.3))
    assert (high.max_obstacle_height_m, high.ground.max_ground_height_m) == (0.0, 0.5)
    low = local_grid_settings(parameters(Grid__MaxGroundHeight=0.1, Grid__MinGroundHeight=0.2))
    assert low.min_ground_height_m == 0.0
    assert local_grid_settings(parameters(Grid__MaxGroundAngle=90.0)).ground.max_angle_rad == pytest.approx(np.pi / 2)
    assert assembly_settings(parameters(GridGlobal__OccupancyThr=0.7)).odds.threshold == 0.7
    with pytest.raises(ConfigError, match="must be below"):
        parameters(GridGlobal__ProbClampingMin=0.9, GridGlobal__ProbClampingMax=0.5)


def test_tables_are_obstacles_where_the_floor_is_known():
    floor, table = wall(3.0), wall(3.0)
    depth = table.depth.copy()
    v, u = np.mgrid[0:48, 0:64]
    top = 0.4 / np.maximum((v - 24.0) / 32.0, 1e-9)  # 0.6 m above the floor
    on = (np.abs(u - 32) < 12) & (top > 1.0) & (top < 1.6)
    depth[on] = top[on]
    images = {1: floor, 2: replace(table, depth=depth)}
    given = {"Grid__DepthDecimation": 1, "Grid__MinClusterSize": 3, "Grid__NormalK": 8}
    grids = [
        build_maps([(2, np.eye(4))], lambda i: (images[i], None), parameters(**given), floor_m=floor_m).grid
        for floor_m in (None, 0.0)
    ]
    cells = []
    for grid in grids:
        column, row = (int((v - o) // grid.resolution_m) for v, o in zip((1.3, 0.0), grid.origin[:2], strict=True))
        cells.append(grid.cells[row - 3 : row + 4, column - 3 : column + 4])
    assert (cells[0] == 100).sum() == 0
    assert (cells[0] == 0).sum() > 5
    assert (cells[1] == 100).sum() > 5
