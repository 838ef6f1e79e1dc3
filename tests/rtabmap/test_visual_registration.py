# SPDX-License-Identifier: MIT
"""Registration by features: right motions, honest covariances, and sentences where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from visual_worlds import CAMERA, T_BASE_CAMERA, error, motion, signature, world

from slamcli.rtabmap import two_frame_adjustment
from slamcli.rtabmap.depth_agreement import depth_agreement
from slamcli.rtabmap.parameters import RegGroup, VisGroup
from slamcli.rtabmap.registration import Registration, flat_motion, inverted, refused
from slamcli.rtabmap.signature import no_features
from slamcli.rtabmap.visual_registration import inliers_distribution, register_best, register_visual
from slamcli.rtabmap.visual_settings import VisualSettings, visual_settings

TRUTH = motion(0.5, 0.3, 0.05, (0.05, 0.02, 0.3))


def pair(seed=0, *, noise_px=0.5, flips=0.08, truth=TRUTH, unknown=0.1):
    points, descriptors = world(seed)
    rng = np.random.default_rng(100 + seed)
    noise = {"rng": rng, "noise_px": noise_px, "flips": flips, "unknown": unknown}
    return signature(1, np.eye(4), points, descriptors, **noise), signature(2, truth, points, descriptors, **noise)


def register(a, b, seed=0, guess=None, **settings):
    return register_visual(a, b, CAMERA, T_BASE_CAMERA, VisualSettings(**settings), seed=seed, guess=guess)


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_each_estimation_type_finds_the_motion(kind):
    a, b = pair(noise_px=0.1)
    found = register(a, b, estimation_type=kind)
    assert found.T_a_b is not None, found.reason
    assert np.abs(error(found.T_a_b, TRUTH)).max() < 0.01
    assert found.num_inliers == len(found.matches) > 100
    assert found.reason == ""


def nees(found, truth):
    wrong = error(found.T_a_b, truth)
    return wrong @ np.linalg.solve(found.covariance, wrong) / 6


def test_covariance_is_that_of_the_pixels_if_nothing_else_is_wrong(monkeypatch):
    monkeypatch.setattr(two_frame_adjustment, "SYSTEMATIC", 0.0)
    values = [nees(register(*pair(seed, noise_px=0.8)), TRUTH) for seed in range(30)]
    # 1 for honest ones; they are wider, as matches in one cell of the image are believed no more than one of them.
    assert 0.15 < np.mean(values) < 1.0


def test_covariance_holds_what_all_matches_have_wrong():
    values = []
    for seed in range(20):
        a, b = pair(seed, noise_px=0.8)
        longer = [replace(one, features=wider(one.features)) for one in (a, b)]  # a focal length that is wrong by 1 %
        values.append(nees(register(*longer), TRUTH))
    assert 0.02 < np.mean(values) < 1.5


def wider(features):
    centre = np.array([CAMERA.cx, CAMERA.cy])
    shift = 0.01 * (features.pixels - centre)
    return replace(features, pixels=features.pixels + shift, right=features.right + shift[:, 0])


def test_what_few_cells_tell_alone_is_not_believed():
    even = np.tile(np.diag([100.0, 100, 100, 400, 400, 400]), (30, 1, 1))
    assert np.allclose(np.diag(two_frame_adjustment._trusted(even, 1.0)), 1 / (30 * np.array([100] * 3 + [400] * 3)))
    few = even.copy()
    few[:-3, 5, 5] = 0.01  # a line: only three cells tell of the turn around it
    sigmas = np.sqrt(np.diag(two_frame_adjustment._trusted(few, 1.0)))
    assert sigmas[5] > 20 * sigmas[4]


def test_covariance_without_bundle_adjustment_is_that_of_a_point():
    a, b = pair(noise_px=0.3)
    alone, together = register(a, b, bundle_adjustment=0), register(a, b)
    assert np.allclose(alone.covariance, np.diag(np.diag(alone.covariance)))
    assert alone.covariance[0, 0] > 5 * together.covariance[0, 0]
    coarse = register(a, b, bundle_adjustment=0, pnp_variance_median_ratio=2)
    assert coarse.covariance[0, 0] > alone.covariance[0, 0]


def test_moving_both_places_changes_nothing():
    elsewhere = motion(3.0, -2.0, 0.5, (0.1, -0.2, 2.0))
    points, descriptors = world(3)
    moved = points @ elsewhere[:3, :3].T + elsewhere[:3, 3]
    found = []
    for T, cloud in ((np.eye(4), points), (elsewhere, moved)):
        rng = np.random.default_rng(5)
        a = signature(1, T, cloud, descriptors, rng=rng, noise_px=0.0)
        b = signature(2, T @ TRUTH, cloud, descriptors, rng=rng, noise_px=0.0)
        found.append(register(a, b).T_a_b)
    assert np.allclose(found[0], found[1], atol=1e-6)
    assert np.allclose(found[0], TRUTH, atol=1e-6)


def test_wide_changes_that_blur_descriptors_are_bridged_by_searching_again():
    once = again = 0
    for seed in range(5):
        a, b = pair(seed, flips=0.24, noise_px=0.3)
        once += register(a, b, repeat_once=False).T_a_b is not None
        found = register(a, b)
        again += found.T_a_b is not None and np.abs(error(found.T_a_b, TRUTH)).max() < 0.02
    assert once < again == 5


def test_a_guess_is_where_matches_are_sought():
    a, b = pair()
    near = register(a, b, guess=TRUTH @ motion(0.02, 0.01))
    assert near.T_a_b is not None
    assert np.abs(error(near.T_a_b, TRUTH)).max() < 0.02
    far = register(a, b, guess=TRUTH @ motion(rotvec=(0, 0, 0.5)))
    assert far.T_a_b is None
    assert "fewer than" in far.reason
    assert register(a, b, guess=TRUTH @ motion(rotvec=(0, 0, 0.5)), cor_guess_win_size=0).T_a_b is not None


def test_other_places_are_refused_with_a_sentence():
    a, _ = pair(0)
    _, b = pair(1)
    found = register(a, b)
    assert found.T_a_b is None
    assert "features" in found.reason
    assert found.covariance[0, 0] > 1000
    empty = replace(b, features=no_features(), points=np.zeros((0, 3)))
    assert register(a, empty).reason == "node 2 has no features"
    assert register(empty, a).reason == "node 2 has no features"
    blind = replace(a, points=np.full_like(a.points, np.nan))
    assert "whose depth is known" in register(blind, b).reason


@pytest.mark.parametrize(
    ("setting", "word"),
    [
        ({"mean_inliers_distance": 1.0}, "away on average"),
        ({"min_inliers_distribution": 0.5}, "spread"),
        ({"pnp_max_variance": 1e-9}, "lie apart"),
        ({"min_inliers": 400}, "fewer than 400"),
    ],
)
def test_limits_refuse(setting, word):
    a, b = pair()
    found = register(a, b, **setting)
    assert found.T_a_b is None
    assert word in found.reason


def test_same_seed_same_bytes():
    a, b = pair()
    assert register(a, b, seed=4).T_a_b.tobytes() == register(a, b, seed=4).T_a_b.tobytes()


def test_the_neighbour_with_most_inliers_wins():
    points, descriptors = world(2)
    rng = np.random.default_rng(1)
    far = signature(1, motion(-1.0, 0.0, 0.0, (0, 0, 0.9)), points, descriptors, rng=rng, noise_px=0.3)
    near = signature(2, motion(0.4, 0.3, 0.0, (0, 0, 0.25)), points, descriptors, rng=rng, noise_px=0.3)
    b = signature(3, TRUTH, points, descriptors, rng=rng, noise_px=0.3)
    best, found = register_best([far, near], b, CAMERA, T_BASE_CAMERA, VisualSettings(), seed=0)
    assert best == 2
    assert found.num_inliers > register_visual(far, b, CAMERA, T_BASE_CAMERA, VisualSettings(), seed=0).num_inliers


def test_flat_motion_keeps_place_and_heading():
    flat = flat_motion(motion(1.0, 2.0, 3.0, (0.0, 0.0, 0.7)))
    assert np.allclose(flat, motion(1.0, 2.0, 0.0, (0.0, 0.0, 0.7)))
    a, b = pair()
    assert register(a, b, force_3dof=True).T_a_b[2, 3] == 0.0


def test_distribution_is_the_smaller_variance_over_the_image():
    grid = np.stack(np.meshgrid(np.linspace(0, 640, 101), np.linspace(0, 480, 101)), axis=-1).reshape(-1, 2)
    assert inliers_distribution(grid, CAMERA) == pytest.approx(1 / 12, rel=0.03)
    assert inliers_distribution(grid * (1, 0), CAMERA) == pytest.approx(0.0, abs=1e-12)


def test_settings_are_the_parameters():
    assert visual_settings(VisGroup(), RegGroup()) == VisualSettings()
    told = visual_settings(VisGroup(min_inliers=7, cor_nndr=0.6), RegGroup(force_3dof=True, repeat_once=False))
    assert told == VisualSettings(min_inliers=7, cor_nndr=0.6, force_3dof=True, repeat_once=False)


def test_a_motion_that_surfaces_contradict_is_refused():
    a, b = pair(noise_px=0.1, unknown=0.0)
    right = depth_agreement(a, b, CAMERA, T_BASE_CAMERA, TRUTH)
    assert right > 0.75
    assert depth_agreement(a, b, CAMERA, T_BASE_CAMERA, TRUTH @ motion(0.7)) < right - 0.1
    assert np.isnan(depth_agreement(a, replace(b, points=np.full_like(b.points, np.nan)), CAMERA, T_BASE_CAMERA, TRUTH))
    # What is matched agrees, all the rest is a metre off.
    moved = b.points.copy()
    found = register(a, b)
    rest = np.setdiff1d(np.arange(len(moved)), found.matches[:40, 1])
    moved[rest, 0] += 5.0
    bits = b.features.descriptors.copy()
    bits[rest] = np.random.default_rng(0).integers(0, 256, (len(rest), 32), dtype=np.uint8)
    other = register(a, replace(b, points=moved, features=replace(b.features, descriptors=bits)))
    assert other.T_a_b is None
    assert "have the same depth" in other.reason


def test_inverse_registrations_carry_their_covariance():
    rng = np.random.default_rng(0)
    root = 0.01 * rng.normal(size=(6, 6))
    found = Registration(
        T_a_b=TRUTH, covariance=root @ root.T, num_matches=9, num_inliers=3, matches=np.array([[1, 2], [3, 4], [5, 6]])
    )
    back = inverted(found)
    assert np.allclose(back.T_a_b, np.linalg.inv(TRUTH))
    assert back.matches.tolist() == [[2, 1], [4, 3], [6, 5]]
    assert np.allclose(inverted(back).covariance, found.covariance)
    steps = rng.normal(size=(4000, 6)) @ root.T
    moved = [np.linalg.inv(motion(*(TRUTH[:3, 3] + s[:3]), (0, 0, 0)) @ turned(s[3:])) for s in steps]
    seen = np.cov(np.array([error(T, back.T_a_b) for T in moved]).T)
    assert np.abs(seen - back.covariance).max() < 0.1 * np.abs(back.covariance).max()
    assert inverted(refused("none")).reason == "none"


def turned(vector):
    T = motion(rotvec=tuple(vector))
    T[:3, :3] = T[:3, :3] @ TRUTH[:3, :3]
    return T


def test_the_other_way_round_and_from_a_guess():
    a, b = pair()
    best, found = register_best(
        [a], b, CAMERA, T_BASE_CAMERA, VisualSettings(), seed=0, inversely=True, guess=TRUTH @ motion(0.02)
    )
    assert best == 1
    assert np.abs(error(found.T_a_b, TRUTH)).max() < 0.02
    assert np.isfinite(a.points[found.matches[:, 0], 0]).any()
    assert (found.matches.max(axis=0) < (len(a.features), len(b.features))).all()
    _, far = register_best([a], b, CAMERA, T_BASE_CAMERA, VisualSettings(), seed=0, guess=TRUTH @ motion(0, 2.0))
    assert far.T_a_b is None
