# SPDX-License-Identifier: MIT
"""A scan laid on walls: against a naive twin of the cost, against the truth, and from nowhere."""

from __future__ import annotations

import numpy as np
import pytest
from furnished_room import furnished_room, scan_at

from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.localization import _refinement_kernels as kernels
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.localization.laser_model import select_beams
from slamcli.localization.likelihood_field import LocalizationMap
from slamcli.localization.refinement import find_candidates, fit_of, refine_pose

MOUNT = np.array([0.1, 0.0, 0.0])


@pytest.fixture(scope="module")
def room() -> LocalizationMap:
    return LocalizationMap.of(furnished_room(), AmclParameters())


def points_at(map_: LocalizationMap, pose) -> np.ndarray:
    return select_beams(scan_at(map_.grid, pose), MOUNT, AmclParameters(), max_beams=120).points()


def naive_distance(distances, frame, point):
    c, s = np.cos(frame[2]), np.sin(frame[2])
    dx, dy = point[0] - frame[0], point[1] - frame[1]
    u, v = (c * dx + s * dy) * frame[3] - 0.5, (c * dy - s * dx) * frame[3] - 0.5
    j, i = int(np.floor(u)), int(np.floor(v))
    if not (0 <= j < distances.shape[1] - 1 and 0 <= i < distances.shape[0] - 1):
        return None
    a, b = u - j, v - i
    return (distances[i, j] * (1 - a) + distances[i, j + 1] * a) * (1 - b) + (
        distances[i + 1, j] * (1 - a) + distances[i + 1, j + 1] * a
    ) * b


