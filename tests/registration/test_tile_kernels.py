# SPDX-License-Identifier: MIT
"""Every kernel of tile matching against its naive twin (naive_tiles): windows, borders, outside, empty, duplicates."""

from __future__ import annotations

import naive_tiles as naive
import numpy as np
import pytest

from slamcli.grids.tiles import TiledMaps
from slamcli.registration import _tile_kernels as kernels
from slamcli.registration.tile_matching import (
    HillClimb,
    SurfaceAlignment,
    match_particles,
    sample_likelihoods,
    surface_aligner,
)

pytestmark = pytest.mark.kernels

DELTA = 0.05
EMPTY = np.empty((0, 2))
POSES = [(0.0, 0.0, 0.0), (0.031, -0.042, 0.05), (0.4, -0.3, 1.0), (-0.7, 0.72, -2.9)]


def walls(rng, count):
    """Points on the walls of a 1.7 x 1.5 m room, which crosses borders of tiles (1.6 m) at 0 in both directions."""
    side = rng.integers(0, 4, count)
    u = rng.uniform(-1, 1, count)
    x = np.where(side == 0, -0.83, np.where(side == 1, 0.87, u * 0.83))
    y = np.where(side == 2, -0.72, np.where(side == 3, 0.78, u * 0.72))
    return np.column_stack([x, y])


def unit(points):
    return points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)


@pytest.fixture(scope="module")
def maps():
    rng = np.random.default_rng(8)
    made = TiledMaps(2, DELTA, (-1.6, -1.6, 1.6, 1.6))
    for _ in range(2):
        ends = walls(rng, 60)
        made.add_scan(rng.normal(0, 0.01, (2, 3)), np.zeros((1, 2)), ends, rng.random(60) < 0.9)
    return made


@pytest.fixture(scope="module")
def view(maps):
    return naive.NaiveView(maps, 1)


def scans():
    rng = np.random.default_rng(9)
    points = walls(rng, 18) + rng.normal(0, 0.02, (18, 2))
    far = np.array([[1.59, 1.59], [-1.6, -1.6], [50.0, 1.0], [-1e7, 2.0], [1.6, 0.0]])
    on_borders = np.array([[0.0, 0.78], [0.0, -0.72], [0.87, 0.0], [-1e-12, 0.77]])
    return {
        "walls": points,
        "empty": EMPTY,
        "one": points[:1],
        "duplicates": np.repeat(points[:3], 4, axis=0),
        "outside": np.vstack([points[:2], far]),
        "borders": on_borders,
    }


@pytest.mark.parametrize("window", [0, 1, 2])
@pytest.mark.parametrize("free_check", [0.0, 0.07])
@pytest.mark.parametrize("name", list(scans()))
def test_score_and_likelihood(view, name, window, free_check):
    points = scans()[name]
    directions = unit(points)
    for pose in POSES:
        arguments = (view.kernel_view, points, directions, *pose, window, 0.1, free_check, 0.05)
        twin = (view, points, directions, pose, window, 0.1, free_check, 0.05)
        assert kernels.score_pose(*arguments) == pytest.approx(naive.score(*twin), rel=1e-4, abs=1e-9)
        assert kernels.log_likelihood(*arguments) == pytest.approx(naive.log_likelihood(*twin), rel=1e-4, abs=1e-9)


def test_twice_the_points_are_twice_the_score(view):
    points = scans()["walls"]
    twice = np.vstack([points, points])
    one = kernels.score_pose(view.kernel_view, points, unit(points), *POSES[1], 1, 0.1, 0.0, 0.05)
    two = kernels.score_pose(view.kernel_view, twice, unit(twice), *POSES[1], 1, 0.1, 0.0, 0.05)
    assert one > 5
    assert two == pytest.approx(2 * one, rel=1e-12)


