# SPDX-License-Identifier: MIT
"""Sensor models against naive twins; which beams are used."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from furnished_room import furnished_room, scan_at

from slamcli.errors import DataError
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.localization.laser_model import LaserModel, select_beams
from slamcli.localization.likelihood_field import LocalizationMap

POSES = np.array([[1.0, 1.0, 0.3], [2.0, 3.0, -2.0], [0.0, 0.0, 3.1], [-5.0, 0.0, 0.0], [5.5, 3.5, 1.0]])


def naive_distances(grid: OccupancyGrid) -> np.ndarray:
    walls = np.argwhere(grid.cells >= 65)
    every = np.argwhere(np.ones(grid.cells.shape, np.bool_))
    nearest = np.array([np.sqrt(((walls - cell) ** 2).sum(axis=1).min()) for cell in every])
    return nearest.reshape(grid.cells.shape) * grid.resolution_m


def naive_hit(grid, distances, p, point):
    row, column = grid.map_to_cell([point])[0]
    inside = 0 <= row < grid.height and 0 <= column < grid.width
    d = min(distances[row, column], p.laser_likelihood_max_dist) if inside else p.laser_likelihood_max_dist
    return p.laser_z_hit * math.exp(-(d**2) / (2.0 * p.laser_sigma_hit**2))


@pytest.fixture
def small() -> OccupancyGrid:
    cells = np.full((12, 15), OccupancyGrid.FREE, dtype=np.int8)
    cells[:, 0] = cells[0] = cells[6, 7:10] = OccupancyGrid.OCCUPIED
    cells[10:, 10:] = OccupancyGrid.UNKNOWN
    return OccupancyGrid(cells, 0.5, (-1.0, -2.0, 0.4))


@pytest.mark.kernels
def test_likelihood_fields_equal_the_naive_twin(small):
    scan = scan_at(furnished_room(), [1.0, 1.0, 0.0])
    distances, rng = naive_distances(small), np.random.default_rng(1)
    poses = np.column_stack([rng.uniform(-3, 6, (20, 2)), rng.uniform(-3.1, 3.1, 20)])
    for kind in ("likelihood_field", "likelihood_field_prob"):
        p = AmclParameters(laser_model_type=kind, laser_max_beams=12)
        beams = select_beams(scan, np.array([0.1, 0.2, 0.3]), p)
        found = LaserModel(p, LocalizationMap.of(small, p)).likelihoods(poses, beams, converged=False)
        for pose, value in zip(poses, found, strict=True):
            each = [
                naive_hit(small, distances, p, point) + p.laser_z_rand / 12.0
                for point in se2.transform_points(pose, beams.points())
            ]
            expected = 1.0 + sum(v**3 for v in each) if kind == "likelihood_field" else math.prod(each)
            assert value == pytest.approx(expected, rel=1e-5)


@pytest.mark.kernels
def test_the_beam_model_equals_the_naive_twin(small):
    scan = scan_at(furnished_room(), [1.0, 1.0, 0.0])
    p = AmclParameters(laser_model_type="beam", laser_max_beams=9, laser_max_range=4.0)
    beams = select_beams(scan, np.array([0.1, 0.2, 0.3]), p)
    poses = np.array([[0.7, 0.9, 0.3], [2.0, 2.0, -2.0], [-30.0, 0.0, 0.0]])
    found = LaserModel(p, LocalizationMap.of(small, p)).likelihoods(poses, beams, converged=False)
    step = 4e-3
    for pose, value in zip(poses, found, strict=True):
        total = 1.0
        for origin, bearing, reading in zip(beams.origins, beams.bearings, beams.ranges, strict=True):
            x, y = se2.transform_points(pose, [origin])[0]
            expected, reading = beams.most, min(reading, beams.most)
            for k in range(int(beams.most / step)):
                at = [x + k * step * math.cos(pose[2] + bearing), y + k * step * math.sin(pose[2] + bearing)]
                row, column = small.map_to_cell([at])[0]
                if not (0 <= row < small.height and 0 <= column < small.width):
                    break
                if small.cells[row, column] != 0:
                    expected = k * step
                    break
            apart = reading - expected
            likely = p.laser_z_hit * math.exp(-(apart**2) / (2 * p.laser_sigma_hit**2))
            likely += p.laser_z_short * p.laser_lambda_short * math.exp(-p.laser_lambda_short * reading) * (apart < 0)
            likely += p.laser_z_max if reading >= beams.most else p.laser_z_rand / beams.most
            total += likely**3
        assert value == pytest.approx(total, rel=2e-2)


def test_the_true_pose_explains_a_scan_best():
    grid, truth = furnished_room(), np.array([1.5, 2.0, 0.7])
    scan = scan_at(grid, truth)
    poses = truth + np.array([[0, 0, 0], [0.3, 0, 0], [0, -0.3, 0], [0, 0, 0.3], [1, 1, 2.0]])
    for kind in ("likelihood_field", "likelihood_field_prob", "beam"):
        p = AmclParameters(laser_model_type=kind)
        found = LaserModel(p, LocalizationMap.of(grid, p)).likelihoods(
            poses, select_beams(scan, np.array([0.1, 0.0, 0.0]), p), converged=True
        )
        assert found.argmax() == 0


def test_readings_without_meaning_are_left_out():
    p = AmclParameters(laser_max_beams=5, laser_min_range=0.2, laser_max_range=6.0)
    scan = scan_at(furnished_room(), [1.0, 1.0, 0.0])
    ranges = np.array([np.nan, np.inf, -np.inf, 0.1, 3.0], dtype=np.float32)
    beams = select_beams(dataclasses.replace(scan, ranges_m=ranges), np.zeros(3), p)
    np.testing.assert_array_equal(beams.returned, [False, False, False, False, True])
    assert beams.points().shape == (1, 2)
    assert beams.most == 6.0


@pytest.mark.parametrize("num", [0, 1, 2, 29, 30, 31, 726])
def test_beams_are_spaced_evenly(num):
    scan = dataclasses.replace(scan_at(furnished_room(), [1.0, 1.0, 0.0]), ranges_m=np.ones(num, np.float32))
    beams = select_beams(scan, np.zeros(3), AmclParameters())
    assert len(beams.ranges) <= max(2 * 30, num // 20)
    steps = np.diff(beams.bearings)
    assert len(steps) == 0 or np.ptp(steps) < 1e-9


def test_a_clockwise_scanner_and_one_upside_down_see_the_same():
    grid, pose, p = furnished_room(), np.array([1.0, 1.0, 0.4]), AmclParameters(laser_max_beams=180)
    upright = select_beams(scan_at(grid, pose), np.array([0.1, 0.0, 0.0]), p).points()
    clockwise = select_beams(scan_at(grid, pose, clockwise=True), np.array([0.1, 0.0, 0.0]), p).points()
    hanging = np.diag([1.0, -1.0, -1.0, 1.0])
    hanging[0, 3] = 0.1
    mirrored = dataclasses.replace(
        scan_at(grid, pose, clockwise=True), angle_min_rad=-math.pi, angle_increment_rad=2.0 * math.pi / 180
    )
    for other in (clockwise, select_beams(mirrored, hanging, p).points()):
        nearest = np.hypot(*(upright[:, None] - other[None]).transpose(2, 0, 1)).min(axis=1)
        assert nearest.max() < 1e-5


def test_beams_that_few_can_explain_are_skipped():
    grid, truth = furnished_room(), np.array([1.5, 2.0, 0.7])
    scan = scan_at(grid, truth)
    ranges = scan.ranges_m.copy()
    ranges[60:90] = 0.4  # somebody stands there
    scan = dataclasses.replace(scan, ranges_m=ranges)
    poses = truth + np.random.default_rng(0).normal(0, 0.03, (200, 3))
    found = {}
    for skip in (False, True):
        p = AmclParameters(laser_model_type="likelihood_field_prob", do_beamskip=skip)
        beams = select_beams(scan, np.array([0.1, 0.0, 0.0]), p)
        found[skip] = LaserModel(p, LocalizationMap.of(grid, p)).likelihoods(poses, beams, converged=True)
    assert (found[True] > 1e3 * found[False]).all()


def test_deskewed_beams_stand_where_they_were_measured():
    scan = dataclasses.replace(scan_at(furnished_room(), [1.0, 1.0, 0.0]), time_increment_s=0.001)
    p, twist = AmclParameters(laser_max_beams=180), np.array([1.0, 0.0, 0.5])
    still, moving = (select_beams(scan, np.zeros(3), p, twist=t).points() for t in (None, twist))
    last = se2.transform_points([0.179, 0.0, 0.0], [[0.0, 0.0]])
    np.testing.assert_allclose(moving[0], still[0], atol=1e-12)
    turn = 0.179 * 0.5
    c, s = math.cos(turn), math.sin(turn)
    np.testing.assert_allclose(moving[-1], last[0] + np.array([[c, -s], [s, c]]) @ still[-1], atol=0.02)


@pytest.mark.parametrize("value", [OccupancyGrid.OCCUPIED, OccupancyGrid.FREE, OccupancyGrid.UNKNOWN])
def test_a_map_without_room_or_walls_is_refused(value):
    with pytest.raises(DataError, match=r"has no (free|occupied) cell"):
        LocalizationMap.of(OccupancyGrid(np.full((5, 5), value, np.int8), 0.1), AmclParameters())


def test_random_poses_are_in_free_cells(small):
    map_ = LocalizationMap.of(small, AmclParameters())
    poses = map_.random_poses(500, np.random.default_rng(0))
    assert all(map_.is_free(pose[:2]) for pose in poses)
    assert np.abs(poses[:, 2]).max() <= math.pi
    assert len(np.unique(small.map_to_cell(poses[:, :2]), axis=0)) > 100
