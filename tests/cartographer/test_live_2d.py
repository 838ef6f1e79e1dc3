# SPDX-License-Identifier: MIT
"""Cartographer as it goes around a corridor: the pose after each scan, the map so far, loops, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from box_room import BOXES
from box_room import drive as drive_in_the_room
from ring_world import drive, errors, gyroscope, odometry, parameters, recorded, scan, stamps_of, wheels

from slamcli.cartographer import TIER
from slamcli.cartographer.parameters import PoseGraph
from slamcli.cartographer.parameters.map_builder import MapBuilder
from slamcli.cartographer.parameters.pose_graph import BatchSearch
from slamcli.cartographer.parameters.trajectory_builder_2d import ScanOdometry2d
from slamcli.errors import DataError, EstimationError, UsageError
from slamcli.geometry import se2
from slamcli.grids.submap_drawing import draw_submaps
from slamcli.mapper import Setup
from slamcli.measurements import LaserScan
from slamcli.posegraph import MapState

POSES = drive()
TOLD = wheels(POSES, seed=3)
OFTEN = PoseGraph(optimize_every_n_nodes=40)


def live(p=None, **setup):
    return TIER.build_live(p or parameters(OFTEN), Setup(T_base_laser={"/scan": np.eye(4)}, **setup))


def replay(mapper, measurements, told=TOLD):
    """Poses (N, 3) of the base as they were told after each scan."""
    found = []
    for measurement in measurements:
        mapper.process(measurement)
        if isinstance(measurement, LaserScan):
            found.append(se2.compose(mapper.T_map_odom, told[len(found)]))
    return np.array(found)


def off(poses, true=POSES):
    apart = se2.between(poses[0], poses) - se2.between(true[0], true[: len(poses)])
    return np.hypot(apart[:, 0], apart[:, 1])


@pytest.fixture(scope="module")
def run():
    mapper = live()
    told = replay(mapper, recorded(POSES, told=TOLD))
    return told, mapper.grid(), mapper.finish()


def test_pose_after_each_scan_and_result_are_right(run):
    told, grid, result = run
    assert off(told).max() < 0.12 < off(TOLD).max()
    away, turn = errors(result, POSES)
    assert away.max() < 0.06
    assert turn.max() < 0.02
    assert result.summary["constraints_inter"] > 0
    assert len(result.trajectory.stamps_ns) == len(POSES)
    assert 0.9 < (grid.cells == 100).sum() / (result.grid.cells == 100).sum() < 1.1


def test_same_bytes_again_with_more_jobs_and_nothing_later_counts(run):
    told, _, _ = run
    again = live(jobs=2)
    half = replay(again, recorded(POSES, told=TOLD)[:240])
    assert half.tobytes() == told[:120].tobytes()


def test_the_map_is_that_of_all_submaps_where_they_are():
    mapper = live()
    for k, measurement in enumerate(recorded(POSES, told=TOLD)):
        mapper.process(measurement)
        if k % 97 == 50 and k > 1:
            grid = mapper.grid()
            submaps = mapper._local.submaps.all
            whole = draw_submaps([s.grid for s in submaps], mapper._closing.submaps(mapper._local), 0.05)
            row, column = grid.map_to_cell([np.add(whole.origin[:2], 0.025)])[0]
            inside = grid.cells[row : row + whole.height, column : column + whole.width]
            assert (inside != whole.cells).mean() < 0.003  # submaps that moved by less than 0.2 cells stay
            assert (grid.cells >= 0).sum() == pytest.approx((whole.cells >= 0).sum(), rel=0.003)
            assert mapper.grid() is grid


def test_the_originals_search_closes_loops_too():
    online = PoseGraph(batch_search=BatchSearch(enabled=False), optimize_every_n_nodes=40)
    mapper = live(parameters(online))
    assert off(replay(mapper, recorded(POSES, told=TOLD))).max() < 0.15
    result = mapper.finish()
    assert errors(result, POSES)[0].max() < 0.08
    assert result.summary["constraints_inter"] > 0


def test_several_scans_match_as_one():
    mapper = live(parameters(OFTEN, num_accumulated_range_data=3))
    assert off(replay(mapper, recorded(POSES[:100], told=TOLD))).max() < 0.12
    assert len(mapper.finish().trajectory.stamps_ns) == 100


@pytest.mark.parametrize("aligned", [True, False], ids=["scan odometry", "extrapolated"])
def test_without_odometry(aligned):
    stamps, poses = drive_in_the_room(150)
    scans = [scan(pose, stamp, beams=360, boxes=BOXES) for stamp, pose in zip(stamps, poses, strict=True)]
    search = ScanOdometry2d(enabled=aligned)
    mapper = live(parameters(OFTEN, use_online_correlative_scan_matching=True, scan_odometry=search))
    found = replay(mapper, scans, np.zeros((150, 3)))
    assert off(found, poses).max() < 0.15


def test_odometry_as_a_term_of_its_own():
    problem = replace(PoseGraph().optimization_problem, odometry_term="always")
    mapper = live(parameters(replace(OFTEN, optimization_problem=problem)))
    assert off(replay(mapper, recorded(POSES, told=TOLD))).max() < 0.3
    assert math.isfinite(mapper.finish().summary["optimisation_cost_after"])


def test_other_sensors_are_left_out_aloud():
    mapper = live()
    stamps = stamps_of(3)
    for measurement in recorded(POSES[:3], told=TOLD, imu=gyroscope(stamps, POSES[:3])):
        mapper.process(measurement)
    assert any("IMU" in note for note in mapper._setup.log.notes)


def test_what_cannot_be():
    with pytest.raises(EstimationError, match="no map yet"):
        live().grid()
    with pytest.raises(DataError, match="no scan was read"):
        live().finish()
    with pytest.raises(UsageError, match="in the plane only"):
        live(
            replace(
                parameters(), map_builder=MapBuilder(use_trajectory_builder_2d=False, use_trajectory_builder_3d=True)
            )
        )
    with pytest.raises(UsageError, match="begins a new map"):
        live(state=MapState(submaps=(), nodes=(), constraints=()))
    blind = live()
    replay(blind, recorded(POSES[:3], told=TOLD, blind=(0, 1, 2)))
    with pytest.raises(EstimationError, match="within range"):
        blind.finish()
    with pytest.raises(UsageError, match="mount of the sensor"):
        TIER.build_live(parameters(), Setup(T_base_laser={})).process(recorded(POSES[:1])[0])


def test_odometry_after_the_scan_is_no_use_to_it():
    early, late = live(), live()
    measurements = recorded(POSES[:10], told=TOLD)
    replay(early, measurements)
    replay(late, [*measurements, odometry(int(stamps_of(11)[10]), TOLD[10])])
    assert early.T_map_odom.tobytes() == late.T_map_odom.tobytes()