def test_the_free_check_does_not_count_walls_seen_from_inside():
    maps = TiledMaps(1, DELTA, (-1.6, -1.6, 1.6, 1.6))
    for x in (1.0, 1.05, 1.1):  # a wall three cells thick, of which only the first can be seen from zero
        point = np.array([[x + 0.01, 0.01]])
        maps.add_scan(np.zeros((1, 3)), point - 1e-3, point, np.ones(1, np.bool_))
    view = naive.NaiveView(maps)
    front, inside, beam = np.array([[1.01, 0.01]]), np.array([[1.11, 0.01]]), np.array([[1.0, 0.0]])
    for free_check, counted in ((0.0, 1.0), (0.07, 0.0)):
        seen = kernels.score_pose(view.kernel_view, inside, beam, 0.0, 0.0, 0.0, 1, 0.1, free_check, 0.05)
        assert seen == pytest.approx(counted, abs=1e-6)
        assert kernels.score_pose(view.kernel_view, front, beam, 0.0, 0.0, 0.0, 1, 0.1, free_check, 0.05) == (
            pytest.approx(1.0, abs=1e-6)
        )


@pytest.mark.parametrize("name", ["walls", "empty", "one", "outside"])
@pytest.mark.parametrize("iterations", [0, 3])
def test_hill_climb(view, name, iterations):
    points = scans()[name]
    directions = unit(points)
    settings = (1, 0.1, 0.0, 0.05)

    def score_at(x, y, yaw):
        return kernels.score_pose(view.kernel_view, points, directions, x, y, yaw, *settings)

    for pose in POSES[:2]:
        found = kernels.hill_climb(
            view.kernel_view, points, directions, np.array(pose), *settings, 0.05, 0.04, iterations
        )
        np.testing.assert_allclose(found, naive.hill_climb(score_at, pose, 0.05, 0.04, iterations), atol=1e-12)
        assert found[3] >= score_at(*pose)


