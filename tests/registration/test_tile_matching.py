# SPDX-License-Identifier: MIT
"""Scan matching on tiled maps against a naive twin."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from slamcli.grids.tiles import TiledMaps
from slamcli.registration import tile_matching
from slamcli.registration.tile_matching import HillClimb, SurfaceAlignment, match_particles, sample_likelihoods

pytestmark = pytest.mark.kernels

DELTA = 0.05


def room_scan(pose=(0.0, 0.0, 0.0), beams=60):
    """End points (B, 2) in the base frame of a 5 x 3 m room seen from `pose`."""
    angles = np.linspace(-np.pi, np.pi, beams, endpoint=False) + 0.013 + pose[2]
    u = np.column_stack([np.cos(angles), np.sin(angles)])
    with np.errstate(divide="ignore"):
        walls = np.where(u > 0, (np.array([3.0, 1.9]) - pose[:2]) / u, (np.array([-2.0, -1.1]) - pose[:2]) / u)
    points = u * walls.min(axis=1)[:, None]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return points @ np.array([[c, -s], [s, c]])


@pytest.fixture(scope="module")
def maps():
    made = TiledMaps(3, DELTA, (-4.0, -4.0, 4.0, 4.0))
    for beams in (200, 331):
        ends = room_scan(beams=beams)
        made.add_scan(np.zeros((3, 3)), np.zeros_like(ends), ends, np.ones(beams, dtype=bool))
    return made


def naive_cell(maps, index, i, j):
    rows, columns = maps.tables.shape[1:]
    if not (0 <= i >> 5 < rows and 0 <= j >> 5 < columns):
        return np.zeros(4)
    return maps.cells[maps.tables[index, i >> 5, j >> 5], i & 31, j & 31]


def naive_distance2(maps, index, point, settings):
    x, y = point - np.array(maps.origin)
    i0, j0 = math.floor(y / DELTA), math.floor(x / DELTA)
    best = math.inf
    for i in range(i0 - settings.window, i0 + settings.window + 1):
        for j in range(j0 - settings.window, j0 + settings.window + 1):
            visits, hits, mx, my = naive_cell(maps, index, i, j)
            if hits > settings.fullness * visits:
                best = min(best, (x - j * DELTA - mx) ** 2 + (y - i * DELTA - my) ** 2)
    return best


def naive_distances(maps, index, points, pose, settings):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    placed = points @ np.array([[c, s], [-s, c]]) + np.asarray(pose[:2])
    return np.array([naive_distance2(maps, index, point, settings) for point in placed])


def naive_score(maps, index, points, pose, settings):
    return np.exp(-naive_distances(maps, index, points, pose, settings) / settings.sigma).sum()


def naive_likelihood(maps, index, points, pose, settings):
    d2 = naive_distances(maps, index, points, pose, settings)
    return -np.where(np.isfinite(d2), d2, 0.5).sum() / settings.lsigma


@pytest.mark.parametrize("window", [0, 1, 2])
def test_likelihoods_equal_the_naive_twins(maps, window):
    rng = np.random.default_rng(4)
    settings = replace(HillClimb(), window=window, minimum_score=1e9)
    points = room_scan(beams=25)
    directions = points / np.linalg.norm(points, axis=1)[:, None]
    poses = rng.normal(0, 0.05, (3, 3))
    before = poses.copy()
    _, likelihoods = match_particles(maps, points, directions, poses, settings)
    np.testing.assert_array_equal(poses, before)  # no match reaches such a score
    expected = [naive_likelihood(maps, k, points, poses[k], settings) for k in range(3)]
    np.testing.assert_allclose(likelihoods, expected, rtol=2e-4)
    offsets = rng.normal(0, 0.02, (4, 3))
    sampled = sample_likelihoods(maps, points, directions, poses, offsets, settings)
    expected = [
        [naive_likelihood(maps, k, points, poses[k] + offset, settings) for offset in offsets] for k in range(3)
    ]
    np.testing.assert_allclose(sampled, expected, rtol=2e-4)


def test_the_climb_ends_where_no_move_improves_the_naive_score(maps):
    settings = HillClimb()
    points = room_scan(beams=25)
    directions = points / np.linalg.norm(points, axis=1)[:, None]
    poses = np.array([[0.04, -0.03, 0.02], [0.0, 0.0, 0.0], [-0.05, 0.05, -0.03]])
    before = poses.copy()
    scores, _ = match_particles(maps, points, directions, poses, settings)
    for k in range(3):
        reached = naive_score(maps, k, points, poses[k], settings)
        assert scores[k] == pytest.approx(reached, rel=1e-4)
        assert reached >= naive_score(maps, k, points, before[k], settings) - 1e-6
        smallest = np.array([settings.lstep_m, settings.lstep_m, settings.astep_rad]) / 2**settings.iterations
        for axis in range(3):
            for sign in (-1, 1):
                moved = poses[k].copy()
                moved[axis] += sign * smallest[axis]
                assert naive_score(maps, k, points, moved, settings) <= reached + 1e-3
    assert np.abs(poses[[0, 2]]).max() < 0.03  # the true pose is zero


def test_the_surface_alignment_finds_the_pose_and_follows_it(maps):
    settings = SurfaceAlignment()
    true = np.array([0.04, -0.03, 0.02])
    points = room_scan(true, beams=90)
    align = tile_matching.surface_aligner(maps, points, settings)
    x, y, yaw, quality = align(np.zeros(3), np.zeros(3), np.zeros(3))
    assert np.abs(np.array([x, y, yaw]) - true).max() < 0.01
    assert 0.8 < quality <= 1.0
    held = align(np.zeros(3), np.zeros(3), np.full(3, 1e12))
    np.testing.assert_allclose(held[:3], 0.0, atol=1e-6)


def test_points_far_from_the_map_score_nothing(maps):
    points = np.array([[1e6, 0.0], [-1e6, 3.0]])
    poses = np.zeros((3, 3))
    scores, likelihoods = match_particles(maps, points, np.ones_like(points), poses, HillClimb())
    np.testing.assert_array_equal(scores, 0.0)
    np.testing.assert_allclose(likelihoods, -0.5 / HillClimb().lsigma * 2)
    np.testing.assert_array_equal(poses, 0.0)
