# SPDX-License-Identifier: MIT
"""The whole tier in space, in a small hall: loops, maps, determinism, going on from a state, and bad input."""

from __future__ import annotations

import dataclasses
import heapq

import numpy as np
import pytest
from lidar_room import Drive, Lidar, hall, imu_samples

from slamcli.cartographer import _projection_kernels
from slamcli.cartographer.cloud_grouping import CloudGrouping
from slamcli.cartographer.graph_3d import Graph3D
from slamcli.cartographer.map_cloud_3d import MapCloud
from slamcli.cartographer.mapper_3d import Mapper3D
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.cartographer.projection_3d import Projection
from slamcli.errors import DataError, EstimationError
from slamcli.geometry import quaternion, se3
from slamcli.grids import OccupancyGrid
from slamcli.mapper import Setup
from slamcli.measurements import ImuSample, PointCloud, StampedPose
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap
from slamcli.runtime import RunLog

LIDAR = Lidar(16, 180)
SECOND = 1_000_000_000


def small(**ext):
    """Small submaps, so that a short drive has several; nodes at every scan of a moving robot."""
    p = CartographerParameters()
    builder, graph = p.trajectory_builder_3d, p.pose_graph
    return dataclasses.replace(
        p,
        trajectory_builder_3d=dataclasses.replace(
            builder, submaps=dataclasses.replace(builder.submaps, num_range_data=25, high_resolution=0.2)
        ),
        pose_graph=dataclasses.replace(
            graph,
            constraint_builder=dataclasses.replace(graph.constraint_builder, max_constraint_distance=4.0),
        ),
        slamcli_3d=dataclasses.replace(p.slamcli_3d, cloud_voxel_size=0.2, projection_resolution=0.1, **ext),
    )


def recording(turns=1.1, seed=3, start=0.0, with_imu=True, bad=()):
    """Measurements in time order and the true poses at the clouds' stamps."""
    rng = np.random.default_rng(seed)
    a = start + np.linspace(0, 2 * np.pi * turns, 150)
    drive = Drive(np.column_stack([5 * np.cos(a), 3.5 * np.sin(a)]), speed=2.5, rest=0.8, ramp=1.5)
    times = np.arange(0.0, drive.duration - 1.5, 0.1)
    clouds = [LIDAR.sweep(hall(1), drive, t, rng) for t in times]
    for n in bad:
        clouds[n] = dataclasses.replace(clouds[n], points_m=clouds[n].points_m[:0], offset_ns=None, intensities=None)
    samples = imu_samples(drive, 0.0, drive.duration - 0.1, rng) if with_imu else []
    stream = list(heapq.merge(clouds, samples, key=lambda m: m.stamp_ns))
    return stream, drive.poses(times)


def run(stream, parameters=None, *, state=None, jobs=1):
    log = RunLog()
    setup = Setup(
        T_base_laser={"/points": LIDAR.T_base_lidar}, T_base_sensor={"/imu": np.eye(4)}, state=state, jobs=jobs, log=log
    )
    mapper = Mapper3D(parameters or small(), setup)
    for measurement in stream:
        mapper.process(measurement)
    return mapper.finish(), log


def errors(trajectory, true, *, aligned=True):
    T = trajectory.transforms
    if aligned:
        T = true[0] @ se3.inverse(T[0]) @ T
    return np.linalg.norm(T[:, :3, 3] - true[:, :3, 3], axis=1)


@pytest.fixture(scope="module")
def round_trip():
    stream, true = recording(bad=(20,))
    return stream, true, *run(stream)


def test_every_cloud_gets_a_pose_and_the_path_is_right(round_trip):
    stream, true, result, log = round_trip
    stamps = [m.stamp_ns for m in stream if isinstance(m, PointCloud)]
    assert result.trajectory.stamps_ns.tolist() == stamps
    assert errors(result.trajectory, true).max() < 0.06
    assert log.warnings == []
    assert result.trajectory.frame_id == "map"


