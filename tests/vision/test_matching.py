# SPDX-License-Identifier: MIT
"""Searches for matching key points against naive twins."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _matching_kernels as kernels
from slamcli.vision.features import Features
from slamcli.vision.matching import (
    best_descriptor,
    best_descriptors,
    feature_grid,
    hamming,
    match_brute_force,
    match_by_words,
    match_epipolar,
    match_window,
    search_by_projection,
)
from slamcli.vision.pinhole import Pinhole

pytestmark = pytest.mark.kernels

CAMERA = Pinhole(fx=100.0, fy=110.0, cx=79.0, cy=61.0, width=160, height=120, baseline_m=0.1)


def random_features(number: int, rng: np.random.Generator, kinds: int = 12) -> Features:
    """Key points whose descriptors are `kinds` patterns, each with a few bits changed."""
    patterns = rng.integers(0, 256, (kinds, 32), dtype=np.uint8)
    flips = np.packbits(rng.random((number, 256)) < 0.06, axis=1)
    octaves = rng.integers(0, 3, number)
    pixels = rng.uniform(0.0, 1.0, (number, 2)) * [164.0, 124.0] - 2.0
    return Features(
        pixels=pixels,
        octaves=octaves,
        angles=rng.uniform(0.0, 2.0 * np.pi, number),
        responses=np.ones(number),
        descriptors=patterns[rng.integers(0, kinds, number)] ^ flips,
        sigmas=1.2**octaves,
        right=np.where(rng.random(number) < 0.5, pixels[:, 0] - 5.0, np.nan),
        depth=np.where(rng.random(number) < 0.5, 2.0, np.nan),
        raw_pixels=pixels,
    )


def naive_distances(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[Any]:
    return np.unpackbits(a[:, None] ^ b[None], axis=2).sum(axis=2).astype(np.int64)


def naive_choice(
    distances: NDArray[Any], allowed: NDArray[Any], limit: int, ratio: float, octaves: NDArray[Any] | None = None
) -> NDArray[np.int64]:
    """The best allowed column of each row, then each column to its nearest row."""
    best = np.full(len(distances), -1)
    reach = np.full(len(distances), 999)
    for a, row in enumerate(distances):
        order = sorted(np.flatnonzero(allowed[a]).tolist(), key=lambda b, row=row: row[b])
        if not order or row[order[0]] > limit:
            continue
        rival = len(order) > 1 and (octaves is None or octaves[order[0]] == octaves[order[1]])
        if rival and row[order[0]] > ratio * row[order[1]]:
            continue
        best[a], reach[a] = order[0], row[order[0]]
    for b in set(best[best >= 0].tolist()):
        claims = np.flatnonzero(best == b)
        best[np.delete(claims, np.argmin(reach[claims]))] = -1
    return best


def naive_turns(best: NDArray[Any], angles_a: NDArray[Any], angles_b: NDArray[Any]) -> NDArray[Any]:
    matched = np.flatnonzero(best >= 0)
    bins = ((angles_a[matched] - angles_b[best[matched]]) % (2.0 * np.pi) / (2.0 * np.pi) * 30).astype(int)
    counts = np.bincount(bins, minlength=30)
    common = [b for b in np.argsort(-counts, kind="stable")[:3] if counts[b] * 10 >= counts.max()]
    kept = best.copy()
    kept[matched[~np.isin(bins, common)]] = -1
    return kept


def test_hamming_counts_bits() -> None:
    a, b = np.zeros(32, np.uint8), np.full(32, 255, np.uint8)
    assert hamming(a, b) == 256
    assert hamming(a, a) == 0
    rng = np.random.default_rng(0)
    pairs = rng.integers(0, 256, (2, 20, 32), dtype=np.uint8)
    pairs[0, 0], pairs[1, 0] = a, b
    expected = np.diag(naive_distances(*pairs))
    assert [hamming(x, y) for x, y in zip(*pairs, strict=True)] == expected.tolist()
    words = pairs.view(np.uint64)
    assert [kernels.distance(x, y) for x, y in zip(*words, strict=True)] == expected.tolist()


def test_the_grid_holds_every_feature_once() -> None:
    features = random_features(80, np.random.default_rng(1))
    grid = feature_grid(features, CAMERA)
    assert grid.starts[0] == 0
    assert grid.starts[-1] == 80
    assert sorted(grid.members.tolist()) == list(range(80))
    for i in range(80):
        x, y = np.clip((features.pixels[i] / [160.0, 120.0] * [64, 48]).astype(int), 0, [63, 47])
        cell = y * 64 + x
        assert i in grid.members[grid.starts[cell] : grid.starts[cell + 1]]


@pytest.mark.parametrize(
    ("ratio", "with_right", "with_angles"), [(1.0, False, False), (0.8, True, False), (0.9, False, True)]
)
def test_search_by_projection_equals_its_naive_twin(ratio: float, with_right: bool, with_angles: bool) -> None:
    rng = np.random.default_rng(2)
    features = random_features(70, rng)
    queries = random_features(60, rng)
    descriptors = features.descriptors[rng.integers(0, 70, 60)] ^ np.packbits(rng.random((60, 256)) < 0.05, axis=1)
    predicted = queries.pixels.copy()
    predicted[3] = np.nan
    predicted[4] = [1e9, 5.0]
    radius = rng.uniform(3.0, 45.0, 60)
    low, high = rng.integers(0, 2, 60), rng.integers(1, 3, 60)
    free = rng.random(70) < 0.8
    expected_right = predicted[:, 0] - 5.0
    off = np.abs(features.pixels[None] - predicted[:, None])
    allowed = (off <= radius[:, None, None]).all(axis=2) & free
    allowed &= (features.octaves >= low[:, None]) & (features.octaves <= high[:, None])
    if with_right:
        allowed &= ~(np.abs(features.right - expected_right[:, None]) > radius[:, None])
    expected = naive_choice(naive_distances(descriptors, features.descriptors), allowed, 90, ratio, features.octaves)
    if with_angles:
        expected = naive_turns(expected, queries.angles, features.angles)
    found = search_by_projection(
        predicted,
        radius,
        low,
        high,
        descriptors,
        features,
        feature_grid(features, CAMERA),
        free,
        predicted_right=expected_right if with_right else None,
        max_distance=90,
        ratio=ratio,
        angles=queries.angles if with_angles else None,
    )
    np.testing.assert_array_equal(found, expected)
    assert (found >= 0).sum() > 4


def test_nothing_to_search_gives_nothing() -> None:
    rng = np.random.default_rng(3)
    none, some = random_features(0, rng), random_features(3, rng)
    free = np.ones(0, bool)
    found = search_by_projection(
        some.pixels,
        np.full(3, 9.0),
        some.octaves,
        some.octaves,
        some.descriptors,
        none,
        feature_grid(none, CAMERA),
        free,
    )
    assert found.tolist() == [-1, -1, -1]
    assert match_brute_force(some.descriptors, none.descriptors, max_distance=256, ratio=1.0).tolist() == [-1, -1, -1]
    assert len(match_brute_force(none.descriptors, some.descriptors, max_distance=256, ratio=1.0)) == 0
    nodes = np.zeros(3, np.int64)
    assert match_by_words(
        some.descriptors, nodes, none.descriptors, nodes[:0], max_distance=256, ratio=1.0
    ).tolist() == [-1, -1, -1]
    T_b_a = np.eye(4)
    T_b_a[0, 3] = 1.0
    assert match_epipolar(some, np.ones(3, bool), None, none, free, None, T_b_a, CAMERA).tolist() == [-1, -1, -1]
    assert len(match_window(none, none.pixels, some, feature_grid(some, CAMERA))) == 0


@pytest.mark.parametrize("mutual", [True, False])
@pytest.mark.parametrize("ratio", [0.7, 1.0])
def test_brute_force_equals_its_naive_twin(mutual: bool, ratio: float) -> None:
    rng = np.random.default_rng(4)
    patterns = random_features(40, rng, kinds=40)
    a = patterns.descriptors[rng.integers(0, 40, 30)] ^ np.packbits(rng.random((30, 256)) < 0.1, axis=1)
    b = patterns.descriptors
    distances = naive_distances(a, b)
    expected = naive_choice(distances, np.ones(distances.shape, bool), 70, ratio)
    if mutual:
        back = distances.argmin(axis=0)
        expected = np.array([b if b >= 0 and back[b] == i else -1 for i, b in enumerate(expected)])
    found = match_brute_force(a, b, max_distance=70, ratio=ratio, mutual=mutual)
    np.testing.assert_array_equal(found, expected)
    assert (found >= 0).sum() > 10


def test_matches_by_words_equal_their_naive_twin() -> None:
    rng = np.random.default_rng(5)
    a, b = random_features(50, rng, kinds=6), random_features(60, rng, kinds=6)
    b = replace(
        b, descriptors=a.descriptors[rng.integers(0, 50, 60)] ^ np.packbits(rng.random((60, 256)) < 0.1, axis=1)
    )
    nodes_a, nodes_b = rng.integers(-1, 4, 50), rng.integers(-1, 4, 60)
    free_a, free_b = rng.random(50) < 0.8, rng.random(60) < 0.8
    allowed = (nodes_a[:, None] == nodes_b) & (nodes_a[:, None] >= 0) & free_a[:, None] & free_b
    distances = naive_distances(a.descriptors, b.descriptors)
    keys: dict[str, Any] = {"max_distance": 100, "ratio": 0.95, "free_a": free_a, "free_b": free_b}
    found = match_by_words(a.descriptors, nodes_a, b.descriptors, nodes_b, **keys)
    expected = naive_choice(distances, allowed, 100, 0.95)
    np.testing.assert_array_equal(found, expected)
    assert (found >= 0).sum() > 8
    turned = match_by_words(
        a.descriptors, nodes_a, b.descriptors, nodes_b, angles_a=a.angles, angles_b=b.angles, **keys
    )
    np.testing.assert_array_equal(turned, naive_turns(expected, a.angles, b.angles))


@pytest.mark.parametrize("motion", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.01), (0.1, -0.2, 1.0), (0.5, 0.5, 0.0)])
def test_epipolar_matches_equal_their_naive_twin(motion: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(6)
    a = random_features(60, rng)
    b = random_features(70, rng)
    b = replace(
        b, descriptors=a.descriptors[rng.integers(0, 60, 70)] ^ np.packbits(rng.random((70, 256)) < 0.04, axis=1)
    )
    T_b_a = np.eye(4)
    T_b_a[:3, 3] = motion
    free_a, free_b = rng.random(60) < 0.9, rng.random(70) < 0.9
    # Two points of each ray, seen from b, span its line.
    rays = CAMERA.back_project(a.pixels, np.ones(60))
    one, two = (np.column_stack([rays * far + motion]) @ CAMERA.matrix.T for far in (3.0, 30.0))
    lines = np.cross(one, two)
    off = np.abs(lines @ np.column_stack([b.pixels, np.ones(70)]).T) / np.hypot(lines[:, 0], lines[:, 1])[:, None]
    allowed = (off <= np.sqrt(3.84) * b.sigmas) & free_a[:, None] & free_b
    if motion[2] != 0.0:
        epipole = (CAMERA.matrix @ motion / motion[2])[:2]
        near = ((b.pixels - epipole) ** 2).sum(axis=1) < 100.0 * b.sigmas
        allowed &= ~near | np.isfinite(b.depth) | np.isfinite(a.depth)[:, None]
    distances = naive_distances(a.descriptors, b.descriptors)
    expected = naive_choice(distances, allowed, 100, 1.0)
    found = match_epipolar(a, free_a, None, b, free_b, None, T_b_a, CAMERA, max_distance=100)
    # The order of candidates of equal distance differs between the cells and the twin.
    same_distance = distances[np.arange(60), found] == distances[np.arange(60), expected]
    assert ((found == expected) | ((found >= 0) & (expected >= 0) & same_distance)).all()
    assert (found >= 0).sum() > 4
    nodes_a, nodes_b = rng.integers(0, 2, 60), rng.integers(0, 2, 70)
    expected = naive_choice(distances, allowed & (nodes_a[:, None] == nodes_b), 100, 1.0)
    found = match_epipolar(a, free_a, nodes_a, b, free_b, nodes_b, T_b_a, CAMERA, max_distance=100)
    np.testing.assert_array_equal(found, expected)


def test_without_motion_there_is_no_epipolar_line() -> None:
    a = random_features(10, np.random.default_rng(7))
    free = np.ones(10, bool)
    assert match_epipolar(a, free, None, a, free, None, np.eye(4), CAMERA).tolist() == [-1] * 10


def test_the_window_search_finds_shifted_features_of_the_finest_octave() -> None:
    rng = np.random.default_rng(8)
    a = random_features(40, rng, kinds=40)
    b = replace(a, pixels=a.pixels + np.array([6.0, -4.0]), angles=(a.angles + 0.3) % (2.0 * np.pi))
    found = match_window(a, a.pixels, b, feature_grid(b, CAMERA), radius=10.0)
    finest = a.octaves == 0
    assert (found[~finest] == -1).all()
    right = found[finest] == np.flatnonzero(finest)
    assert right.mean() > 0.7
    assert (found[finest][~right] == -1).all()
    assert (match_window(a, a.pixels, b, feature_grid(b, CAMERA), radius=3.0) == -1).all()


def test_matches_must_agree_on_the_turn() -> None:
    best = np.arange(20)
    angles_a = np.full(20, 1.0)
    angles_b = np.full(20, 0.9)
    angles_b[7], angles_b[9] = 4.0, np.nan
    kernels.agree_on_rotation(best, angles_a, angles_b, 30)
    assert np.flatnonzero(best < 0).tolist() == [7]


def test_the_best_descriptor_has_the_least_median_distance() -> None:
    rng = np.random.default_rng(9)
    pattern = rng.integers(0, 256, 32, dtype=np.uint8)
    rows = pattern ^ np.packbits(rng.random((7, 256)) < np.array([0.3, 0.2, 0.02, 0.2, 0.3, 0.1, 0.4])[:, None], axis=1)
    medians = [sorted(row)[3] for row in naive_distances(rows, rows).tolist()]
    assert best_descriptor(rows) == int(np.argmin(medians)) == 2
    both = best_descriptors(np.concatenate([rows[:1], rows, rows[:2]]), np.array([0, 1, 1, 8, 10]))
    assert both.tolist() == [0, -1, 3, 8]
    with pytest.raises(DataError, match="no descriptor"):
        best_descriptor(rows[:0])
    with pytest.raises(DataError, match="uint8"):
        match_brute_force(rows[:, :16], rows, max_distance=5, ratio=1.0)
