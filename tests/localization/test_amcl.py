# SPDX-License-Identifier: MIT
"""The whole filter in a small room: tracking, starting anywhere, getting lost, other maps, odd input."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from furnished_room import furnished_room, round_trip, scan_at

from slamcli.errors import ConfigError, DataError
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.localization.amcl import Amcl
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.parameters import resolve

MOUNT = np.array([0.1, 0.0, 0.0])
FAST = {"max_particles": 1000, "odom_model_type": "diff-corrected", "slamcli.proposal_candidates": 10_000}
ORIGINAL = {"slamcli.refine": False, "slamcli.deskew": False, "slamcli.proposals": "uniform"}


def filter_of(grid: OccupancyGrid, seed: int = 0, **settings) -> Amcl:
    return Amcl(resolve(AmclParameters, {**FAST, **settings}), grid, seed=seed)


def drive(amcl: Amcl, poses, *, T_odom_map=(0.5, -2.0, 0.8), noise: float = 0.02, seed: int = 0, mount=MOUNT):
    """Give scans along true poses with noisy odometry; return errors in metres and radians at each, and the last odometry."""
    rng = np.random.default_rng(seed)
    steps = se2.between(poses[:-1], poses[1:])
    steps = steps * (1.0 + rng.normal(0.0, noise, steps.shape))
    odom = se2.integrate(se2.compose(T_odom_map, poses[0]), steps)
    apart = []
    for k, pose in enumerate(poses):
        amcl.update(odom[k], scan_at(furnished_room(), pose, 0.5 * k, mount=mount), mount)
        apart.append(se2.between(pose, amcl.pose))
    apart = np.array(apart)
    return np.hypot(apart[:, 0], apart[:, 1]), np.abs(apart[:, 2]), odom[-1]


def test_the_pose_is_followed():
    amcl, way = filter_of(furnished_room()), round_trip()
    amcl.set_pose(way[0])
    metres, turns, _ = drive(amcl, way)
    assert metres[10:].max() < 0.08
    assert turns[10:].max() < math.radians(2.0)
    np.testing.assert_allclose(se2.compose(amcl.T_map_odom, amcl._pose_odom), amcl.pose, atol=1e-12)
    assert amcl.weights.sum() == pytest.approx(1.0)
    assert amcl.particles.shape == (amcl.num_particles, 3)
    assert amcl.fit > 0.9
    assert np.linalg.eigvalsh(amcl.covariance).min() >= 0.0


@pytest.mark.parametrize("model", ["likelihood_field", "likelihood_field_prob", "beam"])
@pytest.mark.parametrize("motion", ["diff-corrected", "omni-corrected"])
def test_amcl_as_it_was_follows_too(model, motion):
    settings = {"laser_model_type": model, "odom_model_type": motion, "odom_alpha1": 0.02, "odom_alpha5": 0.02}
    amcl, way = filter_of(furnished_room(), **ORIGINAL, **settings), round_trip(40)
    amcl.set_pose(way[0], np.diag([0.02, 0.02, 0.01]))
    metres, turns, _ = drive(amcl, way)
    assert metres[15:].mean() < 0.15
    assert turns[15:].mean() < math.radians(5.0)


def test_the_same_seed_gives_the_same_and_another_does_not():
    way = round_trip(12)

    def end(seed):
        amcl = filter_of(furnished_room(), seed)
        amcl.scatter()
        drive(amcl, way)
        return amcl.particles

    first = end(1)
    np.testing.assert_array_equal(first, end(1))
    assert not np.array_equal(first, end(2)[: len(first)])


def test_a_bad_start_is_mended():
    amcl, way = filter_of(furnished_room()), round_trip()
    amcl.set_pose(se2.compose(way[0], [0.7, -0.7, math.radians(30)]))
    metres, _, _ = drive(amcl, way)
    assert metres[-20:].max() < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_the_robot_is_found_anywhere(seed):
    amcl, way = filter_of(furnished_room(), seed), round_trip(30)
    amcl.scatter()
    assert np.ptp(amcl.particles[:, 0]) > 6.0
    metres, _, _ = drive(amcl, way)
    assert metres[-10:].max() < 0.1
    assert amcl.estimate.best.weight > 0.8


def test_a_kidnapped_robot_is_found_again():
    grid, way = furnished_room(), round_trip(40)
    elsewhere = np.column_stack([np.linspace(5.0, 6.3, 40), np.full(40, 0.5), np.full(40, 0.5)])
    elsewhere[:, 1] += np.linspace(0.0, 2.5, 40)
    amcl = filter_of(grid, update_min_d=0.05)
    amcl.set_pose(way[0])
    odom = drive(amcl, way)[2]
    for k, odom_base in enumerate(se2.compose(odom, se2.between(elsewhere[0], elsewhere))):
        amcl.update(odom_base, scan_at(grid, elsewhere[k], 100 + 0.5 * k), MOUNT)
        if k == 0:
            assert np.hypot(*(amcl.pose - elsewhere[k])[:2]) > 2.0
    assert np.hypot(*(amcl.pose - elsewhere[-1])[:2]) < 0.1


def test_scans_are_used_after_enough_motion_only():
    grid, pose = furnished_room(), np.array([1.5, 2.0, 0.0])
    amcl = filter_of(grid)
    amcl.set_pose(pose)
    used = []
    for k, odom in enumerate([[0, 0, 0], [0.1, 0.1, 0.3], [0.19, -0.19, 0.5], [0.19, 0.21, 0.5], [0.19, 0.21, 1.1]]):
        used.append(amcl.update(odom, scan_at(grid, pose, k), MOUNT))
    assert used == [True, False, False, True, True]


def test_each_scanner_gets_its_turn():
    grid, pose = furnished_room(), np.array([1.5, 2.0, 0.0])
    amcl = filter_of(grid)
    amcl.set_pose(pose)
    used = []
    for k, way in enumerate([0.0, 0.0, 0.1, 0.1, 0.3, 0.3]):
        topic = "/front" if k % 2 == 0 else "/rear"
        used.append(amcl.update([way, 0.0, 0.0], scan_at(grid, se2.compose(pose, [way, 0, 0]), k, topic=topic), MOUNT))
    assert used == [True, True, False, False, True, True]


def test_particles_are_drawn_anew_at_the_interval():
    grid, way = furnished_room(), round_trip(10)
    amcl = filter_of(grid, resample_interval=3, **ORIGINAL, min_particles=1000)
    amcl.set_pose(way[0])
    odd = []
    for k in range(6):
        amcl.update([0.5 * k, 0.0, 0.0], scan_at(grid, way[0], k), MOUNT)
        odd.append(len(np.unique(amcl.weights)) > 1)
    assert odd == [True, True, False, True, True, False]


def test_selective_resampling_waits_for_need():
    grid, pose = furnished_room(), np.array([1.5, 2.0, 0.0])
    amcl = filter_of(grid, resample_interval=1, selective_resampling=True, **ORIGINAL)
    amcl.set_pose(pose, np.diag([1e-6, 1e-6, 1e-6]))
    amcl.update(np.zeros(3), scan_at(grid, pose), MOUNT)
    assert len(np.unique(amcl.weights)) > 1  # all explain the scan about equally well


def test_odd_scans_move_the_particles_and_no_more():
    grid, pose = furnished_room(), np.array([1.5, 2.0, 0.0])
    amcl = filter_of(grid)
    amcl.set_pose(pose, np.zeros((3, 3)))
    scan = scan_at(grid, pose)
    for k, value in enumerate((np.nan, np.inf, -np.inf, 0.0)):
        odd = dataclasses.replace(scan, ranges_m=np.full(180, value, np.float32), stamp_ns=k * 10**9)
        assert amcl.update([0.3 * k, 0.0, 0.0], odd, MOUNT)
    assert amcl.update(
        [1.2, 0.0, 0.0], dataclasses.replace(scan, ranges_m=np.empty(0, np.float32), stamp_ns=9**10), MOUNT
    )
    assert amcl.update([1.5, 0.0, 0.0], dataclasses.replace(scan, range_max_m=0.0, stamp_ns=10**10), MOUNT)
    np.testing.assert_allclose(amcl.pose, [3.0, 2.0, 0.0], atol=0.25)
    with pytest.raises(DataError, match=r"odometry at .* is not finite"):
        amcl.update([np.nan, 0.0, 0.0], scan, MOUNT)


def test_a_jump_of_odometry_spreads_the_particles():
    grid, pose = furnished_room(), np.array([1.5, 2.0, 0.0])
    amcl = filter_of(grid)
    amcl.set_pose(pose, np.diag([1e-4, 1e-4, 1e-4]))
    amcl.update(np.zeros(3), scan_at(grid, pose, 0), MOUNT)
    narrow = np.sqrt(amcl.covariance[0, 0])
    amcl.update([50.0, 0.0, 0.0], scan_at(grid, pose, 1), MOUNT)
    assert np.isfinite(amcl.pose).all()
    assert amcl.particles[:, 0].std() > 10 * narrow


def test_another_map_is_gone_on_with():
    grid, way = furnished_room(), round_trip(20)
    amcl = filter_of(grid)
    amcl.set_pose(way[0])
    drive(amcl, way)
    shifted = OccupancyGrid(grid.cells, grid.resolution_m, (-1.1, -1.0, 0.0))  # the same room, mapped 0.1 m to the left
    amcl.set_map(shifted)
    back = way[::-1]
    odom = se2.compose(amcl._pose_odom, se2.between(back[0], back))
    for k, pose in enumerate(back):
        amcl.update(odom[k], scan_at(grid, pose, 100 + k), MOUNT)
    np.testing.assert_allclose(amcl.pose[:2], back[-1, :2] - [0.1, 0.0], atol=0.06)
    stubborn = filter_of(grid, first_map_only=True)
    particles = stubborn.particles
    stubborn.set_map(shifted)
    np.testing.assert_array_equal(stubborn.particles, particles)


def test_starts_are_drawn_as_asked():
    amcl = filter_of(furnished_room(), initial_pose_x=1.0, initial_pose_a=3.1, initial_cov_xx=0.04, max_particles=20000)
    assert amcl.particles[:, 0].mean() == pytest.approx(1.0, abs=0.01)
    assert amcl.particles[:, 0].std() == pytest.approx(0.2, abs=0.01)
    assert np.abs(amcl.particles[:, 2]).max() <= math.pi
    covariance = np.array([[0.09, 0.03, 0.0], [0.03, 0.04, 0.0], [0.0, 0.0, 0.01]])
    amcl.set_pose([1.0, 2.0, 0.0], covariance)
    np.testing.assert_allclose(np.cov(amcl.particles.T), covariance, atol=0.004)


@pytest.mark.parametrize(
    ("pose", "covariance"),
    [
        ([np.nan, 0, 0], np.eye(3)),
        ([0, 0], np.eye(3)),
        ([0, 0, 0], -np.eye(3)),
        ([0, 0, 0], np.eye(2)),
        ([0, 0, 0], np.array([[1.0, 2.0, 0], [0, 1, 0], [0, 0, 1]])),
    ],
)
def test_starts_that_are_none_are_refused(pose, covariance):
    with pytest.raises(DataError):
        filter_of(furnished_room()).set_pose(pose, covariance)


def test_more_particles_at_least_than_at_most_are_refused():
    with pytest.raises(ConfigError, match="min_particles=600 is more than max_particles=500"):
        AmclParameters(min_particles=600, max_particles=500)