@pytest.mark.kernels
def test_the_normal_equations_equal_the_naive_twins():
    cells = furnished_room().cells
    map_ = LocalizationMap.of(OccupancyGrid(cells, 0.05, (-1.0, -2.0, 0.3)), AmclParameters())
    rng = np.random.default_rng(0)
    points, pose = rng.uniform(-3, 3, (400, 2)), np.array([2.0, 1.0, 0.6])
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    fit = kernels._linearise(points, pose, map_.frame, map_.distances, 0.025, 0.1, 0.15, hessian, gradient)
    expected_h, expected_g, weights, num_behind = np.zeros((3, 3)), np.zeros(3), [], 0
    for point in points:
        at, from_robot = se2.transform_points(pose, [point])[0], np.array([np.cos(pose[2]), np.sin(pose[2])])
        from_robot = np.array([[from_robot[0], -from_robot[1]], [from_robot[1], from_robot[0]]]) @ point
        distance = naive_distance(map_.distances, map_.frame, at)
        if distance is None:
            weights.append(0.0)
            continue

        def slope_along(way, at=at):
            ends = [naive_distance(map_.distances, map_.frame, at + s * 1e-7 * way) for s in (1, -1)]
            return (ends[0] - ends[1]) / 2e-7

        behind = slope_along(from_robot / np.linalg.norm(from_robot)) > 0.2 and distance < 0.075
        num_behind += behind
        jacobian = np.empty(3)
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = 1e-7
            ends = [
                naive_distance(map_.distances, map_.frame, se2.transform_points(pose + s * step, [point])[0])
                for s in (1, -1)
            ]
            jacobian[axis] = (ends[0] - ends[1]) / 2e-7
        jacobian, distance = (-jacobian, -distance - 0.025) if behind else (jacobian, distance - 0.025)
        weight = np.exp(-(distance**2) / (2 * 0.15**2))
        weights.append(weight)
        expected_h += weight / 0.01 * np.outer(jacobian, jacobian)
        expected_g += weight / 0.01 * jacobian * distance
    assert num_behind >= 3
    assert fit == pytest.approx(np.mean(weights), rel=1e-6)
    np.testing.assert_allclose(hessian, expected_h, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(gradient, expected_g, rtol=1e-4, atol=1e-4)


@pytest.mark.kernels
def test_a_pose_beside_the_truth_comes_back(room):
    truth = np.array([1.5, 2.0, 0.7])
    points, start = points_at(room, truth), truth + np.array([0.2, -0.15, 0.1])
    found = refine_pose(room, points, start, np.diag([0.1, 0.1, 0.05]), [start])
    assert found is not None
    assert np.hypot(*(found.pose - truth)[:2]) < 0.01
    assert abs(found.pose[2] - truth[2]) < 0.005
    assert found.fit > 0.9 > fit_of(room, points, start)


def test_walls_made_from_scans_are_met_in_the_middle():
    map_ = LocalizationMap.of(furnished_room(), AmclParameters(wall_depth=0.5))
    truth = np.array([1.5, 2.0, 0.7])
    points = points_at(map_, truth)
    deeper = points * (1.0 + 0.025 / np.linalg.norm(points, axis=1, keepdims=True))
    found = refine_pose(map_, deeper, truth, np.diag([0.1, 0.1, 0.05]), [truth])
    assert found is not None
    assert np.hypot(*(found.pose - truth)[:2]) < 0.015


def test_what_the_particles_rule_out_is_not_taken(room):
    truth = np.array([1.5, 2.0, 0.7])
    far = truth + np.array([0.3, 0.3, 0.0])
    found = refine_pose(room, points_at(room, truth), far, np.diag([1e-6, 1e-6, 1e-6]), [truth])
    assert found is None or np.hypot(*(found.pose - far)[:2]) < 0.05


def test_along_a_corridor_the_particles_decide():
    cells = np.zeros((60, 400), dtype=np.int8)
    cells[:5] = cells[-5:] = OccupancyGrid.OCCUPIED
    map_ = LocalizationMap.of(OccupancyGrid(cells, 0.05), AmclParameters())
    x = np.concatenate([np.linspace(-3, 3, 50)] * 2)
    points = np.column_stack([x, np.repeat([-1.25, 1.25], 50)])
    mean = np.array([10.0, 1.6, 0.05])
    found = refine_pose(map_, points, mean, np.diag([0.05, 0.05, 0.02]), [mean])
    assert found is not None
    assert (np.abs(found.pose - [10.0, 1.5, 0.0]) < [0.02, 0.01, 0.005]).all()


def test_the_place_is_found_from_nowhere(room):
    for seed, truth in enumerate(np.array([[1.5, 2.0, 0.7], [5.0, 0.5, -2.0], [0.0, 4.0, 3.0]])):
        poses, fits = find_candidates(room, points_at(room, truth), 20_000, np.random.default_rng(seed))
        apart = se2.between(truth, poses[0])
        assert np.hypot(apart[0], apart[1]) < 0.03
        assert abs(apart[2]) < 0.02
        assert (np.diff(fits) <= 0.0).all()
        assert all(room.is_free(pose[:2]) for pose in poses)


@pytest.mark.kernels
def test_beams_through_walls_equal_the_naive_twin(room):
    rng = np.random.default_rng(1)
    points = rng.uniform(-4, 4, (60, 2))
    poses = np.column_stack([rng.uniform(-0.5, 6.5, 8), rng.uniform(-0.5, 4.5, 8), rng.uniform(-3, 3, 8)])
    found = np.empty(8)
    kernels.blocked_shares(points, poses, room.frame, room.distances, 0.3, found)
    for pose, share in zip(poses, found, strict=True):
        blocked = 0
        for point, end in zip(points, se2.transform_points(pose, points), strict=True):
            length = np.hypot(*point)
            steps = int(np.floor((length - 0.3) / 0.05))
            ways = np.arange(1, max(steps, 1))[:, None] * 0.05 / length
            cells = room.grid.map_to_cell(pose[:2] + ways * (end - pose[:2]))
            outside = np.flatnonzero(~room.grid.contains(cells))
            cells = cells[: outside[0]] if len(outside) else cells
            blocked += bool((room.grid.cells[cells[:, 0], cells[:, 1]] >= 65).any())
        assert share == pytest.approx(blocked / 60, abs=1.5 / 60)  # rounding decides at corners