@pytest.mark.parametrize("tangent", [1.0, 0.25])
@pytest.mark.parametrize("window", [0, 1, 2])
@pytest.mark.parametrize("name", list(scans()))
def test_align_equals_stacked_least_squares(view, name, window, tangent):
    points = scans()[name]
    rng = np.random.default_rng(10)
    prior, start = rng.normal(0, 0.02, 3), rng.normal(0, 0.02, 3)
    for information in (np.array([400.0, 300.0, 900.0]), np.full(3, 1e6)):
        for iterations in (1, 6):
            settings = (prior, information, window, 0.1, 0.03, 4.0, tangent, iterations)
            normal, expected = np.zeros((3, 3)), np.zeros((3, 3))
            found = kernels.align(view.kernel_view, points, start, *settings, normal)
            np.testing.assert_allclose(found, naive.align(view, points, start, *settings, expected), atol=2e-5)
            np.testing.assert_allclose(np.triu(normal), np.triu(expected), rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("tangent", [1.0, 0.25])
def test_the_steps_right_hand_side_is_the_derivative_of_the_robust_cost(view, tangent):
    points = scans()["walls"]
    pose, prior, information = np.array([0.011, -0.012, 0.01]), np.zeros(3), np.array([10.0, 20.0, 30.0])
    found = naive.surfaces(view, points, pose, 1, 0.1, 0.03, tangent)
    gradient = np.empty(3)
    for axis in range(3):
        step = np.eye(3)[axis] * 1e-6
        up, down = (
            naive.alignment_cost(view, points, pose + k * step, found, 4.0, prior, information) for k in (1, -1)
        )
        gradient[axis] = (up - down) / 2e-6
    hessian, right = np.diag(information), information * (pose - prior)
    count, quality = kernels._linearise(view.kernel_view, points, *pose, 1, 0.1, 0.03**2, 4.0, tangent, hessian, right)
    np.testing.assert_allclose(right, gradient, rtol=1e-3, atol=1e-2)
    assert count == sum(surface is not None for surface in found)
    assert 0 < quality <= count


def test_solve_is_the_inverse_of_the_normal_equations():
    rng = np.random.default_rng(11)
    for _ in range(20):
        root = rng.normal(size=(3, 3))
        hessian, gradient = root @ root.T * 100 + np.eye(3), rng.normal(size=3)
        expected = np.linalg.solve(hessian, -gradient)
        np.testing.assert_allclose(kernels._solve(np.triu(hessian), gradient), expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(kernels._solve(np.zeros((3, 3)), np.zeros(3)), 0.0)


def test_a_corridor_leaves_the_direction_along_it_to_the_prior():
    maps = TiledMaps(1, DELTA, (-3.0, -3.0, 3.0, 3.0))
    rng = np.random.default_rng(13)  # hits that keep step with the cells would draw along the corridor
    ends = np.column_stack([rng.uniform(-2, 2, 1600), np.where(rng.random(1600) < 0.5, 1.01, -0.99)])
    maps.add_scan(np.zeros((1, 3)), np.zeros((1, 2)), ends, np.ones(1600, np.bool_))
    points = np.column_stack([rng.uniform(-1.5, 1.5, 200), np.where(rng.random(200) < 0.5, 1.01, -0.99)])
    align = surface_aligner(maps, points, SurfaceAlignment())
    x, y, yaw, quality = align(np.array([0.3, 0.03, 0.01]), np.array([0.3, 0.03, 0.01]), np.full(3, 25.0))
    assert abs(x - 0.3) < 0.02  # nothing along the corridor tells, the prior holds
    assert abs(y) < 0.005
    assert abs(yaw) < 0.005
    assert quality > 0.8


def test_match_particles_is_climb_then_alignment_then_likelihood(maps):
    points = scans()["walls"]
    directions = unit(points)
    climb, surface = HillClimb(iterations=1), SurfaceAlignment(max_iterations=4)
    information = np.array([50.0, 50.0, 50.0])
    start = np.array([[0.03, -0.03, 0.02], [-0.02, 0.01, 0.03]])
    poses = start.copy()
    scores, likelihoods = match_particles(maps, points, directions, poses, climb, surface, information)
    for k in range(2):
        view = naive.NaiveView(maps, k).kernel_view
        x, y, yaw, _ = kernels.hill_climb(view, points, directions, start[k], 1, 0.1, 0.0, 0.05, 0.05, 0.05, 1)
        expected = kernels.align(
            view, points, np.array([x, y, yaw]), start[k], information, 1, 0.1, surface.noise_m, surface.scale, 1.0, 4,
            np.zeros((3, 3)),
        )  # fmt: skip
        np.testing.assert_array_equal(poses[k], expected[:3])
        assert scores[k] == kernels.score_pose(view, points, directions, *poses[k], 1, 0.1, 0.0, 0.05)
        assert likelihoods[k] == kernels.log_likelihood(view, points, directions, *poses[k], 1, 0.1, 0.0, 0.075)


def test_a_score_at_the_minimum_is_not_enough(maps):
    points = scans()["walls"]
    directions, start = unit(points), np.array([[0.03, -0.03, 0.02], [-0.02, 0.01, 0.03]])
    reached = match_particles(maps, points, directions, start.copy(), HillClimb())[0]
    poses = start.copy()
    scores, _ = match_particles(maps, points, directions, poses, HillClimb(minimum_score=float(reached[0])))
    assert scores[0] == reached[0]
    np.testing.assert_array_equal(poses[0], start[0])
    poses = start.copy()
    match_particles(maps, points, directions, poses, HillClimb(minimum_score=float(np.nextafter(reached[0], 0))))
    assert np.abs(poses[0] - start[0]).max() > 0


def test_an_empty_scan_moves_nothing(maps):
    poses = np.array([[0.03, -0.03, 0.02], [-0.02, 0.01, 0.03]])
    before = poses.copy()
    scores, likelihoods = match_particles(maps, EMPTY, EMPTY, poses, HillClimb(), SurfaceAlignment(), np.ones(3))
    np.testing.assert_array_equal(poses, before)
    np.testing.assert_array_equal(scores, 0.0)
    np.testing.assert_array_equal(likelihoods, 0.0)


def test_sample_likelihoods(maps):
    rng = np.random.default_rng(12)
    points = scans()["outside"]
    poses, offsets = rng.normal(0, 0.05, (2, 3)), rng.normal(0, 0.05, (5, 3))
    settings = HillClimb(window=2, free_check_m=0.06, lsigma=0.1)
    found = sample_likelihoods(maps, points, unit(points), poses, offsets, settings)
    for k in range(2):
        view = naive.NaiveView(maps, k)
        expected = [naive.log_likelihood(view, points, unit(points), poses[k] + o, 2, 0.1, 0.06, 0.1) for o in offsets]
        np.testing.assert_allclose(found[k], expected, rtol=1e-4)
    assert sample_likelihoods(maps, points, unit(points), poses, np.empty((0, 3)), settings).shape == (2, 0)
