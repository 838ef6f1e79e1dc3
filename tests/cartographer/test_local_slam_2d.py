# SPDX-License-Identifier: MIT
"""Local SLAM in an exact room: it corrects predictions, filters motion and goes on where there is nothing to match."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_room import drive, motions, seen

from slamcli.cartographer.local_slam_2d import LocalSlam2d
from slamcli.cartographer.parameters import CeresScanMatcher2d, MotionFilter, Submaps2d, TrajectoryBuilder2d
from slamcli.cartographer.parameters.trajectory_builder_2d import GridOptions2d, RangeDataInserter2d, ScanOdometry2d
from slamcli.cartographer.range_data import RangeData
from slamcli.geometry import se2
from slamcli.grids.tsdf_grid import TsdfGrid

PARAMETERS = TrajectoryBuilder2d(
    scan_odometry=ScanOdometry2d(enabled=False),
    submaps=Submaps2d(num_range_data=15),
    ceres_scan_matcher=CeresScanMatcher2d(occupied_space_weight=10.0),
)


TSDF = TrajectoryBuilder2d(
    scan_odometry=ScanOdometry2d(enabled=False),
    submaps=Submaps2d(
        num_range_data=15,
        grid_options_2d=GridOptions2d(grid_type="TSDF"),
        range_data_inserter=RangeDataInserter2d(range_data_inserter_type="TSDF_INSERTER_2D"),
    ),
    ceres_scan_matcher=CeresScanMatcher2d(occupied_space_weight=200.0),  # metres instead of probabilities
)


def run(parameters, stamps, poses, predicted, noise=None):
    slam, found = LocalSlam2d(parameters, poses[0].copy()), []
    for k, (stamp, pose) in enumerate(zip(stamps.tolist(), poses, strict=True)):
        slam.step(k, stamp, seen(pose, noise=noise), predicted[k])
        found.append(slam.pose)
    return slam, np.array(found)


def errors(found, poses):
    return np.hypot(*(found - poses)[:, :2].T), np.abs(se2.wrap_angle((found - poses)[:, 2]))


def test_predictions_that_drift_are_put_right():
    stamps, poses = drive(90)
    predicted = motions(poses, scale=1.1, turn=1.05, bias=0.002)
    slam, found = run(PARAMETERS, stamps, poses, predicted, np.random.default_rng(1))
    distance, turn = errors(found, poses)
    dead_reckoned = poses[0]
    for motion in predicted:
        dead_reckoned = se2.compose(dead_reckoned, motion)
    assert np.hypot(*(dead_reckoned - poses[-1])[:2]) > 0.5
    assert distance.max() < 0.05
    assert turn.max() < 0.02
    assert len(slam.steps) == 90
    scores = np.array([step.score for step in slam.steps])
    assert scores[0] == 0.0  # nothing to match with yet
    assert scores[5:].min() > 0.5
    assert 0.002 < np.mean([step.shift_m for step in slam.steps[1:]]) < 0.03
    assert len(slam.submaps.all) == (len(slam.nodes) - 1) // 15 + 1


def test_signed_distances_put_right_too():
    stamps, poses = drive(90)
    slam, found = run(TSDF, stamps, poses, motions(poses, scale=1.1, turn=1.05, bias=0.002), np.random.default_rng(1))
    distance, turn = errors(found, poses)
    assert isinstance(slam.submaps.all[0].grid, TsdfGrid)
    assert distance.max() < 0.12  # the corner and the pillar, seen from both sides, bend the surfaces
    assert turn.max() < 0.05
    assert np.array([step.score for step in slam.steps])[5:].min() > 0.7


def test_predictions_of_scan_odometry_are_trusted_more():
    stamps, poses = drive(40)
    predicted = motions(poses, scale=1.1)
    trusting = replace(PARAMETERS, scan_odometry=ScanOdometry2d(trust=1000.0))
    dead_reckoned = [poses[0]]
    for motion in predicted[1:]:
        dead_reckoned.append(se2.compose(dead_reckoned[-1], motion))
    distance, _ = errors(run(trusting, stamps, poses, predicted)[1], np.array(dead_reckoned))
    assert distance.max() < 0.01


def test_new_submaps_after_a_restart():
    stamps, poses = drive(20)
    slam = LocalSlam2d(PARAMETERS, poses[0].copy())
    for k in range(20):
        if k == 10:
            slam.restart()
            assert slam.submaps.matching is None
        slam.step(k, int(stamps[k]), seen(poses[k]), motions(poses)[k])
    slam.finish()
    assert all(submap.finished for submap in slam.submaps.all)
    assert [node.submaps for node in slam.nodes if node.scan in (9, 10)] == [(0,), (1,)]
    assert slam.steps[10].score == 0.0


def test_the_window_search_takes_larger_errors():
    stamps, poses = drive(60)
    predicted = motions(poses)
    predicted[30] += [0.08, -0.06, 0.25]  # a slip
    wide = replace(PARAMETERS, use_online_correlative_scan_matching=True)
    slipped = errors(run(PARAMETERS, stamps, poses, predicted)[1], poses)
    distance, turn = errors(run(wide, stamps, poses, predicted)[1], poses)
    assert distance[31:].max() < 0.06
    assert turn[31:].max() < 0.03
    assert turn[30] < slipped[1][30]


def test_the_motion_filter():
    filtered = replace(
        PARAMETERS, motion_filter=MotionFilter(max_time_seconds=2.0, max_distance_meters=0.3, max_angle_radians=0.2)
    )
    stamps, still = np.arange(50) * 100_000_000, np.tile([0.5, -0.5, 0.3], (50, 1))
    slam, _ = run(filtered, stamps, still, motions(still))
    assert [node.scan for node in slam.nodes] == [0, 21, 42]  # only time passes
    stamps, poses = drive(90)
    slam, _ = run(filtered, stamps, poses, motions(poses))
    for a, b in zip(slam.nodes[:-1], slam.nodes[1:], strict=True):
        first, second = poses[a.scan], poses[b.scan]
        before = poses[b.scan - 1]
        moved = np.hypot(*(second - first)[:2]) > 0.28 or abs(se2.wrap_angle(second[2] - first[2])) > 0.18
        assert moved
        assert b.scan - a.scan == 1 or np.hypot(*(before - first)[:2]) < 0.32
    assert slam.nodes[0].submaps == (0,)
    assert all(len(node.points) <= 180 for node in slam.nodes)


def test_scans_without_points_follow_the_prediction():
    stamps, poses = drive(20)
    slam, predicted = LocalSlam2d(PARAMETERS, poses[0].copy()), motions(poses)
    nothing = RangeData(np.zeros(2), np.empty((0, 2)), np.empty((0, 2)))
    for k in range(20):
        slam.step(k, int(stamps[k]), nothing if 5 <= k < 15 else seen(poses[k]), predicted[k])
    distance, _ = errors(slam.pose[None], poses[-1:])
    assert distance < 0.03
    assert all(step.score == 0.0 for step in slam.steps[5:15])
    assert not {node.scan for node in slam.nodes} & set(range(5, 15))


@pytest.mark.parametrize("count", [1, 9])
def test_a_handful_of_points_is_not_matched(count):
    stamps, poses = drive(10)
    slam = LocalSlam2d(PARAMETERS, poses[0].copy())
    for k in range(5):
        slam.step(k, int(stamps[k]), seen(poses[k]), motions(poses)[k])
    before = slam.pose
    few = RangeData(np.zeros(2), seen(poses[5]).returns[:count], np.empty((0, 2)))
    slam.step(5, int(stamps[5]), few, np.array([0.05, 0.0, 0.1]))
    np.testing.assert_allclose(slam.pose, se2.compose(before, [0.05, 0.0, 0.1]), atol=1e-9)


def test_the_same_input_gives_the_same_poses():
    stamps, poses = drive(30)
    one, two = (run(PARAMETERS, stamps, poses, motions(poses, scale=1.1))[1] for _ in range(2))
    np.testing.assert_array_equal(one, two)
