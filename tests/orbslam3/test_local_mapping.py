# SPDX-License-Identifier: MIT
"""What a keyframe sets off: new points, culling, fusion, bundle adjustment, in a round room."""

from collections import Counter

import numpy as np
import pytest
from loop_world import World, position_error, true_pose

from slamcli.orbslam3.bundles import adjust_all, adjust_local
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.fusion import fuse
from slamcli.orbslam3.initialisation import MonocularStart, start_with_depth
from slamcli.orbslam3.local_mapping import LocalMapping, MappingSettings
from slamcli.orbslam3.point_creation import points_from_depth, points_from_neighbours
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.vision.matching import feature_grid

SCALES = 1.2 ** np.arange(8.0)
TURNS = np.linspace(0.0, 0.5, 6)


def frame_of(world, turn, number=0):
    features, things = world.look(true_pose(turn))
    grid = feature_grid(features, world.camera)
    return Frame(
        number=number, stamp_ns=number, features=features, grid=grid, points=np.full(len(features), -1)
    ), things


def test_depth_makes_the_close_points_where_they_are():
    world = World(focal_error=0.0, noise_px=0.0)
    sparse_map = SparseMap(world.camera, SCALES)
    frame, things = frame_of(world, 0.0)
    assert start_with_depth(sparse_map, frame, close_m=3.5, least=20, words=None, refused=Counter())
    ids = frame.points[frame.points >= 0]
    wanted = world.points[things[frame.points >= 0]] @ true_pose(0.0)[:3, :3].T + true_pose(0.0)[:3, 3]
    assert len(ids) >= 100
    assert np.median(np.linalg.norm(sparse_map.positions[ids] - wanted, axis=1)) < 0.05
    none = SparseMap(world.camera, SCALES)
    assert not start_with_depth(none, frame, close_m=3.5, least=10**4, words=None, refused=Counter())
    assert none.num_keyframes == 0
    assert len(points_from_depth(sparse_map, 0, 3.5)) == 0  # all are made


def test_neighbours_triangulate_what_neither_has():
    world = World(stereo=False, focal_error=0.0, count=2500)
    sparse_map = world.build(TURNS)
    mine = sparse_map.seen[5].copy()
    sparse_map.remove_points(np.unique(mine[mine >= 0]))
    made = points_from_neighbours(sparse_map, 5, np.array([4, 3]))
    assert len(made) > 60
    features = np.array([int(np.flatnonzero(sparse_map.seen[5] == p)[0]) for p in made])
    T = sparse_map.T_camera_map[5]
    again = world.camera.project(sparse_map.positions[made] @ T[:3, :3].T + T[:3, 3])
    assert np.median(np.linalg.norm(again - sparse_map.pixels[5, features], axis=1)) < 2.0


def test_two_points_of_one_thing_become_one():
    world = World(focal_error=0.0)
    sparse_map = world.build(TURNS)
    row = sparse_map.seen[5]
    at = np.flatnonzero(row >= 0)[:40]
    twins = sparse_map.add_points(sparse_map.positions[row[at]] + 1e-4, 5, at)  # now the keyframe sees the twins
    sparse_map.refresh_points(twins)
    before = int(sparse_map.point_alive.sum())
    others = sparse_map.points_of(np.array([4]))
    found = fuse(sparse_map, 5, others)
    gone = before - int(sparse_map.point_alive.sum())
    assert found >= gone > 20
    assert (sparse_map.replaced_by[twins] >= 0).sum() + (sparse_map.replaced_by[others] >= 0).sum() == gone


def test_points_that_nothing_finds_again_go():
    world = World(focal_error=0.0)
    sparse_map = world.build(TURNS)
    counts = Counter()
    mapping = LocalMapping(MappingSettings(close_m=6.0), counts)
    rare = sparse_map.points_of(np.array([4, 5]))[:5]
    mapping.insert(sparse_map, 5, rare, None)
    assert sparse_map.point_alive[rare].all()
    sparse_map.visible[rare], sparse_map.found[rare] = 10, 2  # ten frames should have seen them, and two did
    mapping.insert(sparse_map, 5, np.empty(0, dtype=np.int64), None)
    assert not sparse_map.point_alive[rare].any()
    assert counts["points culled"] >= 5


def test_a_keyframe_that_shows_nothing_new_goes():
    world = World(focal_error=0.0, noise_px=0.1)
    sparse_map = world.build(np.linspace(0.0, 0.05, 6))
    counts = Counter()
    LocalMapping(MappingSettings(close_m=20.0), counts).insert(sparse_map, 5, np.empty(0, dtype=np.int64), None)
    assert counts["keyframes culled"] >= 1
    assert sparse_map.keyframe_alive[[0, 5]].all()


@pytest.mark.parametrize("everything", [True, False])
def test_bundle_adjustment_takes_noise_out_of_poses(everything):
    world = World(focal_error=0.0)
    sparse_map = world.build(TURNS)
    rng = np.random.default_rng(3)
    sparse_map.T_camera_map[3:, :3, 3] += rng.normal(0, 0.03, (3, 3))
    before, _ = position_error(sparse_map, world.truth)
    if everything:
        adjust_all(sparse_map)
    else:
        adjust_local(sparse_map, 5, most=4)
    after, _ = position_error(sparse_map, world.truth)
    assert after < 0.4 * before
    observed = sparse_map.count_observations()
    assert (observed[sparse_map.point_alive] >= 2).all()


def test_one_camera_begins_with_two_views():
    world = World(stereo=False, focal_error=0.0, count=2500)
    sparse_map = SparseMap(world.camera, SCALES)
    start = MonocularStart(1, lambda frame: None, Counter())
    began = []
    for number, turn in enumerate(np.linspace(0.0, 0.3, 8)):
        frame, _ = frame_of(world, turn, number)
        began.append(start.take(sparse_map, frame))
        if began[-1]:
            break
    assert not began[0]  # one view is not enough
    assert began[-1]
    assert sparse_map.num_keyframes == 2
    ids = sparse_map.points_of(np.array([0]))
    assert len(ids) >= 50
    assert np.median(sparse_map.positions[ids, 2]) == pytest.approx(1.0)
    step = sparse_map.centres[1] - sparse_map.centres[0]
    T = true_pose(turn) @ np.linalg.inv(true_pose(0.0))
    wanted = -T[:3, :3].T @ T[:3, 3]
    assert step @ wanted / np.linalg.norm(step) / np.linalg.norm(wanted) > 0.97
