# SPDX-License-Identifier: MIT
"""Alignment of clouds in space: exact rooms, noise, trimming, constraints, covariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.registration.cloud_icp import CloudIcpSettings, Method, align_clouds, prepare_cloud

Floats = NDArray[np.float64]
SETTINGS = CloudIcpSettings(voxel_m=0.15, max_distance_m=0.6, neighbours=12)


def room(rng: np.random.Generator, count: int = 700, noise_m: float = 0.005) -> Floats:
    """Points on the six sides of a room of 6 x 4 x 3 m and on a table in it."""
    sides = []
    for axis in range(3):
        for end in (0.0, 1.0):
            points = rng.uniform(0.0, 1.0, (count, 3)) * [6.0, 4.0, 3.0]
            points[:, axis] = end * [6.0, 4.0, 3.0][axis]
            sides.append(points)
    table = rng.uniform(0.0, 1.0, (count // 2, 3)) * [1.5, 1.0, 0.0] + [3.5, 1.0, 1.0]
    return np.vstack([*sides, table]) - [2.5, 1.8, 1.2] + rng.normal(0.0, noise_m, (6 * count + count // 2, 3))


def moved(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> Floats:
    rotation = Rotation.from_rotvec([roll, pitch, yaw]).as_matrix()
    return se3.from_rotation_translation(rotation, np.array([x, y, z]))


def pair(T: Floats, seed: int = 1, noise_m: float = 0.005) -> tuple[Floats, Floats]:
    """A cloud, and another of the same room as it is seen from T."""
    rng = np.random.default_rng(seed)
    target, source = room(rng, noise_m=noise_m), room(rng, noise_m=noise_m)
    inverse = se3.inverse(T)
    return target, source @ inverse[:3, :3].T + inverse[:3, 3]


@pytest.mark.parametrize(("method", "bound_m"), [("plane", 0.003), ("gicp", 0.003), ("point", 0.01)])
def test_a_room_seen_again_is_found_in_itself(method: Method, bound_m: float) -> None:
    T = moved(0.25, -0.15, 0.08, 0.02, -0.03, 0.1)
    found = align_clouds(*pair(T), np.eye(4), replace(SETTINGS, method=method, iterations=60))
    assert np.linalg.norm(found.T_target_source[:3, 3] - T[:3, 3]) < bound_m
    assert np.abs(found.T_target_source[:3, :3] - T[:3, :3]).max() < bound_m
    assert found.inlier_ratio > 0.99
    assert np.allclose(found.T_target_source[:3, :3] @ found.T_target_source[:3, :3].T, np.eye(3), atol=1e-12)


def test_two_runs_give_the_same_bytes() -> None:
    clouds = pair(moved(0.2, 0.1, 0.0, 0.0, 0.0, 0.05))
    first, second = (align_clouds(*clouds, np.eye(4), SETTINGS) for _ in range(2))
    assert first.T_target_source.tobytes() == second.T_target_source.tobytes()
    assert first.covariance.tobytes() == second.covariance.tobytes()


def test_trimming_leaves_out_what_stands_in_the_room_now() -> None:
    T = moved(0.1, 0.05, 0.0, 0.0, 0.0, 0.03)
    target, source = pair(T)
    rng = np.random.default_rng(3)
    shadow = target[np.abs(target[:, 1] - 2.2) < 0.05] + [0.0, -0.4, 0.0]  # someone holds a screen before a wall
    source = np.vstack([source, shadow[: len(shadow) * 3 // 4] + rng.normal(0.0, 0.005, (len(shadow) * 3 // 4, 3))])
    plain, trimmed = (
        align_clouds(target, source, np.eye(4), replace(SETTINGS, trimmed=share)) for share in (1.0, 0.85)
    )
    errors = [float(np.linalg.norm(found.T_target_source[:3, 3] - T[:3, 3])) for found in (plain, trimmed)]
    assert errors[1] < 0.005
    assert errors[1] < 0.5 * errors[0]


def test_fewer_degrees_of_freedom_keep_the_rest_of_the_guess() -> None:
    T = moved(0.2, -0.1, 0.05, 0.02, 0.015, 0.08)
    guess = moved(0.0, 0.0, 0.0, 0.02, 0.015, 0.0)
    level = align_clouds(*pair(T), guess, replace(SETTINGS, level=True)).T_target_source
    assert level[2, :3] == pytest.approx(guess[2, :3], abs=2e-3)
    assert level[:3, 3] == pytest.approx(T[:3, 3], abs=0.01)
    planar = align_clouds(*pair(moved(0.2, -0.1, 0.0, 0.0, 0.0, 0.08)), np.eye(4), replace(SETTINGS, planar=True))
    assert planar.T_target_source[2] == pytest.approx([0.0, 0.0, 1.0, 0.0], abs=1e-12)
    assert planar.T_target_source[:2, 3] == pytest.approx([0.2, -0.1], abs=0.005)


def tube(rng: np.random.Generator, count: int = 1500) -> Floats:
    """A corridor without ends: two walls and a floor."""
    x = rng.uniform(-15.0, 15.0, (3, count))
    left = np.column_stack([x[0], np.full(count, 1.0), rng.uniform(0.0, 2.5, count)])
    right = np.column_stack([x[1], np.full(count, -1.0), rng.uniform(0.0, 2.5, count)])
    floor = np.column_stack([x[2], rng.uniform(-1.0, 1.0, count), np.zeros(count)])
    return np.vstack([left, right, floor]) + rng.normal(0.0, 0.005, (3 * count, 3))


def test_along_a_corridor_only_the_sure_axes_are_corrected() -> None:
    rng = np.random.default_rng(5)
    target, source = tube(rng), tube(rng) - [0.0, 0.1, 0.05]
    settings = replace(SETTINGS, min_complexity=0.05, sure_axes_only=True)
    guess = moved(0.4, 0.0, 0.0, 0.0, 0.0, 0.0)
    found = align_clouds(target, source, guess, settings)
    assert found.complexity < 0.05
    assert found.T_target_source[:3, 3] == pytest.approx([0.4, 0.1, 0.05], abs=0.01)
    sigmas = np.sqrt(np.diag(found.covariance))
    assert sigmas[0] > 0.9
    assert sigmas[1] < 0.01
    assert prepare_cloud(pair(np.eye(4))[0], SETTINGS).complexity > 0.4


def test_covariances_tell_how_far_off_alignments_are() -> None:
    T = moved(0.05, 0.02, 0.0, 0.0, 0.0, 0.02)
    errors, sigmas = [], []
    for seed in range(12):
        found = align_clouds(*pair(T, seed, noise_m=0.02), np.eye(4), SETTINGS)
        errors.append(found.T_target_source[:3, 3] - T[:3, 3])
        sigmas.append(np.sqrt(np.diag(found.covariance)[:3]))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(sigmas, axis=0)
    assert (ratio > 0.4).all()
    assert (ratio < 5.0).all()


def test_options_of_thinning_and_matching() -> None:
    target, source = pair(moved(0.05, 0.0, 0.0, 0.0, 0.0, 0.0))
    whole = prepare_cloud(target, replace(SETTINGS, filters=0), side=1)
    assert len(whole) == len(target)
    assert len(prepare_cloud(target, replace(SETTINGS, step=4, voxel_m=0.0), side=1)) == -(-len(target) // 4)
    assert len(prepare_cloud(target, SETTINGS, side=1)) < 0.7 * len(target)
    near = align_clouds(target, source, np.eye(4), replace(SETTINGS, radius_m=0.4, inlier_m=0.05, reciprocal=True))
    assert near.num_inliers < near.num_points
    assert near.T_target_source[0, 3] == pytest.approx(0.05, abs=0.005)


def test_a_cloud_of_a_few_points_is_refused() -> None:
    with pytest.raises(EstimationError, match="a cloud of 3 points cannot be aligned"):
        align_clouds(np.eye(3), room(np.random.default_rng(0)), np.eye(4), SETTINGS)


def test_clouds_far_apart_have_no_inliers() -> None:
    target, source = pair(np.eye(4))
    found = align_clouds(target, source + 100.0, np.eye(4), SETTINGS)
    assert (found.num_inliers, found.converged) == (0, False)
