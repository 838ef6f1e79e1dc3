# SPDX-License-Identifier: MIT
"""Planar scans merged into a map, and the place of another one in it: near a guess, by a search, in a corridor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.registration.merged_scans import MergedScans, PlanarScan, Window

Floats = NDArray[np.float64]
ROOM = [((0, 0), (8, 0)), ((8, 0), (8, 6)), ((8, 6), (0, 6)), ((0, 6), (0, 0)), ((2, 1), (2, 3)), ((5, 4), (6.5, 4.6))]
SIGMAS = np.array([0.1, 0.1, 0.05])


def scene(walls: list[tuple[tuple[float, float], tuple[float, float]]]) -> Floats:
    """Points on walls, 3 cm apart."""
    parts = [np.linspace(a, b, round(math.dist(a, b) / 0.03), endpoint=False) for a, b in walls]
    return np.concatenate(parts)


def scan_of(points: Floats, pose: Floats, seed: int, noise_m: float = 0.008) -> PlanarScan:
    """All points of a scene from a pose (walls hide nothing here)."""
    rng = np.random.default_rng(seed)
    local = se2.transform_points(se2.inverse(pose), points[seed % 3 :: 3])
    return PlanarScan(points=local + rng.normal(0.0, noise_m, local.shape), start=np.zeros(2), free=np.zeros((0, 2)))


def merged_room() -> MergedScans:
    poses = np.array([[3.0, 3.0, 0.0], [3.5, 3.1, 0.2], [4.0, 3.3, 0.4]])
    points = scene(ROOM)
    return MergedScans(poses, [scan_of(points, pose, seed) for seed, pose in enumerate(poses)], tangent=0.0)


@pytest.mark.parametrize("pose", [(4.4, 3.4, 0.5), (3.2, 2.8, -1.0), (6.0, 2.0, 3.1)])
def test_a_scan_is_aligned_near_its_guess(pose: tuple[float, float, float]) -> None:
    true = np.array(pose)
    found = merged_room().align(scan_of(scene(ROOM), true, 7), true + np.array([0.06, -0.05, 0.02]), SIGMAS)
    error = se2.between(true, found.pose)
    assert np.hypot(error[0], error[1]) < 0.01
    assert abs(error[2]) < 0.003
    assert found.quality > 0.8
    assert found.agreement.share_on_surface > 0.97
    assert not found.searched
    assert found.complexity > 0.4


def test_the_information_tells_the_size_of_errors() -> None:
    merged, points = merged_room(), scene(ROOM)
    true = np.array([4.4, 3.4, 0.5])
    normalised = []
    for seed in range(10, 30):
        found = merged.align(scan_of(points, true, seed), true, SIGMAS)
        error = found.pose - true
        normalised.append(float(error @ found.information @ error))
    # Three degrees of freedom; cells make errors somewhat larger than independent points would.
    assert 0.1 < np.mean(normalised) < 75.0


@pytest.mark.parametrize("off", [(1.5, -1.2, 0.4), (-2.0, 1.0, -0.5)])
def test_a_scan_far_from_its_guess_is_searched_for(off: tuple[float, float, float]) -> None:
    true = np.array([4.4, 3.4, 0.5])
    scan = scan_of(scene(ROOM), true, 7)
    found = merged_room().search(scan, np.zeros((0, 2)), true + off, Window(reach_m=3.0, reach_rad=0.7))
    assert found is not None
    assert found.searched
    assert np.hypot(*(found.pose - true)[:2]) < 0.02
    assert np.sqrt(np.linalg.eigvalsh(found.spread)[1]) < 0.3


def test_what_fits_nowhere_is_not_found() -> None:
    elsewhere = scene([((0, 0), (3, 3)), ((3, 3), (6, 0)), ((-4, 2), (-1, 5))])
    scan = scan_of(elsewhere, np.array([1.0, 2.0, 0.0]), 1)
    window = Window(reach_m=1.0, reach_rad=0.2, least_score=0.6)
    assert merged_room().search(scan, np.zeros((0, 2)), np.array([4.0, 3.0, 0.0]), window) is None
    assert (
        merged_room().search(
            PlanarScan(np.zeros((0, 2)), np.zeros(2), np.zeros((0, 2))), np.zeros((0, 2)), np.zeros(3), window
        )
        is None
    )


def test_along_a_corridor_nothing_is_told_and_the_guess_holds() -> None:
    points = scene([((-10, -1), (10, -1)), ((-10, 1), (10, 1))])
    poses = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    merged = MergedScans(poses, [scan_of(points, pose, seed) for seed, pose in enumerate(poses)], tangent=0.0)
    near = points[np.abs(points[:, 0]) < 5.0]  # its ends are out of sight
    scan = scan_of(near, np.array([0.2, 0.1, 0.02]), 5)
    found = merged.align(scan, np.array([0.5, 0.15, 0.0]), np.array([0.1, 0.1, 0.05]))
    assert found.pose[0] == pytest.approx(0.5, abs=0.02)
    assert found.pose[1:] == pytest.approx([0.1, 0.02], abs=0.01)
    assert found.complexity < 0.05
    sigmas = np.sqrt(np.diag(np.linalg.inv(found.information + 1e-6 * np.eye(3))))
    assert sigmas[0] > 5.0 * sigmas[1]
    searched = merged.search(scan, np.zeros((0, 2)), np.array([0.5, 0.15, 0.0]), Window(reach_m=3.0, reach_rad=0.1))
    assert searched is not None
    assert searched.spread[0, 0] > 0.5**2
    assert searched.spread[1, 1] < 0.2**2


def test_two_maps_of_the_same_scans_give_the_same_bytes() -> None:
    scan, guess = scan_of(scene(ROOM), np.array([4.4, 3.4, 0.5]), 7), np.array([4.0, 3.0, 0.4])
    window = Window(reach_m=1.0, reach_rad=0.3)
    poses = [merged_room().search(scan, np.zeros((0, 2)), guess, window) for _ in range(2)]
    assert poses[0] is not None
    assert poses[1] is not None
    assert poses[0].pose.tobytes() == poses[1].pose.tobytes()