def test_loops_are_closed_and_their_residuals_are_small(round_trip):
    *_, result, _ = round_trip
    accepted = [s for s in result.loop_searches if s.accepted]
    assert len(accepted) >= 3
    assert all(0.3 <= s.score <= 1.0 and s.translation_residual_m < 0.05 for s in accepted)
    assert result.summary["loop_closures"] == len(accepted)
    inter = [c for c in result.state.constraints if c.kind == "inter"]
    assert {(c.submap, c.node) for c in inter} == {(s.submap, s.node) for s in accepted}


def test_the_state_holds_all_that_mapping_goes_on_from(round_trip):
    stream, _, result, _ = round_trip
    state = result.state
    assert len(state.nodes) == result.summary["nodes"] == len(result.keyframes)
    assert [s.id for s in state.submaps] == [Id(0, n) for n in range(len(state.submaps))]
    assert [s.finished for s in state.submaps[-2:]] == [False, False]
    assert all(s.high_resolution.resolution_m == 0.2 and len(s.low_resolution.values) for s in state.submaps)
    first = next(c for c in state.constraints if c.kind == "intra")
    seen = se3.inverse(state.submaps[0].T_map_submap) @ state.nodes[0].T_map_node
    np.testing.assert_allclose(first.T_submap_node, seen, atol=5e-3)
    assert len(state.imu[0]) == pytest.approx(sum(isinstance(m, ImuSample) for m in stream), abs=5)


def test_map_and_cloud_show_the_hall(round_trip):
    _, true, result, _ = round_trip
    grid, cloud = result.grid, result.cloud
    T = true[0] @ se3.inverse(result.trajectory.transforms[0])
    # The outer walls stand at x = ±15 and y = ±10, the floor is free where the robot drove.
    walls = []
    for x in np.linspace(-5, 5, 41):
        at = (se3.inverse(T) @ [x, -10.0, 0, 1])[:2]
        walls.append(max(value(grid, at + np.array([0, d])) for d in (-0.2, -0.1, 0.0, 0.1, 0.2)))
    assert np.mean(np.array(walls) == OccupancyGrid.OCCUPIED) > 0.8
    driven = [value(grid, p[:2]) for p in result.trajectory.positions_m]
    assert set(driven) == {OccupancyGrid.FREE}
    assert len(cloud.intensities) == len(cloud.points_m) > 3000
    moved = cloud.points_m @ T[:3, :3].T + T[:3, 3]
    inside = (np.abs(moved[:, 0]) < 15.2) & (np.abs(moved[:, 1]) < 10.2) & (moved[:, 2] > -0.2) & (moved[:, 2] < 6.2)
    assert inside.mean() > 0.995


def value(grid, point):
    row, column = grid.map_to_cell(np.asarray(point)[None])[0]
    return int(grid.cells[row, column])


def test_the_result_does_not_depend_on_jobs(round_trip):
    stream, _, first, _ = round_trip
    second, _ = run(stream, jobs=2)
    assert first.trajectory.positions_m.tobytes() == second.trajectory.positions_m.tobytes()
    assert first.cloud.points_m.tobytes() == second.cloud.points_m.tobytes()
    assert first.grid.cells.tobytes() == second.grid.cells.tobytes()
    assert [dataclasses.astuple(s) for s in first.loop_searches] == [
        dataclasses.astuple(s) for s in second.loop_searches
    ]


def test_mapping_goes_on_in_a_loaded_map(round_trip):
    _, first_true, first, _ = round_trip
    stream, true = recording(turns=0.45, seed=8, start=2.5)
    state = dataclasses.replace(first.state, frozen=frozenset({0}))
    result, log = run(stream, state=state)
    assert log.warnings == []
    # In the frame of the first map: not aligned with its own truth, but with that of the first run.
    T = first_true[0] @ se3.inverse(first.trajectory.transforms[0])
    placed = T @ result.trajectory.transforms
    assert np.linalg.norm(placed[:, :3, 3] - true[:, :3, 3], axis=1).max() < 0.1
    assert result.state.trajectories == (0, 1)
    for before, after in zip(first.state.nodes, result.state.nodes, strict=False):
        np.testing.assert_array_equal(before.T_map_node, after.T_map_node)
    assert any(c.submap.trajectory != c.node.trajectory for c in result.state.constraints)


