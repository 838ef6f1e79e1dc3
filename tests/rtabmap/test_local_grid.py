# SPDX-License-Identifier: MIT
"""Local grids of scans and depth images, and what they assemble to, by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from slamcli.geometry import se3
from slamcli.grids.ground import GroundSettings
from slamcli.rtabmap.assembly import AssemblySettings, GridAssembly
from slamcli.rtabmap.local_grid import BOTH, DEPTH, SCAN, LocalGridSettings, levelled, local_grid
from slamcli.rtabmap.node_points import DepthSettings, depth_points
from slamcli.rtabmap.signature import NodeImages, NodeScan
from slamcli.vision.pinhole import Pinhole

T_BASE_CAMERA = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]])
"""A camera one metre high, looking ahead."""
HEIGHTS = GroundSettings(by_normals=False, max_ground_height_m=0.1)


def scan(points, **options):
    rows = np.asarray(points, dtype=np.float32)
    rows = np.column_stack([rows, np.zeros(len(rows), np.float32)]) if rows.shape[1] == 2 else rows
    return NodeScan(**{"points": rows, "planar": True, "T_base_sensor": np.eye(4), **options})


def yawed(yaw, x=0.0, y=0.0, roll=0.0):
    c, s, cr, sr = math.cos(yaw), math.sin(yaw), math.cos(roll), math.sin(roll)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return se3.from_rotation_translation(turn, np.array([x, y, 0.0]))


def images(depth, **options):
    height, width = depth.shape
    camera = Pinhole(fx=width / 2, fy=width / 2, cx=width / 2, cy=height / 2, width=width, height=height)
    return NodeImages(
        **{"colour": np.zeros((height, width, 3), np.uint8), "camera": camera, "T_base_camera": T_BASE_CAMERA, "depth": depth, **options}
    )  # fmt: skip


def room(width=80, height=60):
    """Depth of a floor and a wall 3 m ahead, in which a box stands 2 m ahead, from 0.2 m high down."""
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    down, side = (v - height / 2) / (width / 2), (u - width / 2) / (width / 2)
    with np.errstate(divide="ignore"):
        floor = np.where(down > 0, 1.0 / down, np.inf)
    box = np.where((np.abs(side * 2.0) < 0.4) & (down * 2.0 > 0.8) & (down * 2.0 < 1.0), 2.0, np.inf)
    return np.minimum(np.minimum(floor, 3.0), box).astype(np.float32)


def occupied(grid):
    row, column = np.nonzero(grid.cells == 100)
    return np.column_stack([column, row]) * grid.resolution_m + np.array(grid.origin[:2]) + grid.resolution_m / 2


def test_a_planar_scan_is_traced():
    grid = local_grid(None, scan([[0.93, 0.02]]), np.eye(4), LocalGridSettings(sensor=SCAN, cell_size_m=0.25))
    assert grid is not None
    assert not grid.spatial
    np.testing.assert_allclose(grid.obstacles, [[0.93, 0.02]], rtol=1e-6)
    np.testing.assert_allclose(grid.empty, [[0.125, 0.125], [0.375, 0.125], [0.625, 0.125]], rtol=1e-6)
    assert len(grid.ground) == 0


def test_beams_beyond_the_range_only_clear_and_near_ones_are_left_out():
    settings = LocalGridSettings(sensor=SCAN, cell_size_m=1.0, range_max_m=2.6, range_min_m=0.5)
    grid = local_grid(None, scan([[9.5, 0.5], [0.1, -0.1]]), np.eye(4), settings)
    assert (len(grid.obstacles), grid.empty.tolist()) == (0, [[0.5, 0.5], [1.5, 0.5], [2.5, 0.5]])
    unlimited = local_grid(None, scan([[9.5, 0.5]], range_max_m=3.0), np.eye(4), LocalGridSettings(sensor=SCAN, cell_size_m=1.0, range_max_m=0.0))  # fmt: skip
    assert len(unlimited.obstacles) == 1


def test_open_ends_clear():
    ends = np.array([[0.5, 2.5, 0.0]], dtype=np.float32)
    grid = local_grid(
        None, scan(np.zeros((0, 3)), open_ends=ends), np.eye(4), LocalGridSettings(sensor=SCAN, cell_size_m=1.0)
    )
    assert len(grid.obstacles) == 0
    assert [0.5, 2.5] in grid.empty.tolist()


def test_unknown_space_is_filled_between_the_first_and_the_last_beam_only():
    points = scan([[2.0, 0.0], [0.0, 2.0]], range_max_m=3.0)
    settings = LocalGridSettings(sensor=SCAN, cell_size_m=0.1, range_max_m=0.0, scan_2d_unknown_space_filled=True)
    filled = local_grid(None, points, np.eye(4), settings).empty
    assert (np.abs(filled - [1.55, 1.55]).max(axis=1) < 0.06).any()
    assert filled.min() >= -0.11


def test_free_space_of_a_node_that_stands_askew_has_no_holes():
    angles = np.radians(np.arange(0.0, 360.0, 0.5))
    points = np.column_stack([2.0 * np.cos(angles), 2.0 * np.sin(angles)])
    T = yawed(0.6, 1.234, -0.777)
    settings = LocalGridSettings(sensor=SCAN)
    assembly = GridAssembly(0.05, AssemblySettings())
    assembly.add(local_grid(None, scan(points), T, settings), T)
    grid = assembly.grid("map")
    rows, columns = np.indices(grid.cells.shape)
    x, y = (columns + 0.5) * 0.05 + grid.origin[0] - 1.234, (rows + 0.5) * 0.05 + grid.origin[1] + 0.777
    assert (grid.cells[np.hypot(x, y) < 1.9] == 0).all()
    assert (grid.cells[np.hypot(x, y) > 2.1] == -1).all()


def test_depth_by_height():
    settings = LocalGridSettings(depth=DepthSettings(decimation=1), ground=HEIGHTS, cell_size_m=0.1)
    grid = local_grid(images(room()), None, np.eye(4), settings)
    assert grid.spatial
    assert grid.ground[:, 2].max() <= 0.1
    assert grid.obstacles[:, 2].min() > 0.1
    # The box, and the wall, which reaches to both sides of the image.
    np.testing.assert_allclose(np.unique(np.round(grid.obstacles[:, 0], 2)), [2.0, 3.0])
    assert np.abs(grid.obstacles[np.abs(grid.obstacles[:, 0] - 2.0) < 0.01, 1]).max() < 0.4


def test_depth_by_normals_finds_the_same():
    settings = LocalGridSettings(depth=DepthSettings(decimation=1), ground=GroundSettings(max_ground_height_m=0.1))
    grid = local_grid(images(room(320, 240)), None, np.eye(4), settings)
    assert set(np.unique(np.round(grid.obstacles[:, 0], 1)).tolist()) == {2.0, 3.0}
    assert np.abs(grid.ground[:, 2]).max() < 0.05
    assert len(grid.ground) > 300


def test_a_tilted_camera_sees_the_same_world():
    """A base that rolls is levelled, whether points keep their height or not."""
    upright = images(room(160, 120))
    T = yawed(0.4, 0.3, 0.2, roll=0.3)
    roll = np.linalg.inv(yawed(0.4, 0.3, 0.2)) @ T
    tilted = images(room(160, 120), T_base_camera=np.linalg.inv(roll) @ T_BASE_CAMERA)
    for spatial in (True, False):
        settings = LocalGridSettings(depth=DepthSettings(decimation=1), ground=HEIGHTS, spatial=spatial, cell_size_m=0.1, pre_voxel_filtering=False)  # fmt: skip
        grids = []
        for seen, pose in ((upright, yawed(0.4, 0.3, 0.2)), (tilted, T)):
            assembly = GridAssembly(0.1, AssemblySettings())
            assembly.add(local_grid(seen, None, pose, settings), pose)
            grids.append(assembly.grid("map"))
        assert grids[0].cells.shape == grids[1].cells.shape
        assert (grids[0].cells != grids[1].cells).sum() <= 0.05 * (grids[0].cells >= 0).sum()


def test_cells_of_the_plane_are_few():
    settings = LocalGridSettings(depth=DepthSettings(decimation=1), ground=HEIGHTS, cell_size_m=0.1)
    plane = local_grid(images(room()), None, np.eye(4), replace(settings, spatial=False))
    assert plane.obstacles.shape[1] == 2
    assert len(plane.obstacles) < len(local_grid(images(room()), None, np.eye(4), settings).obstacles)
    traced = local_grid(images(room()), None, np.eye(4), replace(settings, spatial=False, ray_tracing=True))
    assert len(traced.ground) == 0
    # Between the camera and the floor that it sees first there is nothing.
    assert (np.abs(traced.empty - [0.55, 0.05]).max(axis=1) < 0.01).any()
    assert not (traced.empty[np.abs(traced.empty[:, 1]) < 0.1][:, 0] > 2.05).any()


def test_points_of_the_robot_itself_and_out_of_the_heights_are_left_out():
    points = scan([[0.1, 0.0, 0.2], [1.0, 0.0, 0.2], [1.0, 0.0, 1.9], [1.0, 0.0, -0.4]], planar=False)
    settings = LocalGridSettings(
        sensor=SCAN, ground=HEIGHTS, footprint_m=(0.4, 0.4, 0.5), min_ground_height_m=-0.2, max_obstacle_height_m=1.5
    )
    grid = local_grid(None, points, np.eye(4), settings)
    np.testing.assert_allclose(grid.obstacles, [[1.0, 0.0, 0.2]], rtol=1e-6)
    assert len(grid.ground) == 0


def test_heights_in_the_map():
    points, T = scan([[1.0, 0.0, -0.95], [1.0, 0.0, 0.0]], planar=False), np.eye(4)
    T[2, 3] = 1.0
    settings = LocalGridSettings(sensor=SCAN, ground=HEIGHTS)
    assert len(local_grid(None, points, T, settings).ground) == 2
    lifted = local_grid(None, points, T, LocalGridSettings(sensor=SCAN, ground=HEIGHTS, map_frame_projection=True))
    np.testing.assert_allclose(lifted.ground, [[1.0, 0.0, -0.95]], rtol=1e-6)
    np.testing.assert_allclose(lifted.obstacles, [[1.0, 0.0, 0.0]], rtol=1e-6)


def test_both_sensors_and_neither():
    settings = LocalGridSettings(sensor=BOTH, ground=HEIGHTS, depth=DepthSettings(decimation=1))
    planar = scan([[1.5, 0.5, 0.05]])
    grid = local_grid(images(room()), planar, np.eye(4), settings)
    np.testing.assert_allclose(grid.obstacles[0], [1.5, 0.5, 0.05], rtol=1e-6)  # a planar scan shows obstacles only
    assert len(grid.obstacles) > 100
    assert local_grid(None, planar, np.eye(4), LocalGridSettings(sensor=DEPTH)) is None
    assert local_grid(replace(images(room()), depth=None), None, np.eye(4), settings) is None


def test_ground_can_be_an_obstacle():
    settings = LocalGridSettings(sensor=SCAN, ground=HEIGHTS, ground_is_obstacle=True)
    grid = local_grid(None, scan([[1.0, 0.0, 0.0]], planar=False), np.eye(4), settings)
    assert (len(grid.ground), len(grid.obstacles)) == (0, 1)


def test_depth_points_of_part_of_the_image():
    depth = np.arange(1, 65, dtype=np.float32).reshape(8, 8) / 10
    seen = depth_points(images(depth), DepthSettings(decimation=2, roi_ratios=(0.25, 0.25, 0.5, 0.0)), 3.6, 5.2)
    np.testing.assert_allclose(seen.points[:, 0], [3.7, 5.1], rtol=1e-6)
    np.testing.assert_allclose(seen.points[0], [3.7, -3.7 * (4 - 4) / 4, 1.0], atol=1e-6)
    depth[4, 4] = np.nan
    assert (
        len(
            depth_points(images(depth), DepthSettings(decimation=2, roi_ratios=(0.25, 0.25, 0.5, 0.0)), 3.6, 5.2).points
        )
        == 1
    )


def test_the_global_grid_covers_clears_and_chooses():
    T = np.stack([np.eye(4)] * 4)
    T[:, 2, 3] = [0.0, 3.0, 0.1, 0.0]
    assert AssemblySettings(altitude_delta_m=0.5).chosen(T).tolist() == [0, 2, 3]
    assert AssemblySettings(altitude_delta_m=0.5, max_nodes=2).chosen(T).tolist() == [2, 3]
    assert AssemblySettings().chosen(T[:0]).tolist() == []
    settings = LocalGridSettings(sensor=SCAN, cell_size_m=0.1)
    assembly = GridAssembly(0.1, AssemblySettings(min_size_m=8.0, footprint_radius_m=0.3))
    assembly.add(local_grid(None, scan([[0.15, 0.05], [2.05, 0.05]]), np.eye(4), settings), np.eye(4))
    grid = assembly.grid("odom")
    assert grid.cells.shape == (101, 101)
    np.testing.assert_allclose(occupied(grid), [[2.05, 0.05]])
    assert int((grid.cells == 0).sum()) == 36
    assert grid.frame_id == "odom"
    assert GridAssembly(0.1, AssemblySettings()).grid("map") is None


def test_levelled_keeps_place_and_yaw():
    T = yawed(0.7, 1.0, 2.0, roll=0.5)
    np.testing.assert_allclose(levelled(T), yawed(0.7, 1.0, 2.0), atol=1e-12)
    assert levelled(T)[2, 2] == pytest.approx(1.0)
