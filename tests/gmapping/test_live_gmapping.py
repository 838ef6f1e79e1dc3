# SPDX-License-Identifier: MIT
"""gmapping as it goes in an exact room: the pose after each scan, the map so far, and what depends on nothing later."""

from __future__ import annotations

import math

import numpy as np
import pytest
from room_world import beams_at, drifting, drive, odometry, scan_at

from slamcli.errors import DataError, EstimationError, UsageError
from slamcli.geometry import se2
from slamcli.gmapping import TIER, GmappingParameters
from slamcli.gmapping.live_map import LiveMap
from slamcli.grids.tiles import TiledMaps
from slamcli.mapper import Setup, find_live_tier
from slamcli.trajectory.bending import between_updates

SMALL = {"xmin": -6.0, "xmax": 6.0, "ymin": -6.0, "ymax": 6.0, "particles": 6}
STAMPS, POSES = drive(120)
SCANS = [scan_at(pose, int(stamp)) for stamp, pose in zip(STAMPS, POSES, strict=True)]
WHEELS = drifting(POSES)


def live(**parameters):
    return TIER.build_live(GmappingParameters(**SMALL | parameters), Setup(T_base_laser={"/scan": np.eye(4)}))


def replay(mapper, count=120, wheels=True):
    """Poses (count, 3) of the base as they were told after each scan."""
    told = []
    for k in range(count):
        if wheels:
            mapper.process(odometry(int(STAMPS[k]), WHEELS[k]))
        mapper.process(SCANS[k])
        told.append(se2.compose(mapper.T_map_odom, WHEELS[k] if wheels else np.zeros(3)))
    return np.array(told)


def rms(poses):
    apart = se2.between(poses[0], poses) - se2.between(POSES[0], POSES[: len(poses)])
    return math.sqrt(float((apart[:, :2] ** 2).sum(axis=1).mean()))


@pytest.fixture(scope="module")
def run():
    mapper = live(linearUpdate=0.5, angularUpdate=0.3)
    told = replay(mapper)
    return told, mapper.grid(), mapper.finish()


def test_pose_after_each_scan_and_result_are_right(run):
    told, grid, result = run
    assert rms(told) < 0.02
    assert rms(result.trajectory.poses_se2) < 0.02
    assert result.trajectory.stamps_ns.tolist() == STAMPS.tolist()
    assert len(result.steps["neff"]) == result.summary["processed_scans"]
    cell = grid.map_to_cell(se2.transform_points(told[0], se2.transform_points(se2.inverse(POSES[0]), [[4.1, 0.0]])))[0]
    assert (grid.cells[cell[0] - 2 : cell[0] + 3, cell[1] - 2 : cell[1] + 3] == 100).any()
    same = (grid.cells == 100).sum() / (result.grid.cells == 100).sum()
    assert 0.9 < same < 1.1


def test_same_seed_gives_the_same_and_nothing_later_counts(run):
    told, _, _ = run
    again = live(linearUpdate=0.5, angularUpdate=0.3)
    half = replay(again, 60)
    assert half.tobytes() == told[:60].tobytes()


def test_drifting_wheels_without_alignment_are_corrected_at_updates():
    told = replay(live(scan_odometry=False, linearUpdate=0.2, angularUpdate=0.1))
    assert rms(told) < 0.05 < rms(WHEELS)


def test_without_odometry_the_scans_lead():
    mapper = live()
    assert rms(replay(mapper, 60, wheels=False)) < 0.02
    with pytest.raises(UsageError, match="scan_odometry is false"):
        replay(live(scan_odometry=False), 1, wheels=False)


def test_map_is_as_old_as_its_interval_allows():
    mapper = live(map_update_interval=1.0)
    replay(mapper, 1)
    first = mapper.grid()
    for k in range(1, 10):
        mapper.process(SCANS[k])
        assert mapper.grid() is first
    mapper.process(SCANS[10])
    assert mapper.grid() is not first


def test_nothing_seen_has_no_map():
    with pytest.raises(EstimationError, match="no map yet"):
        live().grid()
    with pytest.raises(DataError, match="no laser scan"):
        live().finish()
    with pytest.raises(UsageError, match="mount of the laser"):
        TIER.build_live(GmappingParameters(), Setup(T_base_laser={})).process(SCANS[0])


def test_tiers_that_cannot_say_so():
    assert find_live_tier("gmapping") is TIER
    with pytest.raises(UsageError, match="orbslam3: this tier does not map as it goes"):
        find_live_tier("orbslam3")


def motions_of(poses):
    return np.vstack([np.zeros((1, 3)), se2.between(poses[:-1], poses[1:])])


def naive_map(parameters, indices, path, motions):
    poses = between_updates(motions, indices, path)
    maps = TiledMaps(1, parameters.delta, (-20.0, -20.0, 20.0, 20.0))
    for k in range(len(poses)):
        beams = beams_at(POSES[k])
        maps.add_scan(poses[k].reshape(1, 3), beams.start, beams.ends, beams.hit)
    return maps.occupancy(0, parameters.occ_thresh, "map")


def test_live_map_is_that_of_its_naive_twin_and_follows_another_past():
    parameters = GmappingParameters(map_scans="all")
    drawn = LiveMap(parameters, lambda k: beams_at(POSES[k]))
    motions = motions_of(POSES)
    for count, shift in ((1, 0.0), (25, 0.0), (50, 0.0), (50, 0.4), (70, 0.4)):
        indices = np.arange(0, count, 10)
        path = POSES[indices].copy()
        path[2:, 0] += shift  # another particle with another past
        found = drawn.draw(indices, path, motions[:count], "map")
        twin = naive_map(parameters, indices, path, motions[:count])
        assert found.origin == pytest.approx(twin.origin)
        assert np.array_equal(found.cells, twin.cells)