def test_an_unconnected_trajectory_is_kept_beside_the_map_and_said(round_trip):
    *_, first, _ = round_trip
    rng = np.random.default_rng(0)
    drive = Drive(np.array([[0.0, 0.0], [6.0, 0.0]]), speed=2.5, rest=0.6, ramp=1.5)
    elsewhere = hall(7, size=(50.0, 50.0, 12.0), boxes=3)
    stream = [LIDAR.sweep(elsewhere, drive, t, rng) for t in np.arange(0, 2.0, 0.1)]
    result, log = run(stream, state=first.state)
    assert any("was not found in the loaded map" in warning for warning in log.warnings)
    assert result.state.trajectories == (0, 1)


def test_gps_places_the_run_in_its_frame(round_trip):
    stream, true, *_ = round_trip
    true = true[:60]
    stream = [m for m in stream if m.stamp_ns < 1_700_000_006 * SECOND]
    fixes = [
        StampedPose(stamp_ns=1_700_000_000 * SECOND + round(0.1 * SECOND * k), frame_id="utm", position_m=T[:3, 3] + [100.0, 50.0, 3.0],
                    quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]), topic="/fix")
        for k, T in enumerate(true)
    ]  # fmt: skip
    result, _ = run(list(heapq.merge(stream, fixes, key=lambda m: m.stamp_ns)))
    assert errors(result.trajectory, true).max() < 0.08
    assert len(result.state.fixed_frame_poses[0]) == len(true)


# Bad input


def test_nothing_within_range_is_an_error():
    clouds = [
        PointCloud(stamp_ns=k * SECOND, frame_id="l", points_m=np.zeros((0, 3), dtype=np.float32), topic="/points")
        for k in range(3)
    ]
    with pytest.raises(EstimationError, match="none of the 3 point clouds"):
        run(clouds)


def test_a_state_of_2d_mapping_is_refused():
    node = Node(
        id=Id(0, 0), stamp_ns=0, T_local_node=np.eye(4), T_map_node=np.eye(4), gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]),
        points_m=np.zeros((1, 3), dtype=np.float32),
    )  # fmt: skip
    with pytest.raises(DataError, match="of 2D mapping"):
        Graph3D(MapState(nodes=(node,), submaps=(), constraints=()))


# Parts


def test_clouds_of_several_sensors_make_one_sweep():
    def cloud(topic, t):
        return PointCloud(stamp_ns=t, frame_id="l", points_m=np.zeros((1, 3), dtype=np.float32), topic=topic)

    grouping = CloudGrouping(2, 1)
    groups = []
    for topic, t in (("a", 0), ("b", 3), ("a", 10), ("a", 20), ("b", 23), ("a", 30)):
        groups += grouping.due(t)
        grouping.add(cloud(topic, t))
    groups += grouping.rest()
    assert [[(c.topic, c.stamp_ns) for c in group] for group in groups] == [
        [("a", 0), ("b", 3)], [("a", 10)], [("a", 20), ("b", 23)], [("a", 30)],
    ]  # fmt: skip


def test_a_sweep_waits_until_its_last_point_has_passed():
    cloud = PointCloud(
        stamp_ns=0, frame_id="l", points_m=np.zeros((2, 3), dtype=np.float32), offset_ns=np.array([0, 90]), topic="a"
    )
    grouping = CloudGrouping(1, 1)
    grouping.add(cloud)
    assert grouping.due(89) == []
    assert len(grouping.due(90)) == 1


