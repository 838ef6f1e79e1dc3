# SPDX-License-Identifier: MIT
"""GFTT corners, their descriptors, OpenCV's ORB, and square covering."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.vision.corner_description import OpenCvOrbSettings, described_corners, extract_opencv_orb
from slamcli.vision.gftt import GfttSettings, find_corners, refine_corners
from slamcli.vision.matching import match_brute_force
from slamcli.vision.orb import describe_at
from slamcli.vision.square_covering import spread_evenly


def squares() -> np.ndarray:
    image = np.full((160, 200), 40, dtype=np.uint8)
    rng = np.random.default_rng(3)
    for row in range(30, 130, 25):
        for column in range(30, 170, 25):
            image[row : row + 12, column : column + 12] = rng.integers(90, 250)
    return image


def test_corners_come_strongest_first_and_apart() -> None:
    pixels, strengths = find_corners(squares(), GfttSettings(min_distance=7.0), most=50)
    assert len(pixels) == 50
    assert (np.diff(strengths) <= 0).all()
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)[np.triu_indices(50, 1)]
    assert apart.min() >= 7.0


def test_excluded_pixels_have_no_corners() -> None:
    excluded = np.zeros((160, 200), dtype=np.bool_)
    excluded[:, :100] = True
    pixels, _ = find_corners(squares(), GfttSettings(), excluded=excluded)
    assert len(pixels) > 10
    assert pixels[:, 0].min() >= 100


def test_an_even_image_has_none() -> None:
    pixels, strengths = find_corners(np.full((50, 50), 9, dtype=np.uint8), GfttSettings())
    assert pixels.shape == (0, 2)
    assert strengths.shape == (0,)


def test_corners_are_refined_to_parts_of_a_pixel() -> None:
    at = refine_corners(squares(), np.array([[31.0, 31.0]]), half_window=3, iterations=20, epsilon=0.01)
    np.testing.assert_allclose(at, [[29.5, 29.5]], atol=0.3)
    np.testing.assert_array_equal(refine_corners(squares(), at, half_window=3, iterations=0, epsilon=0.01), at)


def test_descriptors_are_found_again_in_a_shifted_image() -> None:
    rng = np.random.default_rng(4)
    image = np.asarray(rng.integers(0, 256, (120, 160)), dtype=np.uint8)
    pixels, strengths = find_corners(image, GfttSettings(), most=60)
    one = described_corners(image, pixels, strengths, angle_rad=None)
    two = described_corners(np.roll(image, 5, axis=1), pixels + np.array([5.0, 0.0]), strengths, angle_rad=None)
    matched = match_brute_force(one.descriptors, two.descriptors, max_distance=20, ratio=0.8)
    hits = np.flatnonzero(matched >= 0)
    assert len(hits) > 0.8 * len(one)
    np.testing.assert_allclose(two.pixels[matched[hits]] - one.pixels[hits], np.tile([5.0, 0.0], (len(hits), 1)))


def test_upright_descriptors_have_no_angle() -> None:
    angles, descriptors = describe_at(squares(), np.array([[60, 60]]), angle_rad=0.0)
    turned, others = describe_at(squares(), np.array([[60, 60]]))
    assert angles[0] == 0.0
    assert turned[0] != 0.0
    assert (descriptors != others).any()


def test_opencvs_orb_gives_octaves_and_sigmas() -> None:
    rng = np.random.default_rng(5)
    image = np.asarray(rng.integers(0, 256, (200, 200)), dtype=np.uint8)
    features = extract_opencv_orb(image, OpenCvOrbSettings(num_features=100))
    assert 50 < len(features) <= 100
    np.testing.assert_allclose(features.sigmas, 2.0**features.octaves)
    assert len(extract_opencv_orb(np.zeros((60, 60), dtype=np.uint8), OpenCvOrbSettings())) == 0


def test_square_covering_spreads_and_keeps_the_strongest() -> None:
    rng = np.random.default_rng(6)
    pixels = np.concatenate([rng.uniform(0, 40, (300, 2)), rng.uniform(0, 400, (100, 2))])
    kept = spread_evenly(pixels, 60, 400, 400)
    assert len(kept) <= 60
    assert len(kept) >= 50
    assert kept[0] == 0
    assert (pixels[kept] > 40).any(axis=1).mean() > 0.6
    np.testing.assert_array_equal(spread_evenly(pixels[:10], 60, 400, 400), np.arange(10))


def test_other_images_are_refused() -> None:
    with pytest.raises(DataError, match="not uint8"):
        find_corners(np.zeros((5, 5)), GfttSettings())
    with pytest.raises(DataError, match="mask"):
        find_corners(squares(), GfttSettings(), excluded=np.zeros((5, 5), dtype=np.bool_))
