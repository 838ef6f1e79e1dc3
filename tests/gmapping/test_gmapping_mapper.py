# SPDX-License-Identifier: MIT
"""The whole tier in an exact room: error, determinism, equivariance, clocks, fallbacks and poses between updates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from room_world import SECOND, drifting, drive, from_first, odometry, scan_at

from slamcli.errors import DataError, InputError, UsageError
from slamcli.geometry import se2
from slamcli.gmapping import TIER, GmappingParameters
from slamcli.mapper import Setup, find_tier
from slamcli.runtime import RunLog
from slamcli.trajectory.bending import between_updates

SMALL = {"xmin": -6.0, "xmax": 6.0, "ymin": -6.0, "ymax": 6.0, "particles": 6}


class World:
    """A recorded drive: stamps, true poses, scans and drifting wheels."""

    def __init__(self, count=120, turns=1.0):
        self.stamps, self.poses = drive(count, turns)
        self.scans = [scan_at(pose, int(stamp)) for stamp, pose in zip(self.stamps, self.poses, strict=True)]
        self.wheels = drifting(self.poses)

    def map(self, wheels=True, start=None, log=None, jobs=1, seed=0, stamps=None, wheel_stamps=None, **parameters):
        setup = Setup(T_base_laser={"/scan": np.eye(4)}, log=log or RunLog(), jobs=jobs, seed=seed)
        mapper = TIER.build(GmappingParameters(**SMALL | parameters), setup)
        told = self.wheels if start is None else se2.compose(start, self.wheels)
        for k, scan in enumerate(self.scans):
            if wheels:
                mapper.process(odometry((self.stamps if wheel_stamps is None else wheel_stamps)[k], told[k]))
            mapper.process(scan if stamps is None else scan_at(self.poses[k], int(stamps[k])))
        return mapper.finish()


@pytest.fixture(scope="module")
def world():
    return World()


def errors(result, poses):
    difference = from_first(result.trajectory.poses_se2) - from_first(poses)
    return np.hypot(difference[:, 0], difference[:, 1]), np.abs(se2.wrap_angle(difference[:, 2]))


def rms(values):
    return math.sqrt(float((values**2).mean()))


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"match": "hillclimb"},
        {"proposal": "improved"},
        {"free_check": True},
        {"adaptive_particles": "kld", "min_particles": 2},
        {"scan_odometry": False, "linearUpdate": 0.3, "particles": 20},
    ],
    ids=lambda p: ",".join(p) or "default",
)
def test_an_exact_world_is_mapped_within_two_centimetres(world, parameters):
    result = world.map(**parameters)
    translation, rotation = errors(result, world.poses)
    assert rms(translation) < (0.02 if not parameters else 0.05)
    assert rms(rotation) < math.radians(1.0)
    assert translation.max() < 0.12
    odometry_error = np.hypot(*(from_first(world.wheels) - from_first(world.poses))[:, :2].T)
    assert odometry_error.max() > 0.3  # the wheels alone do not do it


def test_without_wheels(world):
    log = RunLog()
    translation, rotation = errors(world.map(wheels=False, log=log), world.poses)
    assert rms(translation) < 0.02
    assert rms(rotation) < math.radians(1.0)
    assert "no odometry" in log.warnings[0]


def test_the_map_is_the_room(world):
    result = world.map()
    grid, first = result.grid, se2.inverse(world.poses[0])
    centres = grid.cell_to_map(np.argwhere(grid.cells == 100))
    in_room = se2.transform_points(world.poses[0], centres)
    from room_world import SEGMENTS

    a, d = SEGMENTS[:, 0], SEGMENTS[:, 1] - SEGMENTS[:, 0]
    share = np.clip(((in_room[:, None] - a) * d).sum(-1) / (d**2).sum(-1), 0, 1)
    distance = np.linalg.norm(in_room[:, None] - (a + share[..., None] * d), axis=-1).min(axis=1)
    assert (distance < 0.08).mean() > 0.98
    assert len(centres) > 150
    inside = grid.map_to_cell(se2.transform_points(first, [[-2.5, 0.0], [3.0, -1.0], [0.0, 3.0], [-1.3, 1.1]]))
    assert grid.cells[tuple(inside.T)].tolist() == [0, 0, 0, -1]  # nobody has seen the inside of the pillar


def test_same_seed_same_result_whatever_the_jobs(world):
    settings = {"particles": 5, "srr": 0.4, "stt": 0.4, "resampleThreshold": 1.0, "scan_odometry_noise": 1.0}
    one, two, other = (world.map(jobs=jobs, seed=seed, **settings) for jobs, seed in ((1, 4), (2, 4), (1, 5)))
    assert one.summary["resamplings"] > 0
    np.testing.assert_array_equal(one.trajectory.poses_se2, two.trajectory.poses_se2)
    np.testing.assert_array_equal(one.grid.cells, two.grid.cells)
    assert one.grid.origin == two.grid.origin
    assert one.summary == two.summary
    for name, column in one.steps.items():
        np.testing.assert_array_equal(column, two.steps[name])
    assert np.abs(one.trajectory.poses_se2 - other.trajectory.poses_se2).max() > 0


@pytest.mark.parametrize("start", [(16.0, -3.2, 0.0), (-8.0, 4.8, math.pi / 2), (0.4, 0.1, 0.7)])
def test_moving_the_start_moves_map_and_trajectory(world, start):
    plain, moved = world.map(), world.map(start=np.array(start))
    np.testing.assert_allclose(moved.trajectory.poses_se2[0], start, atol=1e-9)
    back = se2.compose(se2.inverse(start), moved.trajectory.poses_se2)
    assert rms(np.hypot(*(back - plain.trajectory.poses_se2)[:, :2].T)) < 0.02
    assert np.abs(errors(moved, world.poses)[0]).max() < 0.08
    walls = [se2.transform_points(s, r.grid.cell_to_map(np.argwhere(r.grid.cells == 100)))
             for s, r in (((0.0, 0.0, 0.0), plain), (se2.inverse(start), moved))]  # fmt: skip
    distance = np.linalg.norm(walls[0][:, None] - walls[1][None], axis=-1).min(axis=1)
    assert (distance < 0.1).mean() > 0.97


def test_a_pose_for_every_scan_with_its_own_stamp(world):
    stamps = world.stamps.copy()
    stamps[40] = stamps[38] - 5  # one reading of a bad clock is kept as it was
    result = world.map(stamps=stamps)
    np.testing.assert_array_equal(result.trajectory.stamps_ns, stamps)
    assert result.summary["scans"] == len(stamps)
    assert errors(result, world.poses)[0].max() < 0.08
    assert {len(column) for column in result.steps.values()} == {result.summary["processed_scans"]}


def test_clocks_that_jitter_are_read_in_recorded_order(world):
    jitter = np.random.default_rng(3).normal(0, 0.15, (2, len(world.stamps))) * SECOND
    log = RunLog()
    result = world.map(
        stamps=world.stamps + jitter[0].astype(np.int64),
        wheel_stamps=world.stamps + jitter[1].astype(np.int64),
        log=log,
    )
    assert errors(result, world.poses)[0].max() < 0.1
    assert any("recorded order" in note for note in log.notes)


def test_a_planted_clock_offset_is_found_and_said():
    world, log = World(count=150), RunLog()
    stamps = world.stamps
    heading = np.sin(np.arange(150) * 0.13) * 1.2  # turns that come and go tell times
    world.poses[:, 2] = heading
    world.scans = [scan_at(pose, int(stamp)) for stamp, pose in zip(stamps, world.poses, strict=True)]
    world.wheels = drifting(world.poses, scale=1.0, turn=1.0, bias=0.0)
    result = world.map(wheel_stamps=stamps + SECOND // 5, log=log)
    assert result.summary["time_offset_s"] == pytest.approx(0.2, abs=0.01)
    assert any("clocks differ" in note for note in log.notes)
    given = world.map(wheel_stamps=stamps + SECOND // 5, time_offset="0.2")
    assert given.summary["time_offset_s"] == 0.2
    assert rms(errors(given, world.poses)[0]) < 0.03


def test_a_minimum_score_that_cannot_be_reached_warns_and_counts(world):
    log = RunLog()
    result = world.map(minimumScore=200, log=log, time_offset="0")
    steps = result.summary["processed_scans"] - 1
    assert result.summary["fallbacks"] == steps * SMALL["particles"]
    assert log.counts["matches that fell back on odometry"] == result.summary["fallbacks"]
    assert any("minimumScore=200 cannot be reached" in warning and "here 90" in warning for warning in log.warnings)
    log = RunLog()
    assert world.map(minimumScore=5, log=log).summary["fallbacks"] == 0
    assert not any("minimumScore" in warning for warning in log.warnings)


def test_slipping_wheels_are_told(world):
    slipped = World()
    slipped.poses[60:, 2] += 0.4  # pushed aside, and the wheels do not know
    slipped.scans = [scan_at(pose, int(stamp)) for stamp, pose in zip(slipped.stamps, slipped.poses, strict=True)]
    log = RunLog()
    result = slipped.map(log=log, time_offset="0")
    assert errors(result, slipped.poses)[0].max() < 0.1
    assert any("disagree beyond the motion model" in warning for warning in log.warnings)
    assert log.counts["scans that disagree with the odometry"] >= 1


def test_throttle_and_updates(world):
    result = world.map(throttle_scans=3)
    assert result.summary["scans"] == 40
    np.testing.assert_array_equal(result.trajectory.stamps_ns, world.stamps[::3])
    every = world.map(linearUpdate=0.0, particles=2)
    assert every.summary["processed_scans"] == 120
    timed = world.map(linearUpdate=100.0, angularUpdate=100.0, temporalUpdate=1.95)
    assert timed.summary["processed_scans"] == 6
    never = world.map(linearUpdate=100.0, angularUpdate=100.0)
    assert never.summary["processed_scans"] == 1
    assert errors(never, world.poses)[0].max() < 0.1  # the scan odometry leads on


def test_one_scan_is_enough(world):
    mapper = TIER.build(GmappingParameters(**SMALL), Setup(T_base_laser={"/scan": np.eye(4)}))
    mapper.process(world.scans[0])
    result = mapper.finish()
    assert len(result.trajectory) == 1
    assert (result.grid.cells == 100).sum() > 20


def test_nothing_to_work_with():
    mapper = TIER.build(GmappingParameters(**SMALL), Setup(T_base_laser={"/scan": np.eye(4)}))
    with pytest.raises(DataError, match="no laser scan"):
        mapper.finish()
    mapper = TIER.build(GmappingParameters(**SMALL), Setup(T_base_laser={}))
    mapper.process(scan_at((0.0, 0.0, 0.0)))
    with pytest.raises(UsageError, match="--laser-pose"):
        mapper.finish()
    mapper = TIER.build(GmappingParameters(**SMALL, scan_odometry=False), Setup(T_base_laser={"/scan": np.eye(4)}))
    mapper.process(scan_at((0.0, 0.0, 0.0)))
    with pytest.raises(UsageError, match="no odometry"):
        mapper.finish()
    with pytest.raises(UsageError, match="no SLAM system 'hectr'"):
        find_tier("hectr")


def test_an_absurd_time_offset_is_wrong_usage(world):
    with pytest.raises(InputError, match="time_offset"):
        world.map(time_offset="1e300")


def exact(count=30):
    rng = np.random.default_rng(5)
    motions = rng.normal(0, 0.1, (count, 3))
    motions[0] = 0.0
    poses = [np.array([1.0, -2.0, 3.0])]
    for motion in motions[1:]:
        poses.append(se2.compose(poses[-1], motion))
    return motions, np.array(poses)


def test_poses_between_updates_of_exact_motions_are_exact():
    motions, poses = exact()
    for indices in ([0], [0, 29], [0, 1, 2], [0, 7, 19, 25]):
        found = between_updates(motions, np.array(indices), poses[indices])
        np.testing.assert_allclose(found[:, :2], poses[:, :2], atol=1e-9)
        np.testing.assert_allclose(se2.wrap_angle(found[:, 2] - poses[:, 2]), 0.0, atol=1e-9)
        assert np.abs(found[:, 2]).max() <= math.pi


def test_poses_between_updates_pass_through_the_updates():
    motions, poses = exact()
    indices = np.array([0, 7, 19, 25])
    path = poses[indices] + np.random.default_rng(6).normal(0, 0.2, (4, 3))
    found = between_updates(motions, indices, path)
    np.testing.assert_allclose(found[indices, :2], path[:, :2], atol=1e-12)
    np.testing.assert_allclose(se2.wrap_angle(found[indices, 2] - path[:, 2]), 0.0, atol=1e-12)
    tail = se2.between(found[25:-1], found[26:])
    np.testing.assert_allclose(tail, motions[26:], atol=1e-9)  # after the last update the motions lead on