def test_the_band_of_the_2d_map_is_above_the_ground():
    projection = Projection(dataclasses.replace(CartographerParameters().slamcli_3d, projection_resolution=0.1))
    a = np.linspace(-np.pi, np.pi, 721)[:-1]
    floor = np.concatenate(
        [np.column_stack([r * np.cos(a), r * np.sin(a), np.full(len(a), -1.5)]) for r in (2, 3, 4, 5)]
    )
    post = np.array([[4.0, 0.0, z] for z in np.arange(-1.4, 0.4, 0.1)])
    ceiling = np.array([[3.0, y, 2.0] for y in np.arange(-1, 1, 0.05)])
    for _ in range(3):
        projection.add(
            Id(0, 0), np.eye(4), np.array([0.0, 0, 0, 1]), np.concatenate([floor, post, ceiling]), np.zeros(3)
        )
    grid = projection.finish({Id(0, 0): np.eye(4)}, "map")
    assert value(grid, [4.05, 0.05]) == OccupancyGrid.OCCUPIED
    assert value(grid, [2.0, 0.0]) == OccupancyGrid.FREE, "the floor is no obstacle"
    assert value(grid, [3.0, 0.5]) == OccupancyGrid.FREE, "nor is the ceiling"
    assert value(grid, [4.6, 0.0]) == OccupancyGrid.UNKNOWN, "nothing is known behind the post"


def test_looking_around_equals_a_naive_twin():
    rng = np.random.default_rng(5)
    points, origin, bins, reach = rng.uniform(-6, 6, (400, 3)), np.array([0.3, -0.2, 0.4]), 36, 5.0
    for low, high in ((-1.0, 1.0), (-3.0, -1.0)):
        nearest, clear, inside = np.full(bins, np.inf), np.zeros(bins), np.zeros(len(points), dtype=bool)
        _projection_kernels.look_around(points, origin, low, high, reach, nearest, clear, inside)
        naive_nearest, naive_clear = np.full(bins, np.inf), np.zeros(bins)
        for p in points:
            d = p - origin
            distance, where = np.hypot(d[0], d[1]), int((np.arctan2(d[1], d[0]) / (2 * np.pi) + 0.5) * bins) % bins
            if low <= p[2] <= high and distance <= reach:
                naive_nearest[where] = min(naive_nearest[where], distance)
            steps = np.linspace(0, 1, 20001)
            within = (origin[2] + steps * d[2] >= low) & (origin[2] + steps * d[2] <= high)
            if within.any():
                naive_clear[where] = max(naive_clear[where], min(steps[within].max() * distance, reach))
        np.testing.assert_allclose(nearest, naive_nearest)
        np.testing.assert_allclose(clear, naive_clear, atol=2e-3)
        flat = np.hypot(*(points - origin)[:, :2].T)
        assert inside.tolist() == ((points[:, 2] >= low) & (points[:, 2] <= high) & (flat <= reach)).tolist()


def test_the_cloud_keeps_one_point_per_voxel_and_moves_with_its_submap():
    cloud = MapCloud(0.5)
    points = np.random.default_rng(0).uniform(0, 2, (500, 3))
    for k in range(20):
        cloud.add(
            Id(0, 0),
            se3.from_position_quaternion([0.5 * k, 0, 0], quaternion.from_yaw(0.0)),
            points - [0.5 * k, 0, 0],
            np.arange(500, dtype=np.float32),
        )
    T = se3.from_position_quaternion([10.0, 0, 0], quaternion.from_yaw(0.0))
    made = cloud.finish({Id(0, 0): T}, 5, "map")
    assert len(made.points_m) <= 125
    assert made.points_m[:, 0].min() >= 9.9
    assert (made.stamp_ns, made.frame_id) == (5, "map")


def test_trajectories_that_constraints_tie_together_are_known():
    def submap(t):
        return Submap(id=Id(t, 0), T_local_submap=np.eye(4), T_map_submap=np.eye(4), num_range_data=1, finished=True)

    graph = Graph3D(None)
    tie = Constraint(
        submap=Id(0, 0),
        node=Id(2, 0),
        T_submap_node=np.eye(4),
        translation_weight=1.0,
        rotation_weight=1.0,
        kind="inter",
    )
    graph.add([], [submap(t) for t in range(3)], [tie])
    assert graph.connected([0, 1, 2]) == {0: 0, 1: 1, 2: 0}
